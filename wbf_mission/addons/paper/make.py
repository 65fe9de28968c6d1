"""Figures of the paper: runs missing flights and measurements, draws the figures, writes the page."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from geo import Crop
from geo.farms import get_farm
from geo.texts import unknown
from wbf_mission.addons.base.pages import Page, Picture, Section
from wbf_mission.addons.base.plots import CROP_COLOURS, LINE_COLOURS, draw_farm, new_sheet, save_sheet
from wbf_mission.addons.base.standings import SCORES, field_table, standing_table, standings
from wbf_mission.addons.paper.comparison import (
    authors_table,
    early_table,
    fall_table,
    lead_table,
    pair_table,
    plot_pairs,
    plot_scores,
)
from wbf_mission.addons.paper.cost import FARMS, LIMIT_S, measured_costs, plot_costs
from wbf_mission.addons.paper.dynamics import DAYS, Dynamics, plot_dynamics
from wbf_mission.addons.paper.shown import shown_runs
from wbf_mission.bench.benchmark import benchmark
from wbf_mission.bench.rows import BenchRow
from wbf_mission.bench.spec import BenchSpec
from wbf_mission.progress import Progress, silent
from wbf_mission.results.storage import ResultError
from wbf_mission.run.resolve import FlightError
from wbf_mission.scenario import scenario_with

_DRAWN = ("waterberry", "miniberry-10", "miniberry-30", "miniberry-100")
"""Farms of the paper; the full farm comes first."""


def plot_geometry(paths: Sequence[Path]) -> None:
    """Draw the paper's farms: the full farm large, the small farms beside it."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    figure = new_sheet(8.0, 5.2)
    panels = figure.add_gridspec(3, 2, width_ratios=(3.6, 1.0))
    farms = [get_farm(name) for name in _DRAWN]
    shown: set[str] = set()
    for number, farm in enumerate(farms):
        axes = figure.add_subplot(panels[:, 0] if number == 0 else panels[number - 1, 1])
        draw_farm(axes, farm, legend=False)
        shown |= {patch.crop for patch in farm.patches}
        cells = f"{farm.width_cells} x {farm.height_cells} cells of one square foot"
        axes.set_title(f"{farm.name}\n{cells}" if number == 0 else farm.name, fontsize=9)
        axes.tick_params(labelsize=7)
        if number:
            axes.set_ylabel("")
            if number < len(farms) - 1:
                axes.set_xlabel("")
    crops = [crop for crop in Crop if crop in shown and crop != Crop.NONE]
    handles: list[Any] = [Patch(color=CROP_COLOURS[crop], label=str(crop)) for crop in crops]
    handles.append(Line2D([], [], color="#5b4636", linewidth=1.2, linestyle="--", label="the owner's land"))
    figure.legend(handles=handles, loc="outside lower center", ncols=5, fontsize=8, frameon=False)
    save_sheet(figure, paths)


FIGURES = ("geometry", "dynamics", "comparison", "cost")
FORMATS = ("png", "pdf")
PAGE = "paper.md"


@dataclass(frozen=True, slots=True)
class Paper:
    """Result of `make_paper`."""

    page: Page
    files: tuple[Path, ...]
    """The Markdown page, then the pictures."""
    rows: tuple[BenchRow, ...]
    """Rows of the comparison; empty if it was not requested."""


@dataclass(frozen=True, slots=True)
class _Sheets:
    """Pictures in a folder, in the chosen formats."""

    folder: Path
    formats: tuple[str, ...]

    def paths(self, name: str) -> list[Path]:
        """Return the files of a picture, one for each format."""
        return [self.folder / f"{name}.{suffix}" for suffix in self.formats]

    def picture(self, name: str, shows: str) -> Picture:
        """Return a picture for the page: a PNG if there is one, else another format."""
        suffix = FORMATS[0] if FORMATS[0] in self.formats else self.formats[0]
        return Picture(f"{name}.{suffix}", shows)


def make_paper(
    spec: BenchSpec,
    out: str | Path,
    *,
    figures: Sequence[str] = FIGURES,
    formats: Sequence[str] = FORMATS[:1],
    jobs: int = 1,
    cost_farms: Sequence[str] = FARMS,
    dynamics_farms: Sequence[str] = (),
    progress: Progress = silent,
) -> Paper:
    """Draw the chosen `FIGURES` of the paper in the chosen `FORMATS`, and a page with their captions.

    Flights, maps and costs are kept in the folder, so a second call only draws. The comparison uses one
    scenario, and shows the environment of the first seed. The figure of the days shows the scenario's farm,
    or `dynamics_farms`. Costs are measured on `cost_farms`.

    Raises
    ------
    ResultError
        If a figure or a format is unknown, `spec` has several scenarios, or a file in the folder is damaged.
    WbfMissionError
        If a farm is unknown, or a run has no result to draw.
    BenchmarkInterrupted, KeyboardInterrupt
        At Ctrl-C; finished work is kept.
    """
    for what, given, known in (("figure", figures, FIGURES), ("format", formats, FORMATS)):
        wrong = next((name for name in given if name not in known), None)
        if wrong is not None:
            raise ResultError(unknown(what, wrong, known))
        if not given:
            raise ResultError(f"no {what} is given: choose {', '.join(known)}")
    if len(spec.scenarios) != 1:
        raise ResultError(
            f"{len(spec.scenarios)} scenarios: the paper's comparison uses one scenario; give only one"
        )
    for farm in (*cost_farms, *dynamics_farms):
        get_farm(farm)
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    sheets = _Sheets(folder, tuple(dict.fromkeys(formats)))
    rows: list[BenchRow] = []
    sections = []
    if "geometry" in figures:
        sections.append(_geometry(sheets))
    if "dynamics" in figures:
        sections.append(_dynamics(sheets, spec, dynamics_farms, progress))
    if "comparison" in figures:
        rows = benchmark(spec, out=folder / "runs", jobs=jobs, progress=progress)
        sections.append(_comparison(sheets, spec, rows, jobs, progress))
    if "cost" in figures:
        sections.append(_cost(sheets, cost_farms, progress))
    page = Page("The figures of the Waterberry Farms paper", _ABOUT, tuple(sections))
    page.write(folder / PAGE)
    stems = [Path(picture.file).stem for section in sections for picture in section.pictures]
    return Paper(page, (folder / PAGE, *(path for stem in stems for path in sheets.paths(stem))), tuple(rows))


_ABOUT = (
    "Made by wbf-mission bench paper. After S. Matloob, P. P. Datta, O. P. Kreidl, A. Dutta, S. Roy and"
    " L. Bölöni, “Waterberry Farms: A Novel Benchmark For Informative Path Planning”, arXiv:2305.06243."
)


def _geometry(sheets: _Sheets) -> Section:
    plot_geometry(sheets.paths("geometry"))
    caption = (
        "The farms of the benchmark; one cell is one square foot. Land outside the dashed line belongs to "
        "the neighbours: diseases spread there as well, but it is not scored."
    )
    return Section("The farms", caption, (sheets.picture("geometry", "The farms"),))


def _dynamics(sheets: _Sheets, spec: BenchSpec, of_farms: Sequence[str], progress: Progress) -> Section:
    name, scenario = spec.scenarios[0]
    seeds, title = spec.seeds, f"{len(DAYS)} days of the environment"
    drawn = {f"dynamics-{farm}": scenario_with(scenario, {"farm": farm}) for farm in of_farms}
    pictures, farms = [], []
    for file, one in (drawn or {"dynamics": scenario}).items():
        dynamics = Dynamics(one, seeds, progress)
        plot_dynamics(dynamics, sheets.paths(file))
        pictures.append(sheets.picture(file, f"{len(DAYS)} days of {dynamics.farm.name}"))
        farms.append(dynamics.farm.name)
    right = "its means over the days"
    if len(seeds) > 1:
        right = f"the mean of {len(seeds)} environments with the range from the lowest to the highest"
    caption = (
        f"{len(DAYS)} days of {' and '.join(farms)} ({name}): the environment of seed {seeds[0]}, and on the"
        f" right {right}. On a large farm, a pixel shows its sickest plant. Grey cells do not have the field."
    )
    return Section(title, caption, tuple(pictures))


def _comparison(
    sheets: _Sheets, spec: BenchSpec, rows: list[BenchRow], jobs: int, progress: Progress
) -> Section:
    name, scenario = spec.scenarios[0]
    first = spec.seeds[0]
    failed = {row.key for row in rows if row.error is not None}
    runs = [
        run for run in itertools.islice(spec.runs(), len(spec) // len(spec.seeds)) if run.key not in failed
    ]
    shown = shown_runs(runs, sheets.folder / "shown", jobs=jobs, progress=progress)
    colours = {str(planner): LINE_COLOURS[k % len(LINE_COLOURS)] for k, planner in enumerate(spec.planners)}
    # If every run of an estimator failed, the estimator has no figure.
    estimators = [str(one) for one in spec.estimators if any(own == str(one) for _, own in shown)]
    if not estimators:
        msg = f"comparison: every run on seed {first} failed; {next(row.error for row in rows if row.error)}"
        raise FlightError(msg)
    of_first = [row for row in rows if row.seed == first and row.error is None]
    pictures = []
    for number, estimator in enumerate(estimators, 1):
        file = f"comparison-{number}"
        plot_pairs(scenario, estimator, shown, of_first, colours, sheets.paths(file))
        pictures.append(sheets.picture(file, f"{estimator}: path, truth, estimate and score of each planner"))
    plot_scores(rows, estimators, colours, sheets.paths("comparison-scores"))
    each = "; ".join(f"{picture.file}: {of}" for picture, of in zip(pictures, estimators, strict=True))
    pictures.append(sheets.picture("comparison-scores", "Mean score over time"))
    caption = (
        f"Planners with estimators in {name}. A picture for each estimator ({each}) shows the environment"
        f" of seed {first}: the path flown, the truth and the last estimate of the diseases, each on the "
        f"plants that it can infect, and the score over time (thin: the other planners). The last picture is"
        f" the mean score over {len(spec.seeds)} environments with its 95 % interval. A score of 0 is "
        f"perfect."
    )
    found = standings(rows)
    tables = (
        standing_table(SCORES, found),
        field_table(found),
        early_table(rows),
        lead_table(rows),
        pair_table(rows),
        fall_table(rows),
        authors_table(of_first, shown),
    )
    return Section("Planners and estimators", caption, tuple(pictures), tables)


def _cost(sheets: _Sheets, farms: Sequence[str], progress: Progress) -> Section:
    costs = measured_costs(sheets.folder / "cost.json", farms=farms, progress=progress)
    plot_costs(costs, sheets.paths("cost"))
    caption = (
        f"Processor time on one thread. Left: a first estimate of the three fields over the whole farm, "
        f"against the number of observations in random cells. Right: one score of the whole farm. A cross "
        f"means more than {LIMIT_S:g} s, or an estimator that refused for lack of memory. Measured on "
        f"{costs[0].machine}."
    )
    return Section("What it costs", caption, (sheets.picture("cost", "What it costs"),))
