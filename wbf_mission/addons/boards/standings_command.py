"""Commands ``bench report`` and ``bench compare``, and the standings that ``bench run`` prints."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from wbf_mission.cli import options
from wbf_mission.cli.bench import RUN_PANEL, Flying, choices, exit_code, selection, warn_of_failures
from wbf_mission.cli.command import Command, provided
from wbf_mission.cli.options import option
from wbf_mission.cli.output import Output
from wbf_mission.exit_codes import ExitCode

if TYPE_CHECKING:
    from collections.abc import Sequence

    from wbf_mission.addons.base.pages import Table
    from wbf_mission.bench.rows import BenchRow

REPORT_EXAMPLES = """
Examples
wbf-mission bench report results
wbf-mission bench report results --out report
"""
COMPARE_EXAMPLES = """
Examples
wbf-mission bench compare rolling-horizon --against greedy,spiral
wbf-mission bench compare greedy:least_weight=0.35 --against greedy --seeds 40 --jobs 2 --out results
"""
_COMPARED = {"scenarios": "WBF/Miniberry-30-Sweep-v1", "estimators": "epidemic", "seeds": "10"}
_OPTIONS = options.taken_by(selection)
_ROW = ("key", "scenario", "planner", "estimator", "seed", "error")


def rows_in(folder: Path) -> list[BenchRow]:
    """Return the rows of a benchmark's folder; ResultError if the folder has no rows."""
    from wbf_mission.bench.rows import read_rows
    from wbf_mission.results.storage import ResultError

    rows = read_rows(folder)
    if not rows:
        raise ResultError(f"{folder}: holds no results of a benchmark; give the folder of 'bench run --out'")
    return rows


@options.speaks(quiet=False)
def report_command(
    output: Output,
    folder: Annotated[Path, typer.Argument(help="Folder of the results.")],
    out: Annotated[
        Path | None,
        option("Write a report into this folder: report.md, report.html and a picture for each scenario."),
    ] = None,
) -> int:
    """Print the standings of a benchmark, even while it runs; with --out, write a report, too."""
    from wbf_mission.addons.boards.report import report_page
    from wbf_mission.bench.requests import read_asked

    rows = rows_in(folder)
    if out is not None:
        write_page = provided("bench")
        page = report_page(rows, out, title=f"Benchmark of {len(rows)} runs", asked=read_asked(folder))
        page.write(out / "report.md")
        write_page(out / "report.html", page, out, rows)
        pictures = [picture.file for section in page.sections for picture in section.pictures]
        files = ["report.md", "report.html", *pictures]
        output.note(f"written: {', '.join(str(out / file) for file in files)}")
    print_standings(output, rows, title=f"{folder}: {len(rows)} runs")
    return ExitCode.GOOD


@options.speaks()
@options.gives("selected", selection, {key: (_OPTIONS[key][0], value) for key, value in _COMPARED.items()})
@options.gives("flying", Flying)
def compare_command(
    output: Output,
    *,
    context: typer.Context,
    mine: Annotated[str, typer.Argument(help="A planner or policy.")],
    against: Annotated[
        str, option("Planners and policies, separated by commas.", panel=RUN_PANEL)
    ] = "greedy",
    out: Annotated[Path | None, option("Folder of the results.  [default: they are not stored]")] = None,
    selected: dict[str, Any],
    flying: Flying,
) -> int:
    """Compare a planner or policy with others, on the same environments.

    Prints differences of scores with 95 % intervals, positive if the first planner is better. With --out,
    only missing runs are flown.
    """
    from dataclasses import asdict

    from wbf_mission.addons.boards.comparison import compare, difference, verdict
    from wbf_mission.bench.spec import BenchSpec

    wanted = BenchSpec.of(**selected | {"planners": choices(f"{mine},{against}", "planner")})
    rows, interrupted = flying.rows(output, wanted, out, context)
    first, *others = map(str, wanted.planners)
    found = compare(rows, first, others)
    values = [
        asdict(pair) | {"verdict": verdict(pair.score), "final_verdict": verdict(pair.final_score)}
        for pair in found
    ]
    table = [
        [
            f"{pair.scenario}, {pair.estimator}",
            pair.against,
            *difference(pair.score),
            verdict(pair.score),
            *difference(pair.final_score),
            verdict(pair.final_score),
            "-" if math.isnan(pair.better) else f"{pair.better:.0%} of {pair.environments}",
        ]
        for pair in found
    ]
    of_score = ("95 %", "verdict")
    header = ["scenario, estimator", "against", "run", *of_score, "end", *of_score, "better on"]
    title = f"{first}: difference of scores (positive if {first} is better)"
    output.table(values, header, table, title=title)
    _warn_of_uncounted(output, rows)
    warn_of_failures(output, rows)
    return exit_code(rows, interrupted=interrupted)


def print_standings(output: Output, rows: Sequence[BenchRow], title: str) -> None:
    """Print a table of standings for each scenario, and the causes of failed runs."""
    from dataclasses import asdict

    from wbf_mission.addons.base.standings import standing_table, standings

    _warn_of_uncounted(output, rows)
    found = standings(rows)
    if output.as_json:
        failures = [row for row in rows if row.error is not None]
        output.raw_json(
            {
                "standings": [asdict(standing) for standing in found],
                "failures": [{name: getattr(row, name) for name in _ROW} for row in failures],
            }
        )
        return
    for scenario in dict.fromkeys(standing.scenario for standing in found):
        heading = f"{title}: {scenario}, scores over the run and at its end (0 is perfect)"
        print_table(
            output, standing_table(heading, [standing for standing in found if standing.scenario == scenario])
        )
    warn_of_failures(output, rows)


def print_table(output: Output, table: Table) -> None:
    """Print a table of a page."""
    output.table(None, list(table.header), [list(row) for row in table.rows], title=table.title)


def _warn_of_uncounted(output: Output, rows: Sequence[BenchRow]) -> None:
    """Warn if the rows are from several versions, or if some environments do not count."""
    from wbf_mission.addons.base.standings import apart, builds_in_words, scored

    if builds := builds_in_words(rows):
        output.warn(f"{builds}; tables keep different behaviours apart, and 'bench report --out' lists them")
    for group in scored(apart(rows)):
        if group.left_out:
            output.warn(f"{group.scenario}: {group.environments_in_words()}")


REPORT = Command(report_command, REPORT_EXAMPLES)
COMPARE = Command(compare_command, COMPARE_EXAMPLES)
