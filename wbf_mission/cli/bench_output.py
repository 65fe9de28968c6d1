"""What the commands of the group ``bench`` print of rows: standings, what counts, and what failed."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from wbf_mission.cli.output import Output
from wbf_mission.exit_codes import ExitCode

if TYPE_CHECKING:
    from collections.abc import Sequence

    from wbf_mission.bench.intervals import Interval
    from wbf_mission.bench.rows import BenchRow

_FAILURES_SHOWN = 5
_ROW = ("key", "scenario", "planner", "estimator", "seed", "error")


def print_standings(output: Output, rows: Sequence[BenchRow], title: str) -> None:
    """Print the standings, a table for each scenario, and why runs failed."""
    from dataclasses import asdict

    from wbf_mission.bench.report import standing_table
    from wbf_mission.bench.standings import standings

    tell_what_counts(output, rows)
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
    tell_failures(output, rows)


def tell_what_counts(output: Output, rows: Sequence[BenchRow]) -> None:
    """Warn of rows of several versions, and of environments that do not count."""
    from wbf_mission.bench.environments import scored
    from wbf_mission.bench.versions import apart, builds_in_words

    builds = builds_in_words(rows)
    if builds:
        output.warn(f"{builds}; tables tell apart what differs, and 'bench report --out' what was run")
    for group in scored(apart(rows)):
        if group.left_out:
            output.warn(f"{group.scenario}: {group.environments_in_words()}")


def tell_failures(output: Output, rows: Sequence[BenchRow]) -> None:
    """Warn of runs that failed, with the causes of the first."""
    failures = [row for row in rows if row.error is not None]
    for row in failures[:_FAILURES_SHOWN]:
        output.warn(f"{row.named}: {row.error}")
    bad = [row for row in rows if row.bad_answers and row.error is None]
    if bad:
        names = ", ".join(sorted({row.planner for row in bad}))
        told = "answers were not flown or came too late"
        output.warn(f"{names}: in {len(bad)} runs {told}; 'bench report --out' counts them")
    if len(failures) > _FAILURES_SHOWN:
        output.warn(f"{len(failures) - _FAILURES_SHOWN} more runs failed; 'bench report --json' names them")


def difference(one: Interval) -> list[str]:
    """Return a difference of scores and its interval, for a table."""
    return [
        "-" if math.isnan(one.mean) else f"{one.mean:+.4f}",
        "-" if math.isnan(one.low) else f"{one.low:+.3f} to {one.high:+.3f}",
    ]


def exit_code(rows: Sequence[BenchRow], *, interrupted: bool) -> int:
    """Return the exit code of a command that flew these rows."""
    if interrupted:
        return ExitCode.INTERRUPTED
    return ExitCode.NOT_GOOD if any(row.error for row in rows) else ExitCode.GOOD
