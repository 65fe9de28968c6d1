"""``wbf-mission bench``: many comparable runs."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from geo.imports import load_named
from wbf_mission.cli import bench_output, options
from wbf_mission.cli.help import HelpCommand, HelpGroup
from wbf_mission.cli.options import option
from wbf_mission.cli.output import Output
from wbf_mission.cli.pages import bench_page, bench_report
from wbf_mission.exit_codes import ExitCode

if TYPE_CHECKING:
    from wbf_mission.bench.rows import BenchRow
    from wbf_mission.bench.spec import BenchSpec
    from wbf_mission.scenario import Choice, Scenario

LIST_EXAMPLES = """
Examples
wbf-mission bench list
wbf-mission bench list --families
wbf-mission fly --scenario WBF/Miniberry-30-v1 --planner lawnmower
"""
SHOW_EXAMPLES = """
Examples
wbf-mission bench show WBF/Miniberry-30-Sweep-v1
"""
RUN_EXAMPLES = """
Examples
wbf-mission bench run --out results --jobs 2
wbf-mission bench run missions/bench/three-farms.toml --seeds 2 --out results
wbf-mission bench run --scenarios WBF/Miniberry-10-v1 --planners spiral,greedy --estimators gp --out results
wbf-mission bench run --family smooth --seeds 10 --out results/smooth
"""
REPORT_EXAMPLES = """
Examples
wbf-mission bench report results
wbf-mission bench report results --out report
"""

app = typer.Typer(cls=HelpGroup, help="Fly many runs that can be compared.")
RUN_PANEL = "What to run"
ROUNDS = "wbf_mission.rounds"
"""Group of entry points; ``sealed`` adds the seeds in a round's file to arguments of `BenchSpec.of`."""
_TOLD_EVERY_S = 60.0


@app.command("list", cls=HelpCommand, epilog=LIST_EXAMPLES)
@options.speaks(quiet=False)
def list_command(
    output: Output,
    families: Annotated[
        bool,
        option(
            "List the families of scenarios, with their differences from the benchmark's own world.",
            "--families",
        ),
    ] = False,
) -> int:
    """List the scenarios of the catalogue, by which results can be compared.

    The meaning of an id never changes; a changed scenario gets a new version.
    """
    from msgspec import to_builtins

    from wbf_mission import scenario as known

    if families:
        found = known.families()
        rows = [[family.name, family.about, family.at_home, "\n".join(family.scenarios)] for family in found]
        header = ["family", "what differs", "at home", "scenarios"]
        output.table(to_builtins(found), header, rows, left=True)
        return ExitCode.GOOD
    values = [
        {
            "scenario": name,
            "about": known.about_scenario(name),
            "family": None if (family := known.family_of(name)) is None else family.name,
            "meaning": _meaning(known.load_scenario(name)),
        }
        for name in known.scenario_ids()
    ]
    rows = [[str(listed["scenario"]), str(listed["family"] or ""), str(listed["about"])] for listed in values]
    output.table(values, ["scenario", "family", "what it is"], rows, left=True)
    return ExitCode.GOOD


def _meaning(scenario: Scenario) -> str | None:
    """Return the digest of a scenario's meaning; None if its kind of vehicle is not installed."""
    from sim_vehicle.errors import VehicleError
    from wbf_mission.bench.digests import meaning_of

    try:
        return meaning_of(scenario)
    except VehicleError:
        return None


@app.command("show", cls=HelpCommand, epilog=SHOW_EXAMPLES)
@options.speaks(quiet=False)
def show_command(
    output: Output, scenario: Annotated[str, typer.Argument(help="An id (see 'bench list') or a file.")]
) -> int:
    """Show a scenario: its farm, its scored fields and times, and its options that are not at defaults."""
    from msgspec import to_builtins

    from wbf_mission.bench.cards import card_of
    from wbf_mission.scenario import load_scenario

    card = card_of(scenario, load_scenario(scenario))
    output.result(to_builtins(card), card.entries())
    return ExitCode.GOOD


def choices(text: str, what: str) -> list[Choice]:
    """Return comma-separated planners, policies or estimators, by name or as FILE.py:NAME."""
    from wbf_mission.own_code import own_choice
    from wbf_mission.scenario.choice import choose, split_choices

    return [own_choice(name, what) or choose(name, what) for name in split_choices(text, what)]


def selection(
    scenarios: Annotated[
        str | None, option("Ids (see 'bench list') or files, separated by commas.", panel=RUN_PANEL)
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
            "Number of environments, from seed 0 on, or a list of seeds: 100..139, or 5,7,100..139.",
            panel=RUN_PANEL,
        ),
    ] = None,
) -> dict[str, Any]:
    """Return the given options as arguments of `BenchSpec.of`."""
    return {
        "scenarios": None if scenarios is None else [name.strip() for name in scenarios.split(",")],
        "planners": None if planners is None else choices(planners, "planner"),
        "estimators": None if estimators is None else choices(estimators, "estimator"),
        "seeds": seeds,
    }


@dataclass(frozen=True, slots=True)
class Flying:
    """Options of the execution of runs."""

    jobs: options.Jobs = 1
    dask: Annotated[
        str | None,
        option(
            "Fly on the workers of a Dask scheduler, such as tcp://10.0.0.1:8786, or of one made here:"
            " local (with --jobs).",
            metavar="ADDRESS",
        ),
    ] = None
    retry: Annotated[bool, option("Repeat failed runs.", "--retry")] = False

    def rows(
        self, output: Output, wanted: BenchSpec, out: Path | None, context: typer.Context
    ) -> tuple[list[BenchRow], bool]:
        """Fly the missing runs; return all rows, and whether Ctrl-C came."""
        from wbf_mission.bench.benchmark import BenchmarkInterrupted, benchmark

        options.require_processes(self.jobs)
        try:
            with output.progress(_TOLD_EVERY_S) as progress:
                how: dict[str, Any] = {"jobs": self.jobs, "dask": self.dask, "retry": self.retry}
                how["command"] = shlex.join(["wbf-mission", *context.obj])
                return benchmark(wanted, out=out, progress=progress, **how), False
        except BenchmarkInterrupted as stop:
            output.warn(f"{stop}" + ("; the same command flies the others" if out else ""))
            return stop.rows, True


@app.command("run", cls=HelpCommand, epilog=RUN_EXAMPLES)
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
            "Family of scenarios (see 'bench list --families'), flown with its planners and estimators; the"
            " options below override them.",
            panel=RUN_PANEL,
        ),
    ] = None,
    sealed: Annotated[
        Path | None,
        option("Secret of a round ('bench seal'), to fly the round's environments.", panel=RUN_PANEL),
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
            raise ScenarioError(f"--family {family} and {spec}: give one of them")
        of = get_family(family)
        whole = {"scenarios": of.scenarios, "planners": of.planners, "estimators": of.estimators}
        selected |= {key: list(names) for key, names in whole.items() if selected[key] is None}
    if sealed is not None:
        of_round = load_named(ROUNDS, "sealed", "opens rounds that are", "rounds that are", ScenarioError)
        selected = of_round(selected, sealed)
    wanted = BenchSpec.of(**selected) if spec is None else BenchSpec.read(spec, selected)
    rows, interrupted = flying.rows(output, wanted, out, context)
    bench_output.print_standings(output, rows, title=f"{out}: {len(rows)} of {len(wanted)} runs")
    return bench_output.exit_code(rows, interrupted=interrupted)


@app.command("report", cls=HelpCommand, epilog=REPORT_EXAMPLES)
@options.speaks(quiet=False)
def report_command(
    output: Output,
    folder: Annotated[Path, typer.Argument(help="Folder of the results.")],
    out: Annotated[
        Path | None,
        option("Write a report into this folder: report.md, report.html and a picture for each scenario."),
    ] = None,
) -> int:
    """Print the standings of the results in a folder, also during a benchmark, or write a report."""
    from wbf_mission.bench.requests import read_asked
    from wbf_mission.bench.rows import read_rows
    from wbf_mission.results.storage import ResultError

    rows = read_rows(folder)
    if not rows:
        msg = f"{folder}: holds no results of a benchmark; give the folder of 'bench run --out'"
        raise ResultError(msg)
    if out is not None:
        write_page, report_page = bench_page(), bench_report()
        page = report_page(rows, out, title=f"Benchmark of {len(rows)} runs", asked=read_asked(folder))
        page.write(out / "report.md")
        write_page(out / "report.html", page, out, rows)
        pictures = [picture.file for section in page.sections for picture in section.pictures]
        files = ["report.md", "report.html", *pictures]
        output.note(f"written: {', '.join(str(out / file) for file in files)}")
    bench_output.print_standings(output, rows, title=f"{folder}: {len(rows)} runs")
    return ExitCode.GOOD
