"""``wbf-mission bench``: many runs that can be compared."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from wbf_mission.cli import options
from wbf_mission.cli.help import HelpCommand, HelpGroup
from wbf_mission.cli.output import Output
from wbf_mission.exit_codes import ExitCode

if TYPE_CHECKING:
    from collections.abc import Sequence

    from wbf_mission.bench.rows import BenchRow
    from wbf_mission.bench.spec import BenchSpec
    from wbf_mission.bench.standings import Interval
    from wbf_mission.scenario import Choice

LIST_EXAMPLES = """
Examples
wbf-mission bench list
wbf-mission fly --scenario WBF/Miniberry-30-v1 --planner lawnmower
"""
RUN_EXAMPLES = """
Examples
wbf-mission bench run --out results --jobs 2
wbf-mission bench run missions/bench/three-farms.toml --seeds 2 --out results
wbf-mission bench run --scenarios WBF/Miniberry-10-v1 --planners spiral,greedy --estimators gp --out results
"""
COMPARE_EXAMPLES = """
Examples
wbf-mission bench compare rolling-horizon --against greedy,spiral
wbf-mission bench compare greedy:least_weight=0.35 --against greedy --seeds 40 --jobs 2 --out results
"""
REPORT_EXAMPLES = """
Examples
wbf-mission bench report results
wbf-mission bench report results --out report
"""
PAPER_EXAMPLES = """
Examples
wbf-mission bench paper --out figures --jobs 2
wbf-mission bench paper --only comparison --seeds 20 --format png,pdf --out figures
wbf-mission bench paper missions/bench/paper.toml --only comparison --out beside-the-paper
"""

app = typer.Typer(cls=HelpGroup, help="Fly many runs that can be compared.")
_RUN = "What to run"
_FAILURES_SHOWN = 5
_TOLD_EVERY_S = 60.0
_ROW = ("key", "scenario", "planner", "estimator", "seed", "error")


@app.command("list", cls=HelpCommand, epilog=LIST_EXAMPLES)
def list_command(json: options.Json = False) -> int:
    """List the scenarios that results can be compared by.

    What an id means never changes; a change gets a new version.
    """
    from wbf_mission.bench.meaning import meaning_of
    from wbf_mission.scenario import about_scenario, load_scenario, scenario_ids

    values = [
        {"scenario": one, "about": about_scenario(one), "meaning": meaning_of(load_scenario(one))}
        for one in scenario_ids()
    ]
    rows = [[one["scenario"], one["about"]] for one in values]
    Output(as_json=json).table(values, ["scenario", "what it is"], rows, left=True)
    return ExitCode.GOOD


Scenarios = Annotated[
    str | None,
    typer.Option(help="Ids (see 'bench list') or files, separated by commas.", rich_help_panel=_RUN),
]
Planners = Annotated[
    str | None,
    typer.Option(
        help="Planners and policies, separated by commas, such as lawnmower:direction=0.3,greedy.",
        rich_help_panel=_RUN,
    ),
]
Estimators = Annotated[
    str | None,
    typer.Option(
        help="Estimators, separated by commas, such as gp:learn_from=model,epidemic.", rich_help_panel=_RUN
    ),
]
Seeds = Annotated[
    int | None,
    typer.Option(
        help="How many environments: seeds 0, 1, ...",
        parser=options.whole_number_in(1, 10_000_000),
        rich_help_panel=_RUN,
    ),
]
Dask = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Fly on the workers of a Dask scheduler, such as tcp://10.0.0.1:8786, or of one made here:"
        " local (with --jobs).",
        show_default=False,
    ),
]
Retry = Annotated[bool, typer.Option("--retry", help="Fly again what failed.")]


@app.command("run", cls=HelpCommand, epilog=RUN_EXAMPLES)
def run_command(
    out: Annotated[Path, typer.Option(help="Folder of the results.", show_default=False)],
    spec: Annotated[
        Path | None,
        typer.Argument(
            help="What to run (TOML); the options below change it.  [default: the paper's experiment]",
            show_default=False,
        ),
    ] = None,
    scenarios: Scenarios = None,
    planners: Planners = None,
    estimators: Estimators = None,
    seeds: Seeds = None,
    jobs: options.Jobs = 1,
    dask: Dask = None,
    retry: Retry = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Fly what is missing of a benchmark, and print what all of it tells.

    Each run that ends is kept at once: the same command goes on after Ctrl-C, and when it was killed. A run
    that fails is kept with the cause, and the others go on.
    """
    from wbf_mission.bench.spec import BenchSpec

    output = Output(as_json=json, quiet=quiet)
    given = _spec(scenarios, planners, estimators, seeds)
    wanted = BenchSpec.of(**given) if spec is None else BenchSpec.read(spec, given)
    rows, interrupted = _fly(output, wanted, out, jobs, dask, retry=retry)
    _print(output, rows, title=f"{out}: {len(rows)} of {len(wanted)} runs")
    return _exit_code(rows, interrupted=interrupted)


@app.command("compare", cls=HelpCommand, epilog=COMPARE_EXAMPLES)
def compare_command(
    mine: Annotated[str, typer.Argument(help="A planner or policy.", show_default=False)],
    against: Annotated[
        str, typer.Option(help="Planners and policies, separated by commas.", rich_help_panel=_RUN)
    ] = "greedy",
    out: Annotated[
        Path | None,
        typer.Option(help="Folder of the results.  [default: they are not kept]", show_default=False),
    ] = None,
    scenarios: Scenarios = "WBF/Miniberry-30-Sweep-v1",
    estimators: Estimators = "epidemic",
    seeds: Seeds = 10,
    jobs: options.Jobs = 1,
    dask: Dask = None,
    retry: Retry = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Tell whether a planner or policy is better than others, on the same environments.

    Differences of scores, positive where the first is better, with intervals of 95 %. With --out, only what
    is missing is flown.
    """
    from dataclasses import asdict

    from wbf_mission.bench.spec import BenchSpec
    from wbf_mission.bench.standings import compare, verdict

    output = Output(as_json=json, quiet=quiet)
    wanted = BenchSpec.of(**_spec(scenarios, f"{mine},{against}", estimators, seeds))
    rows, interrupted = _fly(output, wanted, out, jobs, dask, retry=retry)
    first, *others = (str(one) for one in wanted.planners)
    found = compare(rows, first, others)
    values = [
        asdict(one) | {"verdict": verdict(one.score), "final_verdict": verdict(one.final_score)}
        for one in found
    ]
    table = [
        [
            f"{one.scenario}, {one.estimator}",
            one.against,
            *_difference(one.score),
            verdict(one.score),
            *_difference(one.final_score),
            verdict(one.final_score),
            "-" if math.isnan(one.better) else f"{one.better:.0%} of {one.environments}",
        ]
        for one in found
    ]
    header = [
        "scenario, estimator",
        "against",
        "run",
        "95 %",
        "verdict",
        "end",
        "95 %",
        "verdict",
        "better on",
    ]
    output.table(values, header, table, title=f"{first}: difference of scores (positive: it is better)")
    _tell_failures(output, rows)
    return _exit_code(rows, interrupted=interrupted)


def _spec(
    scenarios: str | None, planners: str | None, estimators: str | None, seeds: int | None
) -> dict[str, Any]:
    """Return what `BenchSpec.of` takes, of options that are given."""
    return {
        "scenarios": None if scenarios is None else [one.strip() for one in scenarios.split(",")],
        "planners": None if planners is None else _choices(planners, "planner"),
        "estimators": None if estimators is None else _choices(estimators, "estimator"),
        "seeds": seeds,
    }


def _choices(text: str, what: str) -> list[Choice]:
    """Return what is named, separated by commas; also what stands in a file of the user's."""
    from wbf_mission.own_code import own_choice
    from wbf_mission.scenario.choice import choose, split_choices

    return [own_choice(one, what) or choose(one, what) for one in split_choices(text, what)]


def _fly(
    output: Output, wanted: BenchSpec, out: Path | None, jobs: int, dask: str | None, *, retry: bool
) -> tuple[list[BenchRow], bool]:
    """Fly what is missing; return the rows, and whether Ctrl-C came."""
    from wbf_mission.bench.benchmark import BenchmarkInterrupted, benchmark

    options.require_processes(jobs)
    try:
        with output.progress(_TOLD_EVERY_S) as progress:
            rows = benchmark(wanted, out=out, jobs=jobs, dask=dask, retry=retry, progress=progress)
    except BenchmarkInterrupted as stop:
        output.warn(f"{stop}" + ("; the same command goes on with them" if out else ""))
        return stop.rows, True
    return rows, False


def _exit_code(rows: Sequence[BenchRow], *, interrupted: bool) -> int:
    if interrupted:
        return ExitCode.INTERRUPTED
    return ExitCode.NOT_GOOD if any(row.error for row in rows) else ExitCode.GOOD


@app.command("report", cls=HelpCommand, epilog=REPORT_EXAMPLES)
def report_command(
    folder: Annotated[Path, typer.Argument(help="Folder of the results.", show_default=False)],
    out: Annotated[
        Path | None,
        typer.Option(
            help="Write a report into this folder: report.md, report.html and a picture for each scenario.",
            show_default=False,
        ),
    ] = None,
    json: options.Json = False,
) -> int:
    """Print what the results in a folder tell, also while they are made, or write it as a report."""
    from wbf_mission.bench.report import write_report
    from wbf_mission.bench.rows import read_rows
    from wbf_mission.bench.standings import apart
    from wbf_mission.results.storage import ResultError

    kept = read_rows(folder)
    rows = apart(kept)
    if not rows:
        msg = f"{folder}: holds no results of a benchmark; give the folder of 'bench run --out'"
        raise ResultError(msg)
    output = Output(as_json=json)
    if rows is not kept:
        output.warn(
            f"{folder}: rows of the same name were flown by different code, parameters or files;"
            " they are told apart by [digest]"
        )
    if out is not None:
        files = write_report(rows, out, title=f"Benchmark of {len(rows)} runs")
        output.note(f"written: {', '.join(str(one) for one in files)}")
    _print(output, rows, title=f"{folder}: {len(rows)} runs")
    return ExitCode.GOOD


@app.command("paper", cls=HelpCommand, epilog=PAPER_EXAMPLES)
def paper_command(
    out: Annotated[Path, typer.Option(help="Folder of the figures.", show_default=False)],
    spec: Annotated[
        Path | None,
        typer.Argument(
            help="What is compared, in one scenario (TOML); the options below change it."
            "  [default: the paper's experiment in five environments]",
            show_default=False,
        ),
    ] = None,
    only: Annotated[
        str, typer.Option(help="Which figures, separated by commas.")
    ] = "geometry,dynamics,comparison,cost",
    formats: Annotated[str, typer.Option("--format", help="Kinds of files: png, pdf or both.")] = "png",
    scenarios: Scenarios = None,
    planners: Planners = None,
    estimators: Estimators = None,
    seeds: Seeds = None,
    cost_farms: Annotated[
        str, typer.Option(help="Where costs are measured, separated by commas.", rich_help_panel=_RUN)
    ] = "miniberry-10,miniberry-30,miniberry-100,waterberry",
    jobs: options.Jobs = 1,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Make the figures of the paper: farms, fifteen days, planners with estimators, costs.

    With a page, paper.md and paper.html, of captions and numbers. Flights and costs are kept: a second call
    only draws.
    """
    from wbf_mission.bench.benchmark import BenchmarkInterrupted
    from wbf_mission.bench.paper.make import make_paper
    from wbf_mission.bench.spec import BenchSpec

    options.require_processes(jobs)
    output = Output(as_json=json, quiet=quiet)
    given = _spec(scenarios, planners, estimators, seeds)
    wanted = BenchSpec.of(**given | {"seeds": seeds or 5}) if spec is None else BenchSpec.read(spec, given)
    try:
        with output.progress() as progress:
            paper = make_paper(
                wanted,
                out,
                figures=_names(only),
                formats=_names(formats),
                jobs=jobs,
                cost_farms=_names(cost_farms),
                progress=progress,
            )
    except BenchmarkInterrupted as stop:
        output.warn(f"{stop}; the same command goes on with them")
        return ExitCode.INTERRUPTED
    _tell_failures(output, paper.rows)
    files = [str(one) for one in paper.files]
    output.result(
        {"pages": files[:2], "pictures": files[2:], "runs": len(paper.rows)},
        {"pages": "\n".join(files[:2]), "pictures": "\n".join(files[2:])},
    )
    return _exit_code(paper.rows, interrupted=False)


def _names(text: str) -> list[str]:
    return [one.strip().lower() for one in text.split(",") if one.strip()]


def _print(output: Output, rows: Sequence[BenchRow], title: str) -> None:
    """Print the standings, a table for each scenario, and why runs failed."""
    from dataclasses import asdict

    from wbf_mission.bench.report import standing_table
    from wbf_mission.bench.standings import standings

    found = standings(rows)
    failures = [row for row in rows if row.error is not None]
    if output.as_json:
        output.raw_json(
            {
                "standings": [asdict(one) for one in found],
                "failures": [{name: getattr(row, name) for name in _ROW} for row in failures],
            }
        )
        return
    for scenario in dict.fromkeys(one.scenario for one in found):
        told = f"{title}: {scenario}, scores over the run and at its end (0 is perfect)"
        table = standing_table(told, [one for one in found if one.scenario == scenario])
        output.table(None, list(table.header), [list(row) for row in table.rows], title=told)
    _tell_failures(output, rows)


def _tell_failures(output: Output, rows: Sequence[BenchRow]) -> None:
    """Warn of runs that failed, with the causes of the first."""
    failures = [row for row in rows if row.error is not None]
    for row in failures[:_FAILURES_SHOWN]:
        where = f"{row.scenario}, {row.planner}, {row.estimator}, seed {row.seed}"
        output.warn(f"{where}: {row.error}")
    bad = [row for row in rows if row.bad_answers and row.error is None]
    if bad:
        names = ", ".join(sorted({row.planner for row in bad}))
        told = "answers were not flown or came too late"
        output.warn(f"{names}: in {len(bad)} runs {told}; 'bench report --out' counts them")
    if len(failures) > _FAILURES_SHOWN:
        output.warn(f"{len(failures) - _FAILURES_SHOWN} more runs failed; 'bench report --json' names them")


def _difference(one: Interval) -> list[str]:
    return [
        "-" if math.isnan(one.mean) else f"{one.mean:+.4f}",
        "-" if math.isnan(one.low) else f"{one.low:+.3f} to {one.high:+.3f}",
    ]
