"""Which method leads in each family of scenarios, and where ours does not, from rows of 'bench run'.

    python benchmarks/families.py FOLDER_OR_PACK... [--out FILE.md]

Sources are folders of ``wbf-mission bench run --family NAME --out FOLDER`` and packs of ``bench submit``.
Ours are the policies greedy and rolling-horizon with the estimator epidemic, with gp where epidemic does not
know the fields; the better of the two stands for them. Both it and the leader are chosen by the mean score on
the same environments as the differences are taken on, so a small lead is easily luck: the interval of the
paired difference tells whether it is.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from wbf_mission.bench.intervals import Interval, verdict
from wbf_mission.bench.rows import BenchRow, read_rows
from wbf_mission.bench.standings import Standing, standings
from wbf_mission.bench.submission import read_pack
from wbf_mission.scenario import Family, families

POLICIES = ("greedy", "rolling-horizon")


class Found(NamedTuple):
    """What the rows of a scenario tell, the best method first."""

    scenario: str
    table: list[Standing]
    ours: Standing | None

    @property
    def led_by_us(self) -> bool:
        """Whether ours has the best mean."""
        return self.ours is self.table[0]


def rows_in(sources: Sequence[Path]) -> list[BenchRow]:
    """Return the rows of folders and packs, of equal ones the first."""
    rows: dict[str, BenchRow] = {}
    for source in sources:
        for row in read_rows(source) if source.is_dir() else read_pack(source).rows:
            rows.setdefault(row.key, row)
    return list(rows.values())


def found_in(rows: Sequence[BenchRow], scenario: str, family: Family) -> Found | None:
    """Return what the rows of a scenario tell; None if there are none that count."""
    here = standings([row for row in rows if row.scenario == scenario])
    table = [one for one in here if math.isfinite(one.score.mean)]
    estimator = "epidemic" if "epidemic" in family.estimators else "gp"
    ours = next((one for one in table if one.planner in POLICIES and one.estimator == estimator), None)
    return Found(scenario, table, ours) if table else None


def markdown(rows: Sequence[BenchRow]) -> Iterator[str]:
    """Yield the lines of the page."""
    behind: list[Found] = []
    for family in families():
        found = [one for name in family.scenarios if (one := found_in(rows, name, family)) is not None]
        if not found:
            continue
        behind += [one for one in found if not one.led_by_us]
        yield from (f"## {family.title}", "", family.about, f"Expected at home: {family.at_home}.", "")
        yield "| scenario | environments | leads | score | ours | score | ours behind, in pairs | |"
        yield "|---|---|---|---|---|---|---|---|"
        yield from (_line(one) for one in found)
        yield from ("", f"Mean ranks over the scenarios: {_ranks(found)}.", "")
    yield from ("## Where ours does not lead", "")
    if not behind:
        yield "It leads in every scenario that was flown."
    for one in behind:
        by, told = _behind(one)
        ours = "ours was not flown" if one.ours is None else f"{_name(one.ours)} is behind by {by}"
        yield f"- {one.scenario}: {_name(one.table[0])} leads; {ours} ({told})."


def _line(one: Found) -> str:
    best = one.table[0]
    failed = sum(each.failed for each in one.table)
    many = f"{best.environments}, {failed} runs failed" if failed else str(best.environments)
    ours = ("not flown", "") if one.ours is None else (_name(one.ours), _told(one.ours.score))
    cells = (one.scenario, many, _name(best), _told(best.score), *ours, *_behind(one))
    return f"| {' | '.join(cells)} |"


def _behind(one: Found) -> tuple[str, str]:
    """Return by how much ours is behind the leader, and what that tells."""
    if one.ours is None or one.led_by_us:
        return "", "nothing to compare" if one.ours is None else "ours leads"
    told = verdict(one.ours.behind)
    return _told(one.ours.behind), "ours is worse" if told == "better" else told


def _ranks(found: Sequence[Found]) -> str:
    ranks: dict[str, list[float]] = {}
    for one in found:
        for each in one.table:
            ranks.setdefault(_name(each), []).append(each.rank)
    means = {name: sum(values) / len(values) for name, values in ranks.items()}
    return "; ".join(f"{name} {means[name]:.1f}" for name in sorted(means, key=lambda name: means[name]))


def _name(one: Standing) -> str:
    return f"{one.planner}, {one.estimator}"


def _told(one: Interval) -> str:
    text = f"{one.mean:.4f}" if math.isfinite(one.mean) else "-"
    return text if not math.isfinite(one.low) else f"{text} ({one.low:.4f} to {one.high:.4f})"


def main() -> None:
    """Print the page, or write it."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    options.add_argument("sources", nargs="+", type=Path)
    options.add_argument("--out", type=Path)
    given = options.parse_args()
    text = "\n".join(markdown(rows_in(given.sources))) + "\n"
    if given.out is None:
        sys.stdout.write(text)
    else:
        given.out.write_text(text)


if __name__ == "__main__":
    main()
