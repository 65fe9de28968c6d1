"""``wbf-mission bench compare``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

import typer

from wbf_mission.cli import options
from wbf_mission.cli.bench import (
    RUN_PANEL,
    Flying,
    choices,
    exit_code,
    selection,
    warn_of_failures,
)
from wbf_mission.cli.command import Command
from wbf_mission.cli.options import option
from wbf_mission.cli.output import Output

EXAMPLES = """
Examples
wbf-mission bench compare rolling-horizon --against greedy,spiral
wbf-mission bench compare greedy:least_weight=0.35 --against greedy --seeds 40 --jobs 2 --out results
"""
_COMPARED = {"scenarios": "WBF/Miniberry-30-Sweep-v1", "estimators": "epidemic", "seeds": "10"}
_OPTIONS = options.taken_by(selection)


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

    Prints differences of scores with 95 % intervals, positive if the first is better. With --out, only
    missing runs are flown.
    """
    from dataclasses import asdict

    from wbf_mission.addons.boards.comparison import compare, difference, verdict
    from wbf_mission.addons.boards.printed import warn_of_uncounted
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
    output.table(values, header, table, title=f"{first}: difference of scores (positive: it is better)")
    warn_of_uncounted(output, rows)
    warn_of_failures(output, rows)
    return exit_code(rows, interrupted=interrupted)


COMPARE = Command(compare_command, EXAMPLES)
