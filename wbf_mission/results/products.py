"""Products: files and folders that add-ons write beside a run's results; entry points name the add-ons."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from geo.imports import entry_points, load_named
from wbf_mission.results.storage import ResultError

if TYPE_CHECKING:
    from wbf_mission.progress import Progress
    from wbf_mission.run.record import RunRecord
    from wbf_mission.scenario import Scenario

GROUP = "wbf_mission.products"
PICTURES, ANIMATION, TREATMENT = "path.png", "run.gif", "treatment"


class Product(Protocol):
    """Files or a folder that an add-on makes from a run; the product has the name of its first file.

    Attributes
    ----------
    needs_estimate : bool
        Whether the run's estimate must still be in memory. Other products are written last.
    """

    needs_estimate: bool

    def require(self, scenario: Scenario) -> None:
        """Raise WbfMissionError, before anything flies, if this scenario cannot give the product."""

    def files(self, run: RunRecord) -> Sequence[str]:
        """Return the names of the files, or the name of the folder, that can be made from the run."""

    def write(self, run: RunRecord, path: Path, progress: Progress) -> None:
        """Write one of the `files`, or the folder; `progress` may raise KeyboardInterrupt."""


def product_names() -> frozenset[str]:
    """Return the names of the products that the installed add-ons can make."""
    return frozenset(entry.name for entry in entry_points(GROUP))


def product(name: str) -> Product:
    """Return a product by name; ResultError if no installed package provides it."""
    return load_named(GROUP, name, "makes", "the product", ResultError)
