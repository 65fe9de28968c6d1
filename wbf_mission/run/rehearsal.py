"""Compiles the estimator's functions in another process, while a run plans and flies.

While numba compiles a function, the rest of the process waits. On a machine's first run, compiling the
estimator's functions takes as long as the rest of the run.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

from geo.compiled import compiled_folder, sources_digest
from geo.farms import get_farm
from wbf_mission.run.resolve import Run

REHEARSED_ON = "miniberry-100"
"""Farm for compiling; it has so few tiles that estimating takes less time than compiling."""
# Estimators that work in tiles; other estimators are trained for each farm, or compile nothing.
_IN_TILES = ("gp", "adaptive-disk")


@contextmanager
def rehearsed(run: Run, rehearse: Callable[[str], None]) -> Iterator[Callable[[], None]]:
    """Compile the estimator's functions in another process; yield a function that waits for its end.

    The other process is used only for farms larger than `REHEARSED_ON`, and once per machine. If the other
    process fails, this process compiles.

    Parameters
    ----------
    rehearse : callable
        Function that runs all compiled functions of the estimator with a given name.
    """
    choice = run.asked.estimate.estimator
    name = choice.name if choice.made is None else ""
    mark = _mark(run, name)
    if mark is None or mark.exists():
        yield lambda: None  # There is no other process to wait for
        return
    from geo.processes import Processes

    processes = Processes(1)
    try:
        compiled = processes.submit(_rehearse, rehearse, name, mark)

        def wait() -> None:
            with suppress(Exception):
                compiled.result()

        yield wait
    finally:
        processes.close()


def _mark(run: Run, name: str) -> Path | None:
    """Return the file that marks an estimator as compiled, or None if no other process is needed."""
    small = run.farm.width_cells * run.farm.height_cells <= get_farm(REHEARSED_ON).owner_cells
    if small or name not in _IN_TILES or os.environ.get("NUMBA_DISABLE_JIT"):
        return None
    from joblib import cpu_count

    folder = compiled_folder()
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
    # Processes can share compiled functions only through a writable folder.
    if cpu_count() < 2 or not (folder.is_dir() and os.access(folder, os.W_OK)):
        return None
    made_of = [
        sources_digest(Path(spec.origin).resolve())
        for spec in map(find_spec, (type(run.estimator).__module__, "sensors.scoring.score_sums"))
        if spec is not None and spec.origin is not None
    ]
    key = hashlib.sha256("\n".join([*made_of, version("numba"), name]).encode()).hexdigest()
    return folder / f"estimate-{name}-{key[:16]}"


def _rehearse(rehearse: Callable[[str], None], name: str, mark: Path) -> None:
    rehearse(name)
    mark.touch()
