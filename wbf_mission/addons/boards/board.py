"""The leaderboard: submissions and frozen baselines, compared where they were flown on the same environments.

There is a table for each scenario, behaviour of the program and set of environments. It has every method that
was flown on all of them, so no submission of few environments narrows what others are compared by.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from msgspec import structs

from geo.errors import WbfMissionError
from geo.texts import one_line
from wbf_mission.addons.boards.audit import require_whole
from wbf_mission.addons.boards.frozen import is_frozen
from wbf_mission.addons.boards.submission import SUFFIX, Submission, read_pack
from wbf_mission.addons.boards.verification import VERIFIED, Verification, fly_again
from wbf_mission.bench.rows import BenchRow, by_pair, by_scenario
from wbf_mission.bench.sealed import Secret
from wbf_mission.bench.spec import seed_ranges
from wbf_mission.bench.standings import Comparison, Standing, compare, standings
from wbf_mission.progress import Progress, silent
from wbf_mission.results.storage import ResultError

_MOST_PACKS = 1000
SHOWN_DIGEST = 8


@dataclass(frozen=True, slots=True)
class Entry:
    """A pack that holds what it says.

    Attributes
    ----------
    frozen : bool
        Whether it is one of the frozen baselines.
    digest : str
        SHA-256 of its file.
    """

    path: Path
    frozen: bool
    submission: Submission
    rows: list[BenchRow]
    digest: str
    verification: Verification


@dataclass(frozen=True, slots=True)
class Line:
    """A method on a board: a planner or policy with an estimator, of a submission."""

    entry: Entry
    standing: Standing
    own: str
    """Digests of own code, empty for what is built in."""
    against: Comparison | None
    """With the best frozen baseline of the table; None for that itself, and where there is none."""


@dataclass(frozen=True, slots=True)
class BoardTable:
    """Methods that were flown in a scenario with the same behaviour numbers, on the same environments."""

    scenario: str
    versions: tuple[str, ...]
    code: str
    seeds: tuple[int, ...]
    held_out: bool
    """Whether the environments are those of the sealed round."""
    lines: tuple[Line, ...]

    @property
    def environments(self) -> str:
        """Which they are, in words."""
        if self.held_out:
            return f"{len(self.seeds)} held-out environments"
        text = one_line(seed_ranges(self.seeds), 60)
        first = list(self.seeds) == list(range(len(self.seeds)))
        if first:
            return f"{len(self.seeds)} environments (seeds 0 to {len(self.seeds) - 1})"
        return f"{len(self.seeds)} environments that a submission chose (seeds {text})"


@dataclass(frozen=True, slots=True)
class Board:
    """All tables, and why packs are left out."""

    tables: tuple[BoardTable, ...]
    entries: tuple[Entry, ...]
    refused: dict[str, str]


def packs_of(sources: Iterable[Path]) -> list[tuple[Path, bool]]:
    """Return the packs that are named, and those in folders, at any depth, which are the frozen baselines.

    ResultError if a folder holds none.
    """
    found: dict[Path, bool] = {}
    for source in sources:
        if not source.is_dir():
            found.setdefault(source, False)
            continue
        inside = sorted(one for one in source.rglob(f"*{SUFFIX}") if one.is_file() and not one.is_symlink())
        if not inside:
            msg = f"{source}: holds no pack; give files of 'bench submit', or a folder of them"
            raise ResultError(msg)
        found |= dict.fromkeys(inside, True)
    if len(found) > _MOST_PACKS:
        raise ResultError(f"{len(found)} packs, at most {_MOST_PACKS} are read: make several boards")
    return list(found.items())


def board_of(
    packs: Sequence[tuple[Path, bool]],
    *,
    verify: int | None = None,
    secret: Secret | None = None,
    progress: Progress = silent,
) -> Board:
    """Read packs, as of `packs_of`, check them, and compare what can be compared.

    A pack that is refused is told in `Board.refused`, and the others go on.

    Parameters
    ----------
    verify : int, optional
        How many rows of each method are flown again, by default none of the frozen baselines that are
        known by their SHA-256 and `VERIFIED` of all others; own code is never run.
    secret : Secret, optional
        Of a round that has ended: tables on its environments are held out.
    """
    entries: list[Entry] = []
    refused: dict[str, str] = {}
    known: dict[str, Path] = {}
    for number, (path, frozen) in enumerate(packs):
        progress("reading", number, len(packs))
        try:
            entry = _entry(path, frozen=frozen, verify=verify, progress=progress)
            if entry.digest in known:
                raise ResultError(f"{path}: is the same file as {known[entry.digest]}")
        except (WbfMissionError, OSError) as error:
            refused[str(path)] = one_line(str(error), 300)
        else:
            known[entry.digest] = path
            entries.append(entry)
    return Board(tuple(_tables(entries, secret)), tuple(entries), refused)


def _entry(path: Path, *, frozen: bool, verify: int | None, progress: Progress) -> Entry:
    pack = read_pack(path)
    try:
        require_whole(pack.rows, sealed=bool(pack.submission.seal))
    except ResultError as error:
        raise ResultError(f"{path}: {error}") from None
    # Packs of a folder that are none of this version's frozen ones are baselines, too, but not believed.
    listed = frozen and is_frozen(path, pack.digest)
    count = verify if verify is not None else 0 if listed else VERIFIED
    verification = fly_again(pack.rows, count, progress=progress)
    return Entry(path, frozen, pack.submission, pack.rows, pack.digest, verification)


def _tables(entries: Sequence[Entry], secret: Secret | None) -> Iterator[BoardTable]:
    groups: dict[tuple[str, str], list[tuple[Entry, list[BenchRow]]]] = {}
    for entry in entries:
        told = entry.submission
        for scenario, rows in by_scenario(entry.rows).items():
            groups.setdefault((scenario, told.code), []).append((entry, rows))
    sealed = frozenset() if secret is None else frozenset(secret.seeds())
    for (scenario, code), group in sorted(groups.items(), key=lambda one: one[0]):
        of_round = secret is not None and scenario in (secret.scenarios or [scenario])
        flown = [frozenset(row.seed for row in rows) for _, rows in group]
        for seeds in sorted(set(flown), key=lambda one: (one != sealed, -len(one), min(one))):
            here = [one for one, own in zip(group, flown, strict=True) if own >= seeds]
            yield BoardTable(
                scenario=scenario,
                versions=tuple(sorted({entry.submission.version for entry, _ in here})),
                code=code,
                seeds=tuple(sorted(seeds)),
                held_out=of_round and seeds == sealed,
                lines=_lines(here, seeds),
            )


def _lines(group: Sequence[tuple[Entry, list[BenchRow]]], seeds: frozenset[int]) -> tuple[Line, ...]:
    """Return the methods of one table, the best score first."""
    methods: dict[str, tuple[Entry, BenchRow]] = {}
    rows: list[BenchRow] = []
    for entry, own in group:
        for pair_rows in by_pair(row for row in own if row.seed in seeds).values():
            name = str(len(methods))
            methods[name] = entry, pair_rows[0]
            # Several submissions may have methods of one name: a number takes its place.
            nameless = {"planner": name, "estimator": "", "codes": {}, "versions": {}}
            rows += [structs.replace(row, **nameless) for row in pair_rows]
    found = standings(rows)
    best = next(
        (one.planner for one in found if methods[one.planner][0].frozen and one.environments > one.failed),
        None,
    )
    others = [one.planner for one in found if one.planner != best]
    compared = {one.mine: one for one in compare(rows, others, [best])} if best is not None else {}
    lines = []
    for one in found:
        entry, row = methods[one.planner]
        named = dataclasses.replace(one, planner=row.planner, estimator=row.estimator)
        codes = [row.codes[kind] for kind in ("planner", "estimator") if kind in row.codes]
        lines.append(
            Line(entry, named, " ".join(code[:SHOWN_DIGEST] for code in codes), compared.get(one.planner))
        )
    return tuple(lines)
