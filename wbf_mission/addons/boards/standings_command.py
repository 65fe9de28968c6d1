"""Commands ``bench report``, ``compare`` and ``replay``, and the standings that ``bench run`` prints."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from geo.texts import unknown
from wbf_mission.cli import options
from wbf_mission.cli.bench import RUN_PANEL, Flying, choices, exit_code, selection, warn_of_failures
from wbf_mission.cli.command import Command, provided
from wbf_mission.cli.options import TargetError, option
from wbf_mission.cli.output import Output
from wbf_mission.exit_codes import ExitCode

if TYPE_CHECKING:
    from collections.abc import Sequence

    from wbf_mission.addons.base.pages import RunPage, Table
    from wbf_mission.bench.rows import BenchRow
    from wbf_mission.bench.spec import BenchRun
    from wbf_mission.scenario import Choice

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
    out: Annotated[Path | None, option("Folder of the results.  [default: results are not stored]")] = None,
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
        output.warn(f"{builds}; tables separate these behaviours, and 'bench report --out' lists them")
    for group in scored(apart(rows)):
        if group.left_out:
            output.warn(f"{group.scenario}: {group.environments_in_words()}")


REPORT = Command(report_command, REPORT_EXAMPLES)
COMPARE = Command(compare_command, COMPARE_EXAMPLES)


REPLAY_EXAMPLES = """
Examples
wbf-mission bench replay results
wbf-mission bench replay results 4622a3d6
wbf-mission bench replay results 4622a3d6 --format html,png,pdf --out figures
wbf-mission bench replay results 91c0ffee --planner my_policy.py:MyPolicy
"""
_FORMATS = ("html", "png", "pdf")
_LISTED = 20
_OWN = "Objects that a row does not store"


@options.speaks()
def replay_command(
    output: Output,
    *,
    folder: Annotated[Path, typer.Argument(help="Folder of the benchmark's results.")],
    row: Annotated[
        str | None,
        typer.Argument(
            help="Key of a row, or its first digits.  [default: list the keys, worst score first]"
        ),
    ] = None,
    out: Annotated[Path, option("Folder for the page and the pictures.")] = Path("replays"),
    formats: Annotated[
        str, option("Formats to write, separated by commas: html, png, pdf.", "--format")
    ] = "html,png",
    planner: Annotated[
        str | None, option("Your own planner or policy that flew the row, as FILE.py:NAME.", panel=_OWN)
    ] = None,
    estimator: Annotated[
        str | None, option("Your own estimator, used for the row, as FILE.py:NAME.", panel=_OWN)
    ] = None,
) -> int:
    """Fly a benchmark run again, compare the rows bit for bit, and show the run's decisions.

    The page shows the same as 'report', and the acquisition map of each decision, which results do not store.
    The picture shows up to six decisions side by side: the candidates, the choice and the outcome.
    """
    from wbf_mission.addons.boards.replay import row_named, run_of

    wanted = list(dict.fromkeys(word.strip().lower() for word in formats.split(",") if word.strip()))
    wrong = next((name for name in wanted if name not in _FORMATS), None)
    if wrong is not None:
        raise TargetError(f"--format: {unknown('format', wrong, _FORMATS)}")
    if not wanted:
        raise TargetError(f"--format: no format is named: choose {', '.join(_FORMATS)}")
    rows = rows_in(folder)
    if row is None:
        _list(output, rows, folder)
        return ExitCode.GOOD
    own = {"planner": _own(planner, "planner"), "estimator": _own(estimator, "estimator")}
    found = row_named(rows, row, folder)
    return _replay(output, found, run_of(found, **own), out, wanted)


def _own(text: str | None, what: str) -> Choice | None:
    """Return the planner, policy or estimator given as FILE.py:NAME; None if nothing is given."""
    from wbf_mission.own_code import own_choice
    from wbf_mission.scenario import ScenarioError

    if text is None:
        return None
    own = own_choice(text, what)
    if own is None:
        raise ScenarioError(f"--{what} {text}: give FILE.py:NAME; a built-in {what} is taken from the row")
    return own


def _list(output: Output, rows: Sequence[BenchRow], folder: Path) -> None:
    """Print the keys of the rows, worst score first."""
    from wbf_mission.bench.rows import KEY_DIGITS

    worst = sorted(rows, key=lambda row: -1e9 if row.score is None else row.score)
    columns = ["key", "scenario", "planner", "estimator", "seed", "score", "error"]
    values = [{name: getattr(row, name) for name in columns} for row in worst]
    table = [
        [
            *(row.key[:KEY_DIGITS], row.scenario, row.planner, row.estimator, str(row.seed)),
            row.error or ("-" if row.score is None else f"{row.score:.4f}"),
        ]
        for row in worst[:_LISTED]
    ]
    shown = f"the worst {_LISTED} of {len(rows)} rows" if len(rows) > _LISTED else f"{len(rows)} rows"
    output.table(values, ["key", *columns[1:-1]], table, title=f"{folder}: {shown}")


def _replay(output: Output, row: BenchRow, run: BenchRun, out: Path, formats: Sequence[str]) -> int:
    from wbf_mission.addons.boards.replay import replay
    from wbf_mission.bench.rows import KEY_DIGITS

    name = row.key[:KEY_DIGITS]
    page_of: type[RunPage] | None = provided("run") if "html" in formats else None
    out.mkdir(parents=True, exist_ok=True)
    with output.progress(), tempfile.TemporaryDirectory() as logs:
        events, log = output.events, Path(logs) / "flight.tlog"
        page = page_of(events, len(row.times_s)) if page_of else None
        again = replay(row, run, events=events, tlog=log if page else None)
        pictures = [out / f"{name}.{suffix}" for suffix in formats if suffix != "html"]
        decided = sum(acquisition is not None for acquisition in again.acquisitions)
        notes = [f"Row {row.key} flown again: {again.verdict}"]
        if again.result.decisions and not decided:
            notes.append(f"{row.planner} uses no acquisition map, so none is shown")
        files: dict[str, Any] = {}
        if page is not None:
            path, own_log = out / f"{name}.html", log if log.is_file() else None
            notes = list(page.write(path, again.result, log=own_log, notes=notes, progress=events.progress))
            files["page"] = str(path)
        if pictures:
            from wbf_mission.addons.boards.decision_plot import plot_decisions

            plot_decisions(again.result, again.acquisitions, pictures, title=row.named)
            files["pictures"] = [str(picture) for picture in pictures]
    for note in notes[1:]:
        output.note(f"note: {note}")
    values = {
        "key": row.key,
        "run": row.named,
        "equal": again.equal,
        "differences": list(again.differences),
        "causes": list(again.causes),
        "decisions": len(again.result.decisions),
        "acquisition_maps": decided,
        **files,
        "notes": notes[1:],
    }
    shown = {
        "run": row.named,
        "again": again.verdict,
        "decisions": f"{len(again.result.decisions)}, {decided} of them with an acquisition map",
        "written": "\n".join([*([files["page"]] if "page" in files else []), *files.get("pictures", [])]),
    }
    output.result(values, shown)
    return ExitCode.GOOD if again.equal else ExitCode.NOT_GOOD


REPLAY = Command(replay_command, REPLAY_EXAMPLES)
