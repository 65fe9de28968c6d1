"""Products: files and folders that add-ons write beside a run's results, found by entry points."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from geo.imports import entry_points, load_named
from wbf_mission.results.storage import ResultError

if TYPE_CHECKING:
    from wbf_mission.progress import Progress
    from wbf_mission.run.record import RunRecord
    from wbf_mission.scenario import Scenario

GROUP = "wbf_mission.products"
ANIMATION, TREATMENT = "run.gif", "treatment"


class Product(Protocol):
    """File or folder that an add-on makes from a run.

    Attributes
    ----------
    needs_estimate : bool
        Whether the run's estimate must still be in memory. The other products are written last, without it.
    """

    needs_estimate: bool

    def require(self, scenario: Scenario) -> None:
        """Raise WbfMissionError, before anything flies, if the product of this scenario cannot be made."""

    def is_possible(self, run: RunRecord) -> bool:
        """Return whether the run has the data of the product."""

    def write(self, run: RunRecord, path: Path, progress: Progress) -> None:
        """Write the file or folder; `progress` may raise KeyboardInterrupt."""


def product_names() -> frozenset[str]:
    """Return the names of the files and folders that the installed add-ons can make."""
    return frozenset(entry.name for entry in entry_points(GROUP))


def product(name: str) -> Product:
    """Return a product by name; ResultError if no installed package provides it."""
    made: Product = load_named(GROUP, name, "makes", "the product", ResultError)
    return made
