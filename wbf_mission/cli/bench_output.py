"""Output of the ``bench`` commands: standings, counted environments and failures."""

from __future__ import annotations

from typing import TYPE_CHECKING

from wbf_mission.cli.output import Output
from wbf_mission.exit_codes import ExitCode

if TYPE_CHECKING:
    from collections.abc import Sequence

    from wbf_mission.bench.rows import BenchRow

_FAILURES_SHOWN = 5
_ROW = ("key", "scenario", "planner", "estimator", "seed", "error")


def print_standings(output: Output, rows: Sequence[BenchRow], title: str) -> None:
    """Print a table of standings for each scenario, and the causes of failed runs."""
    from dataclasses import asdict

    from wbf_mission.bench.standings import standings
    from wbf_mission.bench.tables import standing_table

    tell_what_counts(output, rows)
    found = standings(rows)
    failures = [row for row in rows if row.error is not None]
    if output.as_json:
        output.raw_json(
            {
                "standings": [asdict(standing) for standing in found],
                "failures": [{name: getattr(row, name) for name in _ROW} for row in failures],
            }
        )
        return
    for scenario in dict.fromkeys(standing.scenario for standing in found):
        heading = f"{title}: {scenario}, scores over the run and at its end (0 is perfect)"
        table = standing_table(heading, [standing for standing in found if standing.scenario == scenario])
        output.table(None, list(table.header), [list(row) for row in table.rows], title=heading)
    tell_failures(output, rows)


def tell_what_counts(output: Output, rows: Sequence[BenchRow]) -> None:
    """Warn if rows are of several versions, or some environments do not count."""
    from wbf_mission.bench.environments import scored
    from wbf_mission.bench.versions import apart, builds_in_words

    builds = builds_in_words(rows)
    if builds:
        output.warn(f"{builds}; tables separate them where they differ, and 'bench report --out' lists them")
    for group in scored(apart(rows)):
        if group.left_out:
            output.warn(f"{group.scenario}: {group.environments_in_words()}")


def tell_failures(output: Output, rows: Sequence[BenchRow]) -> None:
    """Warn of failed runs, with the causes of the first `_FAILURES_SHOWN`."""
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
    """Return the exit code of a command that flew `rows`."""
    if interrupted:
        return ExitCode.INTERRUPTED
    return ExitCode.NOT_GOOD if any(row.error for row in rows) else ExitCode.GOOD
