"""Leading method in each family of scenarios, and calibration of the estimators.

    python benchmarks/families.py FOLDER_OR_PACK... [--out FILE.md]

Sources are folders of ``wbf-mission bench run --family NAME --out FOLDER`` and packs of ``bench submit``.
"Ours" is the better of the policies greedy and rolling-horizon with the estimator epidemic, or with gp for
fields without an epidemic model. Ours and the leader are selected by mean score on the same environments as
the differences. A small lead may therefore be chance; compare it with the interval of the paired difference.
"""

from __future__ import annotations

import math
import sys
import textwrap
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from common import options_of

from wbf_mission.addons.boards.submission import read_pack
from wbf_mission.bench.intervals import Interval, verdict
from wbf_mission.bench.rows import BenchRow, read_rows
from wbf_mission.bench.standings import Standing, standings
from wbf_mission.scenario import Family, families

POLICIES = ("greedy", "rolling-horizon")
_RANKED = 6
_HELD, _SICK_HELD, _HEALTHY_HELD = "_held", "_sick_held", "_healthy_held"
_HEAD = """# Families of scenarios, measured

Which method leads where the world, the fields, the sensors or the farm are others than those that `epidemic`
was trained on, and where ours does not ([families](../benchmark.md#families)). Ours is the better of `greedy`
and `rolling-horizon` with `epidemic`, or with `gp` where `epidemic` does not know the fields. Scores over the
run, 0 is perfect, with intervals of 95 %, and differences in pairs on the same environments; both methods are
chosen by these means, so a small lead is easily luck. The rows are the frozen baselines:

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
    by_family = [
        (family, [one for name in family.scenarios if (one := found_in(rows, name, family)) is not None])
        for family in families()
    ]
    every = [one for _, found in by_family for one in found]
    yield from (_HEAD, _wrapped(_in_short(every)), "")
    for family, found in by_family:
        if not found:
            continue
        yield from (
            f"## {family.title}",
            "",
            _wrapped(f"{family.about} Expected at home: {family.at_home}."),
            "",
        )
        yield "| scenario | environments | ours | score | the best other | score | ours ahead, in pairs | |"
        yield "|---|---|---|---|---|---|---|---|"
        yield from (_line(one) for one in found)
        yield from ("", _wrapped(f"Mean ranks over the scenarios: {_ranks(found)}."), "")
    yield from ("## Where ours does not lead", "")
    behind = [one for one in every if not one.led_by_us]
    if not behind:
        yield "It leads in every scenario that was flown."
    for one in behind:
        ours = "ours was not flown"
        if one.ours is not None:
            ours = f"{_name(one.ours)} is behind by {_text(one.ours.behind)}: {_verdict(one)}"
        yield _wrapped(f"- {one.scenario}: {_name(one.table[0])} leads; {ours}.", "  ")
    yield from _calibration(rows)


def _in_short(every: Sequence[Found]) -> str:
    """Return a summary: the number of scenarios in which ours leads, and leads by more than chance."""
    verdicts = {one.scenario: _verdict(one) for one in every}
    leads = sum(one.led_by_us for one in every)
    better = sum(text == "better" for text in verdicts.values())
    worse = [name for name, text in verdicts.items() if text == "worse"]
    where = f"in {len(worse)} ({', '.join(worse)})" if worse else "nowhere"
    return (
        f"In short: ours has the best mean in {leads} of {len(every)} scenarios, in {better} by more than"
        f" chance; it is behind by more than chance {where}."
    )


def _calibration(rows: Sequence[BenchRow]) -> Iterator[str]:
    """Yield the calibration table of the final estimates on unobserved cells."""
    yield from ("", "## Whether what is stated holds", "")
    yield _wrapped(
        "On cells that nobody looked at, at the end of a run, in the mean over planners and environments:"
        " the part of the sick plants that is among those that may be sick (meant to be 90 %), in brackets"
        " the part of the healthy ones that is, too, and the part of the cells of other fields that is in the"
        " interval of 90 %."
    )
    yield from ("", "| scenario | estimator | of diseases | of other fields |", "|---|---|---|---|")
    for family in families():
        for scenario in family.scenarios:
            for estimator in family.estimators:
                own = [
                    row.calibration for row in rows if (row.scenario, row.estimator) == (scenario, estimator)
                ]
                held = {name: _mean(own, name) for name in dict.fromkeys(key for one in own for key in one)}
                sick = {
                    name: f"{held[name]:.0%} ({held[name.replace(_SICK_HELD, _HEALTHY_HELD)]:.0%})"
                    for name in held
                    if name.endswith(_SICK_HELD)
                }
                other = {
                    name: f"{value:.0%}"
                    for name, value in held.items()
                    if name.endswith(_HELD) and not name.endswith((_SICK_HELD, _HEALTHY_HELD))
                }
                if sick or other:
                    cells = (scenario, estimator, _listed(sick, _SICK_HELD), _listed(other, _HELD))
                    yield f"| {' | '.join(cells)} |"


def _mean(found: Sequence[dict[str, float]], name: str) -> float:
    values = [one[name] for one in found if name in one]
    return sum(values) / len(values)


def _listed(values: dict[str, str], ending: str) -> str:
    return ", ".join(f"{name.removesuffix(ending)} {value}" for name, value in values.items())


def _line(one: Found) -> str:
    first = one.table[0]
    failed = sum(each.failed for each in one.table)
    many = f"{first.environments}, {failed} runs failed" if failed else str(first.environments)
    ours, other = (
        ("", "") if each is None else (_name(each), _text(each.score)) for each in (one.ours, one.other)
    )
    cells = (
        one.scenario,
        many,
        *ours,
        *other,
        "" if one.ahead is None else _text(one.ahead),
        _verdict(one),
    )
    return f"| {' | '.join(cells)} |"


def _verdict(one: Found) -> str:
    return "nothing to compare" if one.ahead is None else verdict(one.ahead)


def _wrapped(text: str, indent: str = "") -> str:
    return textwrap.fill(text, 120, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)


def _ranks(found: Sequence[Found]) -> str:
    """Return the best mean ranks as text."""
    ranks: dict[str, list[float]] = {}
    for one in found:
        for each in one.table:
            ranks.setdefault(_name(each), []).append(each.rank)
    means = {name: sum(values) / len(values) for name, values in ranks.items()}
    best = sorted(means, key=lambda name: means[name])
    return "; ".join(f"{name} {means[name]:.1f}" for name in best[:_RANKED]) + f" (of {len(best)})"


def _name(one: Standing) -> str:
    return f"{one.planner}, {one.estimator}"


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
