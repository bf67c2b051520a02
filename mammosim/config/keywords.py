"""Settings as an object or as keywords: how every public function takes them.

A function with settings of a kind takes an object of it, or its keys as keywords::

    @documents_keys(ProjectionSettings, ProjectionKeys)
    def project(compressed, settings: ProjectionSettings | None = None,
                **keys: Unpack[ProjectionKeys]) -> PathLengths:
        settings = given_settings(ProjectionSettings, settings, keys, "project")

`ProjectionKeys` is a TypedDict, from which editors and type checkers know the keywords. It is
generated from the settings (`tests/make_keys.py`), so that each key is written once.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from pydantic.fields import FieldInfo

from mammosim.config.settings import Settings
from mammosim.config.validate import SettingsType, to_settings
from mammosim.errors import InputError

Function = TypeVar("Function", bound=Callable[..., Any])


def given_settings(
    kind: type[SettingsType],
    settings: SettingsType | None,
    keys: Mapping[str, Any],
    where: str,
    prefix: tuple[str, ...] = (),
) -> SettingsType:
    """The settings that a function was given, as an object or as keywords.

    Parameters
    ----------
    kind : type of Settings
    settings : Settings or None
        An object, which is returned as it is.
    keys : mapping of str to object
        Keywords, checked like values of a configuration.
    where : str
        Name of the function, for messages.
    prefix : tuple of str
        Key path of the keywords in a configuration, for messages.

    Raises
    ------
    InputError
        If a keyword is unknown or its value is not allowed, if `settings` is of another kind, or
        if both are given.
    """
    if settings is None:
        return to_settings(kind, dict(keys), where, prefix)
    if not isinstance(settings, kind):
        raise InputError(
            f"{where}: settings: found {type(settings).__name__}, expected {kind.__name__}"
        )
    if keys:
        raise InputError(
            f"{where}: found settings and the keywords {', '.join(keys)}, expected either; "
            "settings.model_copy(update={...}) changes single values"
        )
    return settings


def documents_keys(kind: type[Settings], keys: type) -> Callable[[Function], Function]:
    """Show the keys of settings in a function's signature and docstring at run time.

    `help`, notebooks and IPython then list and complete each key with its type, default and text;
    editors, which do not run the code, read the same from the TypedDict.

    Parameters
    ----------
    kind : type of Settings
        Whose keys the function takes as ``**keys``.
    keys : type
        The TypedDict of these keys.
    """

    def decorate(function: Function) -> Function:
        signature = inspect.signature(function)
        own = [one for one in signature.parameters.values() if one.kind is not one.VAR_KEYWORD]
        names = {one.name for one in own}
        fields = {name: field for name, field in kind.model_fields.items() if name not in names}
        shown = [_parameter(name, field, keys) for name, field in fields.items()]
        whole = signature.replace(parameters=[*own, *shown])
        function.__signature__ = whole  # type: ignore[attr-defined]
        lines = [inspect.cleandoc(function.__doc__ or ""), "", "Other Parameters", "-" * 16]
        for name, field in fields.items():
            lines.append(f"{name} : {_type(name, keys)}")
            lines += [f"    {line}" for line in (field.description or "").splitlines()]
        function.__doc__ = "\n".join(lines)
        return function

    return decorate


def _parameter(name: str, field: FieldInfo, keys: type) -> inspect.Parameter:
    default = inspect.Parameter.empty
    if not field.is_required():
        default = field.get_default(call_default_factory=True)
    return inspect.Parameter(
        name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=_type(name, keys)
    )


def _type(name: str, keys: type) -> str:
    """Type of a key as it is written in the TypedDict; a key that is new is not there yet."""
    if name not in keys.__annotations__:
        return "Any"
    text: str = keys.__annotations__[name].__forward_arg__
    return text
