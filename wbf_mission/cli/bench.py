"""The command ``wbf-mission bench run``, and output that all ``bench`` commands use."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from geo.imports import entry_named, load_entry, load_named
from wbf_mission.cli import options
from wbf_mission.cli.options import option
from wbf_mission.cli.output import Output
from wbf_mission.exit_codes import ExitCode

if TYPE_CHECKING:
    from collections.abc import Sequence

    from wbf_mission.bench.rows import BenchRow
    from wbf_mission.bench.spec import BenchSpec
    from wbf_mission.scenario import Choice

_FAILURES_SHOWN = 5


def _print_standings(output: Output, rows: Sequence[BenchRow], title: str) -> None:
    """Print the standings, or the numbers of rows and failed runs if no add-on makes standings."""
    from wbf_mission.cli.command import PAGES

    entry = entry_named(PAGES, "bench.standings")
    if entry is not None:
        load_entry(entry, "the standings", options.TargetError)(output, rows, title)
        return
    failed = sum(row.error is not None for row in rows)
    output.result({"rows": len(rows), "failed": failed}, title=title)
    warn_of_failures(output, rows)


def warn_of_failures(output: Output, rows: Sequence[BenchRow]) -> None:
    """Warn of failed runs; name the causes of the first `_FAILURES_SHOWN`."""
    failures = [row for row in rows if row.error is not None]
    for row in failures[:_FAILURES_SHOWN]:
        output.warn(f"{row.named}: {row.error}")
    bad = [row for row in rows if row.bad_answers and row.error is None]
    if bad:
        names = ", ".join(sorted({row.planner for row in bad}))
        fault = "answers were not flown or came too late"
        output.warn(f"{names}: in {len(bad)} runs {fault}; 'bench report --out' counts them")
    if len(failures) > _FAILURES_SHOWN:
        output.warn(f"{len(failures) - _FAILURES_SHOWN} more runs failed; 'bench report --json' names them")


def exit_code(rows: Sequence[BenchRow], *, interrupted: bool) -> int:
    """Return the exit code of a command that flew the runs of `rows`."""
    if interrupted:
        return ExitCode.INTERRUPTED
    return ExitCode.NOT_GOOD if any(row.error for row in rows) else ExitCode.GOOD


RUN_EXAMPLES = """
Examples
wbf-mission bench run --out results --jobs 2
wbf-mission bench run missions/bench/three-farms.toml --seeds 2 --out results
wbf-mission bench run --scenarios WBF/Miniberry-10-v1 --planners spiral,greedy --estimators gp --out results
wbf-mission bench run --family smooth --seeds 10 --out results/smooth
"""
RUN_PANEL = "What to run"
ROUNDS = "wbf_mission.rounds"
"""Group of entry points. ``sealed`` adds the seeds of a round's file to the arguments of `BenchSpec.of`."""
_TOLD_EVERY_S = 60.0


def choices(text: str, what: str) -> list[Choice]:
    """Parse comma-separated planners, policies or estimators, each a name or FILE.py:NAME."""
    from wbf_mission.own_code import own_choice
    from wbf_mission.scenario.choice import choose, split_choices

    return [own_choice(name, what) or choose(name, what) for name in split_choices(text, what)]


def selection(
    scenarios: Annotated[
        str | None, option("Scenarios, comma-separated: ids (see 'bench list') or files.", panel=RUN_PANEL)
    ] = None,
    planners: Annotated[
        str | None,
        option(
            "Planners and policies, separated by commas, such as lawnmower:direction=0.3,greedy.",
            panel=RUN_PANEL,
        ),
    ] = None,
    estimators: Annotated[
        str | None,
        option("Estimators, separated by commas, such as gp:learn_from=model,epidemic.", panel=RUN_PANEL),
    ] = None,
    seeds: Annotated[
        str | None,
        option(
            "Number of seeds, counted from 0, or a list of seeds, such as 100..139 or 5,7,100..139.",
            panel=RUN_PANEL,
        ),
    ] = None,
) -> dict[str, Any]:
    """Return the options of the command line as arguments for `BenchSpec.of`."""
    return {
        "scenarios": None if scenarios is None else [name.strip() for name in scenarios.split(",")],
        "planners": None if planners is None else choices(planners, "planner"),
        "estimators": None if estimators is None else choices(estimators, "estimator"),
        "seeds": seeds,
    }


@dataclass(frozen=True, slots=True)
class Flying:
    """Options for the execution of runs."""

    jobs: options.Jobs = 1
    dask: Annotated[
        str | None,
        option(
            "Dask scheduler whose workers fly, such as tcp://10.0.0.1:8786; local starts a scheduler"
            " here (with --jobs).",
            metavar="ADDRESS",
        ),
    ] = None
    retry: Annotated[bool, option("Repeat failed runs.", "--retry")] = False

    def rows(
        self, output: Output, wanted: BenchSpec, out: Path | None, context: typer.Context
    ) -> tuple[list[BenchRow], bool]:
        """Fly the missing runs; return all rows, and whether Ctrl-C interrupted the command."""
        from wbf_mission.bench.benchmark import BenchmarkInterrupted, benchmark

        options.require_processes(self.jobs)
        try:
            with output.progress(_TOLD_EVERY_S) as progress:
                how: dict[str, Any] = {"jobs": self.jobs, "dask": self.dask, "retry": self.retry}
                how["command"] = shlex.join(["wbf-mission", *context.obj])
                return benchmark(wanted, out=out, progress=progress, **how), False
        except BenchmarkInterrupted as stop:
            output.warn(f"{stop}" + ("; the same command flies the remaining runs" if out else ""))
            return stop.rows, True


@options.speaks()
@options.gives("selected", selection)
@options.gives("flying", Flying)
def run_command(
    output: Output,
    *,
    context: typer.Context,
    out: Annotated[Path, option("Folder of the results.")],
    spec: Annotated[
        Path | None,
        typer.Argument(
            help="Specification (TOML); the options below change it.  [default: the paper's experiment]"
        ),
    ] = None,
    family: Annotated[
        str | None,
        option(
            "Family of scenarios (see 'bench list --families'), flown with the family's planners and"
            " estimators unless the options below name others.",
            panel=RUN_PANEL,
        ),
    ] = None,
    sealed: Annotated[
        Path | None,
        option("Secret file of a round ('bench seal'); flies the round's environments.", panel=RUN_PANEL),
    ] = None,
    selected: dict[str, Any],
    flying: Flying,
) -> int:
    """Fly the missing runs of a benchmark, and print the standings.

    Each row is stored when its run ends, so the same command continues after Ctrl-C or a kill. A failed run
    is stored with its cause, and the other runs continue.
    """
    from wbf_mission.bench.spec import BenchSpec
    from wbf_mission.scenario import ScenarioError, get_family

    if family is not None:
        if spec is not None:
            raise ScenarioError(f"--family {family} and {spec}: give only one of the two")
        of = get_family(family)
        whole = {"scenarios": of.scenarios, "planners": of.planners, "estimators": of.estimators}
        selected |= {key: list(names) for key, names in whole.items() if selected[key] is None}
    if sealed is not None:
        of_round = load_named(ROUNDS, "sealed", "opens rounds that are", "rounds that are", ScenarioError)
        selected = of_round(selected, sealed)
    wanted = BenchSpec.of(**selected) if spec is None else BenchSpec.read(spec, selected)
    rows, interrupted = flying.rows(output, wanted, out, context)
    _print_standings(output, rows, title=f"{out}: {len(rows)} of {len(wanted)} runs")
    return exit_code(rows, interrupted=interrupted)
