"""``wbf-mission bench paper``, a command of the group ``bench``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from wbf_mission.cli import options
from wbf_mission.cli.bench import RUN_PANEL, exit_code, selection, warn_of_failures
from wbf_mission.cli.command import Command, provided
from wbf_mission.cli.options import option
from wbf_mission.cli.output import Output
from wbf_mission.exit_codes import ExitCode

EXAMPLES = """
Examples
wbf-mission bench paper --out figures --jobs 2
wbf-mission bench paper --only comparison --seeds 20 --format png,pdf --out figures
wbf-mission bench paper missions/bench/paper.toml --only comparison --out beside-the-paper
wbf-mission bench paper --only dynamics --dynamics-farms miniberry-100,waterberry --seeds 1 --out days
"""


def _names(text: str) -> list[str]:
    return [one.strip().lower() for one in text.split(",") if one.strip()]


@options.speaks()
@options.gives("selected", selection)
def paper_command(
    output: Output,
    *,
    out: Annotated[Path, option("Folder of the figures.")],
    spec: Annotated[
        Path | None,
        typer.Argument(
            help="File (TOML) of planners and estimators to compare in one scenario; the options change it."
            "  [default: the paper's experiment in five environments]"
        ),
    ] = None,
    only: Annotated[str, option("Which figures, separated by commas.")] = "geometry,dynamics,comparison,cost",
    formats: Annotated[str, option("Kinds of files: png, pdf or both.", "--format")] = "png",
    selected: dict[str, Any],
    cost_farms: Annotated[
        str, option("Farms on which costs are measured, separated by commas.", panel=RUN_PANEL)
    ] = "miniberry-10,miniberry-30,miniberry-100,waterberry",
    dynamics_farms: Annotated[
        str,
        option(
            "Farms whose fifteen days are drawn, separated by commas.  [default: the scenario's farm]",
            panel=RUN_PANEL,
        ),
    ] = "",
    jobs: options.Jobs = 1,
) -> int:
    """Draw the paper's figures: farm maps, fifteen days, planners with estimators, computing costs.

    The captions and numbers are written to paper.md and paper.html. Flights and costs are kept, so that a
    second call only draws.
    """
    from wbf_mission.addons.paper.make import make_paper
    from wbf_mission.bench.benchmark import BenchmarkInterrupted
    from wbf_mission.bench.spec import BenchSpec

    options.require_processes(jobs)
    write_page = provided("bench")
    paper = selected | {"seeds": selected["seeds"] or 5}
    wanted = BenchSpec.of(**paper) if spec is None else BenchSpec.read(spec, selected)
    try:
        with output.progress() as progress:
            made = make_paper(
                wanted,
                out,
                figures=_names(only),
                formats=_names(formats),
                jobs=jobs,
                cost_farms=_names(cost_farms),
                dynamics_farms=_names(dynamics_farms),
                progress=progress,
            )
    except BenchmarkInterrupted as stop:
        output.warn(f"{stop}; repeat the command to fly the other runs")
        return ExitCode.INTERRUPTED
    warn_of_failures(output, made.rows)
    write_page(made.files[0].with_suffix(".html"), made.page, out)
    pages = [str(made.files[0].with_suffix(end)) for end in (".md", ".html")]
    pictures = [str(file) for file in made.files[1:]]
    output.result(
        {"pages": pages, "pictures": pictures, "runs": len(made.rows)},
        {"pages": "\n".join(pages), "pictures": "\n".join(pictures)},
    )
    return exit_code(made.rows, interrupted=False)


COMMAND = Command(paper_command, EXAMPLES)
