"""Leaderboard: compares submissions and frozen baselines that were flown on the same environments.

There is one table for each combination of scenario, behaviour numbers and set of environments. A table has
every method that was flown on all environments of the table. Therefore, a submission with few environments
does not shrink the other tables.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
from msgspec import structs

from geo.errors import WbfMissionError
from geo.texts import one_line
from wbf_mission.addons.base.standings import Standing, standings
from wbf_mission.addons.boards.audit import require_whole
from wbf_mission.addons.boards.comparison import Comparison, compare
from wbf_mission.addons.boards.sealed import Secret
from wbf_mission.addons.boards.submission import SUFFIX, Submission, read_pack
from wbf_mission.addons.boards.verification import VERIFIED, Verification, fly_again
from wbf_mission.bench.rows import BenchRow, by_pair, by_scenario
from wbf_mission.bench.spec import seed_ranges
from wbf_mission.progress import Progress, silent
from wbf_mission.results.storage import ResultError

FROZEN = Path(__file__).with_name("frozen.json")


@dataclass(frozen=True, slots=True)
class Entry:
    """A submitted file (pack) that passed the audit."""

    path: Path
    frozen: bool
    """Whether the pack is one of the frozen baselines."""
    submission: Submission
    rows: list[BenchRow]
    digest: str
    """SHA-256 of the pack file."""
    verification: Verification


@dataclass(frozen=True, slots=True)
class Line:
    """One method on a board: a planner or policy with an estimator, and its submission."""

    entry: Entry
    standing: Standing
    own: str
    """Digests of submitted code; empty for a built-in method."""
    against: Comparison | None
    """Comparison with the table's best frozen baseline; None for this baseline, or without a baseline."""


@dataclass(frozen=True, slots=True)
class BoardTable:
    """Methods flown in one scenario with the same behaviour numbers on the same environments."""

    scenario: str
    versions: tuple[str, ...]
    code: str
    seeds: tuple[int, ...]
    held_out: bool
    """Whether the environments belong to the sealed round."""
    lines: tuple[Line, ...]

    @property
    def environments(self) -> str:
        """Number and seeds of the environments, in words."""
        if self.held_out:
            return f"{len(self.seeds)} held-out environments"
        text = one_line(seed_ranges(self.seeds), 60)
        first = list(self.seeds) == list(range(len(self.seeds)))
        if first:
            return f"{len(self.seeds)} environments (seeds 0 to {len(self.seeds) - 1})"
        return f"{len(self.seeds)} environments that a submission chose (seeds {text})"


@dataclass(frozen=True, slots=True)
class Board:
    """All tables of a leaderboard, and the reason for each refused pack."""

    tables: tuple[BoardTable, ...]
    entries: tuple[Entry, ...]
    refused: dict[str, str]


@functools.cache
def frozen_sums() -> Mapping[str, str]:
    """Return the SHA-256 of each frozen baseline, keyed by folder and file, such as ``0.1.0/own.zip``."""
    return msgspec.json.decode(FROZEN.read_bytes(), type=dict[str, str])


def is_frozen(path: Path, digest: str) -> bool:
    """Return whether a file is a frozen baseline of this version, by its SHA-256.

    Raises ResultError for a file with the name of a frozen baseline but another SHA-256.
    """
    name = "/".join(path.resolve().parts[-2:])
    if frozen_sums().get(name, digest) != digest:
        raise ResultError(f"{path}: differs from the frozen baseline {name} (SHA-256); get the file again")
    return digest in frozen_sums().values()


_MOST_PACKS = 1000


def packs_of(sources: Iterable[Path]) -> list[tuple[Path, bool]]:
    """Return each pack and whether it is a baseline; the baselines are the packs that are found in a folder.

    Raises ResultError if a folder has no pack.
    """
    found: dict[Path, bool] = {}
    for source in sources:
        if not source.is_dir():
            found.setdefault(source, False)
            continue
        inside = sorted(one for one in source.rglob(f"*{SUFFIX}") if one.is_file() and not one.is_symlink())
        if not inside:
            msg = f"{source}: has no pack; give files written by 'bench submit', or a folder of such files"
            raise ResultError(msg)
        found |= dict.fromkeys(inside, True)
    if len(found) > _MOST_PACKS:
        raise ResultError(f"{len(found)} packs; a board takes at most {_MOST_PACKS}: make several boards")
    return list(found.items())


def board_of(
    packs: Sequence[tuple[Path, bool]],
    *,
    verify: int | None = None,
    secret: Secret | None = None,
    progress: Progress = silent,
) -> Board:
    """Read and check the packs of `packs_of`, and compare their methods.

    A pack that fails a check is listed in `Board.refused`; the other packs are compared. `verify` is the
    number of rows of each method that are flown again. By default it is 0 for frozen baselines known by their
    SHA-256, and `VERIFIED` for all other packs. Submitted code is never run. If the `secret` of a finished
    round is given, the tables on the environments of this round are marked as held out.
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
    # A pack from a folder is a baseline even if `frozen.json` does not list it, but then it is verified.
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


SHOWN_DIGEST = 8


def _lines(group: Sequence[tuple[Entry, list[BenchRow]]], seeds: frozenset[int]) -> tuple[Line, ...]:
    """Return the methods of one table, best score first."""
    methods: dict[str, tuple[Entry, BenchRow]] = {}
    rows: list[BenchRow] = []
    for entry, own in group:
        for pair_rows in by_pair(row for row in own if row.seed in seeds).values():
            name = str(len(methods))
            methods[name] = entry, pair_rows[0]
            # Methods of several submissions may share a name, so a number replaces the name here.
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
