"""Which versions flew rows: rows of one name told apart by them, and a table of what was run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

from msgspec import structs

from wbf_mission.bench.page import Table
from wbf_mission.bench.rows import BenchRow

_SHORT = 8
_CHANGES = "+changes"
_CODE, _SCENARIO, _PLANNER, _ESTIMATOR = "code", "scenario", "planner", "estimator"
_NAMED = (("scenario", _CODE), ("scenario", _SCENARIO), ("planner", _PLANNER), ("estimator", _ESTIMATOR))


def build_of(row: BenchRow) -> str:
    """Return which wbf-mission flew a row, in words: the version with the commit, else with the digest.

    >>> row = BenchRow(key="", scenario="", planner="", estimator="", seed=0)
    >>> build_of(structs.replace(row, versions={"wbf-mission": "0.1.0", "commit": "4622a3d6f0+changes"}))
    '0.1.0, 4622a3d6+changes'
    """
    return f"{row.versions.get('wbf-mission', 'unknown version')}, {_commit(row) or _digest(row, _CODE)}"


def _commit(row: BenchRow) -> str:
    commit, changes, _ = row.versions.get("commit", "").partition(_CHANGES)
    return commit[:_SHORT] + changes


def _digest(row: BenchRow, key: str) -> str:
    """Return behaviour numbers, or the beginning of a digest; rows of old folders have none."""
    return _shown(row.codes.get(key, "built in" if row.codes else "unknown code"), 12)


def _of_old(row: BenchRow, key: str) -> str:
    """Return what tells a row apart: the digest, of rows without digests the version."""
    unknown = f"unknown {build_of(row)}" if key == _CODE else "unknown"
    return row.codes.get(key, "") or ("built in" if row.codes else unknown)


def _shown(digest: str, digits: int = _SHORT) -> str:
    return digest if "." in digest else digest[:digits].strip()  # behaviour numbers are shown whole


def _words(row: BenchRow, key: str) -> str:
    return build_of(row) if key == _CODE else row.objects.get(key, "")


def apart(rows: Sequence[BenchRow]) -> Sequence[BenchRow]:
    """Return rows in which what has the same name is the same.

    Where a name stands for several things, because the program, a file or a user's code changed between runs
    or an object has other parameters, it is told which: ``WBF/Miniberry-30-v1 [0.1.0, 4622a3d6]`` by version
    and commit, ``UCB(beta=9.0)`` by an object's parameters, else by the beginning of the digest. Rows that
    need nothing of this are given back as they are.
    """
    for name, key in _NAMED:
        words: dict[str, dict[str, str]] = {}
        for row in rows:
            words.setdefault(getattr(row, name), {}).setdefault(_of_old(row, key), _words(row, key))
        several = {one: _labels(one, found) for one, found in words.items() if len(found) > 1}
        if several:
            rows = [
                structs.replace(row, **{name: several[getattr(row, name)][_of_old(row, key)]})
                if getattr(row, name) in several
                else row
                for row in rows
            ]
    return rows


def _labels(name: str, words: dict[str, str]) -> dict[str, str]:
    """Return how each of several digests of a name is called."""
    count = Counter(words.values())
    found = {}
    for digest, told in words.items():
        if told and count[told] == 1:
            found[digest] = told if told.startswith(f"{name}(") else f"{name} [{told}]"
        else:
            found[digest] = f"{name} [{', '.join(filter(None, (told, _shown(digest))))}]"
    return found


def builds_in_words(rows: Iterable[BenchRow]) -> str:
    """Return which builds flew rows, if these are several, and whether their behaviour numbers are the same.

    Empty if all are of one.
    """
    count = Counter((build_of(row), _of_old(row, _CODE)) for row in rows)
    if len(count) <= 1:
        return ""
    codes = {code for _, code in count}
    several = Counter(build for build, _ in count)
    told = "; ".join(
        f"{build}{f', {_shown(code)}' if several[build] > 1 else ''}: {number} rows"
        for (build, code), number in count.items()
    )
    same = "of the same behaviour" if len(codes) == 1 else f"of {len(codes)} behaviours"
    return f"rows of {len(count)} versions ({told}), {same}"


def what_was_run(rows: Sequence[BenchRow]) -> Table:
    """Return versions, commits, digests and parameters of objects, a line for each that differs."""
    count: Counter[tuple[str, ...]] = Counter()
    for row in rows:
        python = ", ".join(f"{key} {row.versions[key]}" for key in ("python", "numpy") if key in row.versions)
        version = row.versions.get("wbf-mission", "-")
        count["wbf-mission", version, _commit(row) or "-", _digest(row, _CODE), python] += 1
        count[f"scenario {row.scenario}", "-", "-", _digest(row, _SCENARIO), ""] += 1
        for key in (_PLANNER, _ESTIMATOR):
            if key in row.codes or key in row.objects:
                digest, words = row.codes.get(key, "-")[:12], row.objects.get(key, "")
                count[f"{key} {getattr(row, key)}", "-", "-", digest, words] += 1
    lines = tuple((*one, str(number)) for one, number in sorted(count.items(), key=_order))
    return Table("What was run", ("what", "version", "commit", "digest", "with", "rows"), lines)


def _order(one: tuple[tuple[str, ...], int]) -> tuple[bool, tuple[str, ...]]:
    return one[0][0] != "wbf-mission", one[0]


def machines(rows: Sequence[BenchRow]) -> Table:
    """Return on which machines rows were flown, and what that took."""
    found: dict[tuple[str, ...], list[BenchRow]] = {}
    for row in rows:
        told = (row.hardware.get(key, "-") for key in ("processor", "cores", "memory_gb", "system"))
        found.setdefault(tuple(told), []).append(row)
    lines = tuple(
        (
            *told,
            str(len(own)),
            f"{sum(row.wall_time_s for row in own):.1f}",
            f"{sum(row.cpu_time_s for row in own):.1f}",
        )
        for told, own in sorted(found.items())
    )
    header = ("processor", "cores", "memory, GB", "system", "rows", "wall time, s", "CPU time, s")
    return Table("Machines, and what all runs took", header, lines)
