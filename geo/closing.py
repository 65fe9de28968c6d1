"""Base class of objects with a ``close`` method."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Self


class Closing(ABC):
    """Context manager that calls `close` at the end of the ``with`` block."""

    @abstractmethod
    def close(self) -> None:
        """Close the object; a second call does nothing."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
