"""Standings printed by the commands of ``bench``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

from wbf_mission.addons.base.page import standing_table
from wbf_mission.addons.base.standings import apart, builds_in_words, scored, standings
from wbf_mission.bench.rows import BenchRow
from wbf_mission.cli.bench import warn_of_failures
from wbf_mission.cli.output import Output

_ROW = ("key", "scenario", "planner", "estimator", "seed", "error")


def print_standings(output: Output, rows: Sequence[BenchRow], title: str) -> None:
    """Print a table of standings for each scenario, and the causes of failed runs."""
    warn_of_uncounted(output, rows)
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
    warn_of_failures(output, rows)


def warn_of_uncounted(output: Output, rows: Sequence[BenchRow]) -> None:
    """Warn if rows are of several versions, or some environments do not count."""
    builds = builds_in_words(rows)
    if builds:
        output.warn(f"{builds}; tables separate them where they differ, and 'bench report --out' lists them")
    for group in scored(apart(rows)):
        if group.left_out:
            output.warn(f"{group.scenario}: {group.environments_in_words()}")
