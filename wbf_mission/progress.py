"""How long work tells how far it is."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

Progress: TypeAlias = Callable[[str, float, float], None]
"""Takes what is being done, how much of it is done, and how much there is."""


def silent(_what: str, _done: float, _total: float) -> None:
    """Tell nobody."""
