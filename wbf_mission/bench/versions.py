"""Program versions of rows, and distinct names for rows of different code."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

from msgspec import structs

from wbf_mission.bench.rows import BenchRow

_SHORT = 8
_CHANGES = "+changes"
_CODE, _SCENARIO, _PLANNER, _ESTIMATOR = "code", "scenario", "planner", "estimator"
_NAMED = (("scenario", _CODE), ("scenario", _SCENARIO), ("planner", _PLANNER), ("estimator", _ESTIMATOR))


def build_of(row: BenchRow) -> str:
    """Return the version of wbf-mission that flew a row, with the commit, else with the behaviour numbers.

    >>> row = BenchRow(key="", scenario="", planner="", estimator="", seed=0)
    >>> build_of(structs.replace(row, versions={"wbf-mission": "0.1.0", "commit": "4622a3d6f0+changes"}))
    '0.1.0, 4622a3d6+changes'
    """
    return f"{row.versions.get('wbf-mission', 'unknown version')}, {commit_of(row) or digest_of(row, _CODE)}"


def commit_of(row: BenchRow) -> str:
    """Return the short commit that flew a row, with ``+changes`` if files were changed; "" if unknown."""
    commit, changes, _ = row.versions.get("commit", "").partition(_CHANGES)
    return commit[:_SHORT] + changes


def digest_of(row: BenchRow, key: str) -> str:
    """Return behaviour numbers, or the start of a digest; "unknown code" for rows of old folders."""
    return _shown(row.codes.get(key, "built in" if row.codes else "unknown code"), 12)


def _of_old(row: BenchRow, key: str) -> str:
    """Return the digest of a row's code, scenario, planner or estimator; the version if it has none."""
    unknown = f"unknown {build_of(row)}" if key == _CODE else "unknown"
    return row.codes.get(key, "") or ("built in" if row.codes else unknown)


def _shown(digest: str, digits: int = _SHORT) -> str:
    return digest if "." in digest else digest[:digits].strip()  # behaviour numbers are not shortened


def _words(row: BenchRow, key: str) -> str:
    return build_of(row) if key == _CODE else row.objects.get(key, "")


def apart(rows: Sequence[BenchRow]) -> Sequence[BenchRow]:
    """Return rows with ambiguous names extended, so that equal names mean the same thing.

    A name is ambiguous if the program, a file or the user's code changed between runs, or if an object has
    other parameters. The extension is the version and commit (``WBF/Miniberry-30-v1 [0.1.0, 4622a3d6]``), an
    object's parameters (``UCB(beta=9.0)``), or else the start of the digest. Other rows are returned
    unchanged.
    """
    for name, key in _NAMED:
        words: dict[str, dict[str, str]] = {}
        for row in rows:
            words.setdefault(getattr(row, name), {}).setdefault(_of_old(row, key), _words(row, key))
        several = {given: _labels(given, found) for given, found in words.items() if len(found) > 1}
        if several:
            rows = [
                structs.replace(row, **{name: several[getattr(row, name)][_of_old(row, key)]})
                if getattr(row, name) in several
                else row
                for row in rows
            ]
    return rows


def _labels(name: str, words: dict[str, str]) -> dict[str, str]:
    """Return a distinct label for each digest of an ambiguous name."""
    count = Counter(words.values())
    found = {}
    for digest, text in words.items():
        if text and count[text] == 1:
            found[digest] = text if text.startswith(f"{name}(") else f"{name} [{text}]"
        else:
            found[digest] = f"{name} [{', '.join(filter(None, (text, _shown(digest))))}]"
    return found


def builds_in_words(rows: Iterable[BenchRow]) -> str:
    """Return the builds that flew rows, and whether their behaviour numbers agree; empty if only one."""
    count = Counter((build_of(row), _of_old(row, _CODE)) for row in rows)
    if len(count) <= 1:
        return ""
    codes = {code for _, code in count}
    several = Counter(build for build, _ in count)
    builds = "; ".join(
        f"{build}{f', {_shown(code)}' if several[build] > 1 else ''}: {number} rows"
        for (build, code), number in count.items()
    )
    same = "of the same behaviour" if len(codes) == 1 else f"of {len(codes)} behaviours"
    return f"rows of {len(count)} versions ({builds}), {same}"
