"""Leading method in each family of scenarios, and calibration of the estimators.

    python benchmarks/families.py FOLDER_OR_PACK... [--out FILE.md]

Sources are folders of ``wbf-mission bench run --family NAME --out FOLDER`` and packs of ``bench submit``.
"Ours" is the better of the policies greedy and rolling-horizon with the estimator epidemic, or with gp for
fields without an epidemic model. Both methods are chosen by these mean scores, so a small lead may be chance.
"""

from __future__ import annotations

import math
import statistics
import sys
import textwrap
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from common import options_of

from wbf_mission.addons.base.intervals import Interval
from wbf_mission.addons.base.standings import Standing, standings
from wbf_mission.addons.boards.comparison import verdict
from wbf_mission.addons.boards.submission import read_pack
from wbf_mission.bench.rows import BenchRow, read_rows
from wbf_mission.scenario import Family, families

POLICIES = ("greedy", "rolling-horizon")
_HELD, _SICK_HELD, _HEALTHY_HELD = "_held", "_sick_held", "_healthy_held"
_HEAD = """# Families of scenarios, measured

This page names the leading method in worlds, fields, sensors and farms on which `epidemic` was not trained
([families](../benchmark.md#families)). "Ours" is the better of `greedy` and `rolling-horizon` with
`epidemic`, or with `gp` for fields that `epidemic` does not know. Scores are over the run (0 is perfect),
with 95 % intervals; differences are over pairs. "Ours" and the best other method are chosen by these means,
so small leads may be chance. The rows are the frozen baselines; `bench report` prints all ranks:

```text
python benchmarks/families.py results/0.1.0/*.zip --out docs/evidence/families.md
```
"""


class Found(NamedTuple):
    """Standings of the methods in a scenario, the best method first."""

    scenario: str
    table: list[Standing]
    ours: Standing | None
    other: Standing | None
    """Best method other than ours."""

    @property
    def led_by_us(self) -> bool:
        """Whether our method has the best mean score."""
        return self.ours is self.table[0]

    @property
    def ahead(self) -> Interval | None:
        """Paired difference between our method and the best other method; positive if ours leads."""
        if self.ours is None or self.other is None:
            return None
        if self.led_by_us:
            return self.other.behind
        by = self.ours.behind
        return Interval(-by.mean, -by.high, -by.low)


def rows_in(sources: Sequence[Path]) -> list[BenchRow]:
    """Return the rows of folders and packs without duplicates."""
    rows: dict[str, BenchRow] = {}
    for source in sources:
        for row in read_rows(source) if source.is_dir() else read_pack(source).rows:
            rows.setdefault(row.key, row)
    return list(rows.values())


def found_in(rows: Sequence[BenchRow], scenario: str, family: Family) -> Found | None:
    """Return the standings in a scenario; None without valid rows."""
    here = standings([row for row in rows if row.scenario == scenario])
    table = [one for one in here if math.isfinite(one.score.mean)]
    estimator = "epidemic" if "epidemic" in family.estimators else "gp"

    def is_ours(one: Standing) -> bool:
        return one.planner in POLICIES and one.estimator == estimator

    ours = next((one for one in table if is_ours(one)), None)
    other = next((one for one in table if not is_ours(one)), None)
    return Found(scenario, table, ours, other) if table else None


def markdown(rows: Sequence[BenchRow]) -> Iterator[str]:
    """Yield the lines of the page."""
    every = [
        (family, found)
        for family in families()
        for name in family.scenarios
        if (found := found_in(rows, name, family)) is not None
    ]
    yield from (_HEAD, _wrapped(_in_short([found for _, found in every])), "")
    yield "| family | scenario | environments | ours | score | best other | score | ours ahead, in pairs | |"
    yield "|---|---|---|---|---|---|---|---|---|"
    yield from (f"| `{family.name}` {_line(found)}" for family, found in every)
    yield from _calibration(rows)


def _in_short(every: Sequence[Found]) -> str:
    """Return a summary: the number of scenarios in which ours leads, and leads by more than chance."""
    verdicts = {one.scenario: _verdict(one) for one in every}
    leads = sum(one.led_by_us for one in every)
    better = sum(text == "better" for text in verdicts.values())
    worse = [name for name, text in verdicts.items() if text == "worse"]
    where = f"in {len(worse)} ({', '.join(worse)})" if worse else "in no scenario"
    return (
        f"In short: our method has the best mean in {leads} of {len(every)} scenarios, in {better} by more"
        f" than chance; it is behind by more than chance {where}."
    )


def _calibration(rows: Sequence[BenchRow]) -> Iterator[str]:
    """Yield the calibration table of the final estimates on unobserved cells."""
    yield from ("", "## Calibration", "")
    yield _wrapped(
        "The table is for unobserved cells at the end of a run (means over scenarios, planners and"
        " environments). For a disease, it has the fraction of sick plants that the estimate states as"
        " possibly sick (nominal: 90 %), and in brackets the same fraction of healthy plants; for other"
        " fields, the fraction of cells within the 90 % interval."
    )
    every = families()
    shown = list(dict.fromkeys(name for family in every for name in family.estimators))
    held = {
        family.name: [
            _held([row for row in rows if row.scenario in family.scenarios and row.estimator == name])
            for name in shown
        ]
        for family in every
    }
    measured = {name: cells for name, cells in held.items() if any(cells)}
    columns = [k for k in range(len(shown)) if any(cells[k] for cells in measured.values())]
    head = " | ".join(f"`{shown[k]}`" for k in columns)
    yield from ("", f"| family | {head} |", "|---" * (len(columns) + 1) + "|")
    for name, cells in measured.items():
        yield f"| `{name}` | {' | '.join(cells[k] for k in columns)} |"


def _held(rows: Sequence[BenchRow]) -> str:
    """Return the mean calibration of rows as text; empty if no row has one."""
    found = [row.calibration for row in rows]
    held = {
        name: statistics.fmean(values[name] for values in found if name in values)
        for name in dict.fromkeys(key for values in found for key in values)
    }
    parts = []
    for name, value in held.items():
        if name.endswith(_SICK_HELD):
            healthy = held[name.replace(_SICK_HELD, _HEALTHY_HELD)]
            parts.append(f"{name.removesuffix(_SICK_HELD)} {value:.0%} ({healthy:.0%})")
        elif name.endswith(_HELD) and not name.endswith(_HEALTHY_HELD):
            parts.append(f"{name.removesuffix(_HELD)} {value:.0%}")
    return ", ".join(parts)


def _line(one: Found) -> str:
    first = one.table[0]
    failed = sum(each.failed for each in one.table)
    many = f"{first.environments}, {failed} runs failed" if failed else str(first.environments)
    cells = [one.scenario, many]
    for each in (one.ours, one.other):
        cells += ["", ""] if each is None else [f"{each.planner}, {each.estimator}", _text(each.score)]
    cells += ["" if one.ahead is None else _text(one.ahead), _verdict(one)]
    return f"| {' | '.join(cells)} |"


def _verdict(one: Found) -> str:
    return "nothing to compare" if one.ahead is None else verdict(one.ahead)


def _wrapped(text: str) -> str:
    return textwrap.fill(text, 120, break_long_words=False, break_on_hyphens=False)


def _text(one: Interval) -> str:
    text = f"{one.mean:.4f}" if math.isfinite(one.mean) else "-"
    return text if not math.isfinite(one.low) else f"{text} ({one.low:.4f} to {one.high:.4f})"


def main() -> None:
    """Print or write the page."""
    options = options_of(__doc__)
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
