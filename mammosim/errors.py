"""The two ways in which a run can fail that a user can do something about."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any


class MammosimError(Exception):
    """Ancestor of the package's own errors."""


class InputError(MammosimError):
    """Input that cannot be used.

    Parameters
    ----------
    problems : str or iterable of str
        One plain sentence a mistake: what is wrong, the value found, what is allowed, and where
        (file, key path, voxel).

    Attributes
    ----------
    problems : tuple of str
    """

    def __init__(self, problems: str | Iterable[str]) -> None:
        self.problems = (problems,) if isinstance(problems, str) else tuple(problems)
        super().__init__("\n".join(self.problems))


class NotConverged(MammosimError):
    """A solver stopped before it reached its tolerance.

    Parameters
    ----------
    message : str
        What was reached and what was asked for.
    reached : object
        The result as far as it came (a `CompressedBreast` that says it is not converged).
    """

    def __init__(self, message: str, reached: Any) -> None:
        super().__init__(message)
        self.reached = reached


class Interrupted(MammosimError):
    """The user stopped a solver; what it had reached is kept.

    Parameters
    ----------
    message : str
        What was reached.
    reached : object
        The result as far as it came; None if there is none.
    """

    def __init__(self, message: str, reached: Any) -> None:
        super().__init__(message)
        self.reached = reached
