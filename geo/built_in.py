"""The names of the built-in farms, to be listed without making any."""

from __future__ import annotations

MINIBERRY_SIZES = (10, 30, 100)  # cells on a side


def farm_names() -> tuple[str, ...]:
    """The names of the built-in farms.

    Examples
    --------
    >>> farm_names()
    ('miniberry-10', 'miniberry-30', 'miniberry-100', 'waterberry')
    """
    return (*(f"miniberry-{size}" for size in MINIBERRY_SIZES), "waterberry")
