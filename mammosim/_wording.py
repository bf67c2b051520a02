"""Numbers in sentences."""

from __future__ import annotations


def counted(number: float, thing: str) -> str:
    """A number and what it counts, in the singular for one.

    Examples
    --------
    >>> counted(1, "patient"), counted(0, "lesion"), counted(3.0, "view")
    ('1 patient', '0 lesions', '3 views')
    """
    return f"{number:.0f} {thing}" + ("" if number == 1 else "s")
