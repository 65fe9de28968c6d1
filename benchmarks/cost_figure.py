"""The paper's cost figure: seconds for an estimate against the number of observations, beside the reference.

Each row is one estimate of the three fields over the whole farm from n observations in random cells, from
nothing. A method is stopped when an estimate takes more than 10 seconds, as in the paper, and larger numbers
are not tried. The references are the authors' methods, written anew:

- adaptive disk: field by field and disk by disk, each through a mask of the whole farm (the disk itself is
  made once for each estimate; the values have to be ours in every cell, a checksum is compared);
- Gaussian process: scikit-learn's, fitted from nothing with five restarts, and asked for every cell.

"numpy" is what numpy does with the disks at its best: only the window around each disk is touched.
"next 100" is what follows in a running flight: the estimate after 100 further observations.

Examples::

    python benchmarks/cost_figure.py --farms miniberry-10 miniberry-30 --limit 2
    OMP_NUM_THREADS=1 python benchmarks/cost_figure.py --draw docs/images/cost-figure.png

Every method runs in a process of its own, so that it can be stopped. With ``--results FILE`` the measurements
are kept as JSON, and those of methods and farms that are not run again are taken from there.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import sys
import time
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from geo.atomic import atomic_write
from geo.farms import get_farm
from geo.grid import FarmGrid
from sensors.estimators import make_estimator
from sensors.estimators.disk.disks import adaptive_radius
from sensors.fields import PAPER_FIELDS
from sensors.observations import Observations
from sensors.scoring.information import InformationModel

FARMS = ("miniberry-10", "miniberry-30", "miniberry-100", "waterberry")
ESTIMATORS = {"AD": "adaptive-disk", "GP": "gp"}
NUMBERS = (1, 3, 10, 30, 100, 200, 300, 1000, 3000, 10_000, 25_000, 100_000, 250_000)
WHO = ("reference", "numpy", "ours")
OURS = tuple(f"{name} ours" for name in ESTIMATORS)
LIMIT_S = 10.0
PREPARATION_S = 300.0
FURTHER = 100
ENOUGH_S = 0.3
GREY = "#52514e"
MOST_TIMES = 5


@dataclass(frozen=True, slots=True)
class Measurement:
    """One estimate's time; None where the method was stopped or, for `next_s`, does not go on."""

    method: str
    farm: str
    n: int
    seconds: float | None
    next_s: float | None = None
    checksum: int | None = None


def observations(grid: FarmGrid, n: int) -> Observations:
    """Return n observations in random cells, with invented values."""
    rng = np.random.default_rng(0)
    x, y = rng.integers(0, grid.shape[0], n), rng.integers(0, grid.shape[1], n)
    sick = np.where(np.sin(x / 4) * np.cos(y / 5) > 0.6, 0.5, 1.0)
    values = np.stack([sick, rng.choice([0.5, 1.0], n, p=[0.05, 0.95]), 0.5 + 0.3 * np.sin(x / 30)], axis=1)
    return Observations(
        x.astype(np.int32),
        y.astype(np.int32),
        np.arange(n, dtype=np.float64),
        np.full(n, 6, np.int32),
        values,
    )


def disks_of(
    grid: FarmGrid, seen: Observations
) -> Iterator[tuple[int, float, tuple[slice, slice], NDArray[np.bool_]]]:
    """Yield field, value, window and mask of every disk in the order of drawing."""
    width, height = grid.shape
    r = adaptive_radius(len(seen), grid.shape)
    steps = np.arange(-r, r + 1)
    disk = steps[:, None] ** 2 + steps**2 <= r * r
    for k in range(len(PAPER_FIELDS)):
        for x, y, value in zip(seen.x.tolist(), seen.y.tolist(), seen.values[:, k].tolist(), strict=True):
            x0, x1, y0, y1 = max(0, x - r), min(width, x + r + 1), max(0, y - r), min(height, y + r + 1)
            mask = disk[x0 - x + r : x1 - x + r, y0 - y + r : y1 - y + r]
            yield k, value, (slice(x0, x1), slice(y0, y1)), mask


def whole_farm_disks(grid: FarmGrid, seen: Observations) -> InformationModel:
    """Lay every disk on every field through a mask of the whole farm, one after the other."""
    model = InformationModel.uniform(grid.shape, value=PAPER_FIELDS.defaults, uncertainty=1.0)
    for k, value, (x, y), disk in disks_of(grid, seen):
        whole = np.zeros(grid.shape, np.bool_)
        whole[x, y] = disk
        model.value[k][whole] = value
        model.uncertainty[k][whole] = 0.0
    return model


def windowed_disks(grid: FarmGrid, seen: Observations) -> InformationModel:
    """Lay every disk on the window around it, one after the other."""
    model = InformationModel.uniform(grid.shape, value=PAPER_FIELDS.defaults, uncertainty=1.0)
    for k, value, (x, y), disk in disks_of(grid, seen):
        model.value[k, x, y][disk] = value
        model.uncertainty[k, x, y][disk] = 0.0
    return model


def reference_process(grid: FarmGrid, seen: Observations) -> InformationModel:
    """Fit scikit-learn's process to every field and ask it for every cell."""
    estimator = make_estimator("gp-sklearn", random_state=1, max_points=10**9, max_entries=10**18)
    return estimator.fit(grid, seen).predict()


REFERENCES: dict[str, Callable[[FarmGrid, Observations], InformationModel]] = {
    "AD reference": whole_farm_disks,
    "AD numpy": windowed_disks,
    "GP reference": reference_process,
}


def measure(method: str, farm: str, connection: Connection) -> None:
    """Answer numbers of observations with measurements, in a process of its own."""
    grid = get_farm(farm).grid()
    seen = observations(grid, max(NUMBERS) + FURTHER)
    small = get_farm(FARMS[0]).grid()
    few = observations(small, 200)
    ours = method not in REFERENCES
    name = ESTIMATORS[method.partition(" ")[0]]
    estimator = make_estimator(name, random_state=1)

    def estimate(grid: FarmGrid, seen: Observations) -> InformationModel:
        return estimator.fit(grid, seen).predict() if ours else REFERENCES[method](grid, seen)

    # What a process does once, importing and loading compiled code, is not the method's cost.
    for n in (1, 30):
        estimate(small, few[:n])
    if ours:
        estimator.partial_fit(few[30:]).predict()
    if method.startswith("AD"):
        # Memory that a process takes for the first time is slower than the method itself.
        estimate(grid, seen[:1])
    connection.send(None)
    while True:
        n = connection.recv()
        times: list[float] = []
        model = None
        while not times or (sum(times) < ENOUGH_S and len(times) < MOST_TIMES):
            # The model before and the estimator's memory of it are given back first: no method needs two.
            model = None
            estimator = make_estimator(name, random_state=1)
            begin = time.perf_counter()
            model = estimate(grid, seen[:n])
            times.append(time.perf_counter() - begin)
        # The parent stops the clock here; the rest is not limited.
        connection.send(None)
        checksum = zlib.crc32(model.value.tobytes()) if name == "AD" and model is not None else None
        next_s = None
        if ours:
            begin = time.perf_counter()
            estimator.partial_fit(seen[n : n + FURTHER]).predict()
            next_s = time.perf_counter() - begin
        connection.send(Measurement(method, farm, n, float(np.median(times)), next_s, checksum))


def run(method: str, farm: str, numbers: Iterable[int], limit_s: float) -> list[Measurement]:
    """Measure a method on a farm with growing numbers of observations until it takes too long."""
    context = multiprocessing.get_context("spawn")
    connection, theirs = context.Pipe()
    worker = context.Process(target=measure, args=(method, farm, theirs), daemon=True)
    worker.start()
    theirs.close()
    found: list[Measurement] = []
    try:
        if not connection.poll(PREPARATION_S):
            raise TimeoutError(f"{method} on {farm} does not start")
        connection.recv()
        for n in numbers:
            connection.send(n)
            if not connection.poll(limit_s + MOST_TIMES * ENOUGH_S):
                found.append(Measurement(method, farm, n, None))
                break
            connection.recv()
            one: Measurement = connection.recv()
            found.append(one)
            if one.seconds is not None and one.seconds > limit_s:
                found[-1] = Measurement(method, farm, n, None)
                break
    except EOFError:
        # The process died, for example for lack of memory; that is no answer within the limit either.
        found.append(Measurement(method, farm, n, None))
    finally:
        worker.terminate()
        worker.join()
        connection.close()
    return found


def load(path: Path | None) -> list[Measurement]:
    """Return the measurements of an earlier run."""
    if path is None or not path.exists():
        return []
    return [Measurement(**row) for row in json.loads(path.read_text(encoding="utf-8"))]


def save(path: Path, measurements: list[Measurement]) -> None:
    """Keep measurements."""
    with atomic_write(path) as stream:
        stream.write(json.dumps([asdict(one) for one in measurements], indent=1) + "\n")


def seconds_text(seconds: float | None) -> str:
    """Return seconds with two significant digits, a mark where the method was stopped."""
    if seconds is None:
        return "stopped"
    return f"{seconds:.4f}" if seconds < 0.1 else f"{seconds:.2f}"


def table(measurements: list[Measurement], limit_s: float) -> str:
    """Return all measurements as a table in Markdown."""
    found = {(one.method, one.farm, one.n): one for one in measurements}
    stopped = {(one.method, one.farm) for one in measurements if one.seconds is None}
    lines = [
        "| estimator | farm | observations | reference, s | numpy, s | ours, s | ratio | next 100, s |",
        "|---|---|---:|---:|---:|---:|---:|---:|",
    ]
    for name in ESTIMATORS:
        for farm in FARMS:
            for n in NUMBERS:
                reference, numpy, ours = (found.get((f"{name} {who}", farm, n)) for who in WHO)
                if reference is None and numpy is None and ours is None:
                    continue
                theirs_s, ours_s = (one.seconds if one else None for one in (reference, ours))
                ratio = ""
                if ours_s and reference:
                    ratio = f"{theirs_s / ours_s:.3g}" if theirs_s else f"> {limit_s / ours_s:.3g}"
                elif ours_s and (f"{name} reference", farm) in stopped:
                    ratio = f"> {limit_s / ours_s:.3g}"
                cells = [
                    name,
                    farm,
                    f"{n:,}",
                    *(seconds_text(one.seconds) if one else "" for one in (reference, numpy, ours)),
                    ratio,
                    seconds_text(ours.next_s) if ours and ours.next_s is not None else "",
                ]
                lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def disagreements(measurements: list[Measurement]) -> list[str]:
    """Name the cases in which the disks of both methods are not the same in every cell."""
    sums: dict[tuple[str, int], set[int]] = {}
    for one in measurements:
        if one.checksum is not None:
            sums.setdefault((one.farm, one.n), set()).add(one.checksum)
    return [f"{farm} with {n} observations" for (farm, n), found in sums.items() if len(found) > 1]


def draw(measurements: list[Measurement], limit_s: float, path: Path) -> None:
    """Draw the figure: a panel for each estimator, a colour for each farm, dashes for the reference."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    colours = dict(zip(FARMS, ("#86b6ef", "#3987e5", "#1c5cab", "#0b2f5c"), strict=True))
    figure = Figure(figsize=(10, 4.8), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    for panel, (name, title) in zip(
        panels, {"AD": "Adaptive disk", "GP": "Gaussian process"}.items(), strict=True
    ):
        for farm, colour in colours.items():
            for who, style, face in (("reference", "--", "white"), ("ours", "-", colour)):
                rows = [one for one in measurements if (one.method, one.farm) == (f"{name} {who}", farm)]
                rows.sort(key=lambda one: one.n)
                done = [(one.n, one.seconds) for one in rows if one.seconds is not None]
                stopped = [(one.n, limit_s) for one in rows if one.seconds is None]
                line = done[-1:] + stopped[:1] if stopped else []
                if done:
                    x, y = zip(*done, strict=True)
                    panel.plot(
                        x,
                        y,
                        style,
                        color=colour,
                        marker="o",
                        markersize=4.5,
                        markerfacecolor=face,
                        linewidth=1.8,
                    )
                if len(line) == 2:
                    panel.plot(*zip(*line, strict=True), ":", color=colour, linewidth=1.2)
                if stopped:
                    panel.plot(
                        *zip(*stopped, strict=True), "x", color=colour, markersize=8, markeredgewidth=2
                    )
        panel.axhline(limit_s, color="#898781", linewidth=1)
        panel.set(xscale="log", yscale="log", xlabel="observations", title=title)
        panel.grid(True, which="major", color="#e1e0d9", linewidth=0.7)
        panel.spines[["top", "right"]].set_visible(False)
        panel.set_axisbelow(True)
    panels[0].set_ylabel("seconds for one estimate of three fields")
    panels[0].annotate(
        f"limit {limit_s:g} s",
        (1, limit_s),
        xytext=(0, 4),
        textcoords="offset points",
        fontsize=9,
        color=GREY,
    )
    handles = [Line2D([], [], color=colour, linewidth=2, label=farm) for farm, colour in colours.items()]
    ours = Line2D([], [], color=GREY, linestyle="-", marker="o", markersize=4.5, label="ours")
    reference = Line2D([], [], color=GREY, linestyle="--", marker="o", markersize=4.5, label="reference")
    reference.set_markerfacecolor("white")
    handles += [ours, reference]
    handles.append(Line2D([], [], linestyle="", color=GREY, marker="x", markeredgewidth=2, label="stopped"))
    figure.legend(handles=handles, loc="outside lower center", ncols=7, frameon=False, fontsize=9)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=130)


def main() -> int:
    """Run the benchmark; the exit code tells whether both methods draw the same disks."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--farms", nargs="*", choices=FARMS, default=list(FARMS))
    parser.add_argument("--estimators", nargs="*", choices=sorted(ESTIMATORS), default=list(ESTIMATORS))
    parser.add_argument("--limit", type=float, default=LIMIT_S, help="seconds for one estimate")
    parser.add_argument("--results", type=Path, help="keep the measurements in this file (JSON)")
    parser.add_argument("--draw", type=Path, help="draw the figure to this file (PNG)")
    options = parser.parse_args()
    measurements = load(options.results)
    for name in options.estimators:
        for farm in options.farms:
            for method in (f"{name} {who}" for who in WHO):
                if method not in REFERENCES and method not in OURS:
                    continue
                print(f"{method}, {farm} ...", file=sys.stderr, flush=True)
                measurements = [one for one in measurements if (one.method, one.farm) != (method, farm)]
                measurements += run(method, farm, NUMBERS, options.limit)
                if options.results is not None:
                    save(options.results, measurements)
    print(table(measurements, options.limit))
    if options.draw is not None:
        draw(measurements, options.limit, options.draw)
    wrong = disagreements(measurements)
    for case in wrong:
        print(f"DIFFERENT disks: {case}", flush=True)
    if not wrong:
        print("\nAdaptive disk: the values of both methods are equal in every cell wherever both finished.")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
