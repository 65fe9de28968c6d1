"""A submission: benchmark rows, their author and the methods flown, in one file.

The file is a zip of ``submission.json``, ``rows.parquet`` and, under ``code/``, source files of the submitted
methods. The source files are for people to read and are not run here. Time stamps are fixed, so equal content
gives equal bytes. Reading a file checks the summary in ``submission.json`` against the rows.
"""

from __future__ import annotations

import datetime
import hashlib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from geo.atomic import atomic_write
from geo.reading import UnreadableError, misfit, not_json, read_file
from geo.system import memory_bounded
from wbf_mission.addons.base.archive import Archive, ArchiveError, archive_of
from wbf_mission.bench.rows import TABLE, BenchRow, by_pair, by_scenario, rows_of, rows_table
from wbf_mission.bench.spec import seeds_text
from wbf_mission.own_code import files_beside
from wbf_mission.results.storage import ResultError, table_bytes

FORMAT = 1
SUFFIX = ".zip"
ABOUT = "submission.json"
_CODE = "code"
_CODE_NAME = re.compile(rf"{_CODE}(/[A-Za-z0-9_][A-Za-z0-9_.+-]*)+")
_SEAL = re.compile(r"[0-9a-f]{64}")
MAX_PACK_BYTES = 64 * 2**20
_MAX_UNPACKED_BYTES = 2 * MAX_PACK_BYTES
_MAX_MEMORY_BYTES = 2**31
_MAX_CODE_FILES = 200
_MAX_CODE_BYTES = 2**20
_MAX_NAME, _MAX_ABOUT, _MAX_LABEL = 80, 2000, 400


class Flown(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Methods and seeds flown in one scenario."""

    scenario: str
    meaning: str
    """Digest of the scenario's settings."""
    methods: list[tuple[str, str]]
    """Pairs of a planner (or policy) and an estimator."""
    seeds: str
    """Seeds on which every method was flown, in the syntax of `bench run`."""


class Own(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A planner, policy or estimator that is not built in: name in the rows, description and digest."""

    kind: str
    name: str
    words: str
    digest: str


class Submission(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Contents of ``submission.json``."""

    format: int = FORMAT
    name: str
    by: str
    about: str = ""
    made: str
    """Time of the last row, UTC."""
    seal: str = ""
    """Seal of the round whose environments were flown; empty without a round."""
    flown: list[Flown]
    version: str
    code: str
    """Behaviour numbers of wbf-mission (`wbf_mission.version.behaviour`)."""
    versions: dict[str, list[str]]
    """Versions of Python and of the libraries in the rows; usually one version of each."""
    hardware: list[dict[str, str]]
    own: list[Own]
    files: dict[str, str]
    """SHA-256 of the other files in the zip, by name."""


@dataclass(frozen=True, slots=True)
class Pack:
    """A submission read from a file: its contents, rows, submitted code and the SHA-256 of the file."""

    submission: Submission
    rows: list[BenchRow]
    code: dict[str, bytes]
    """Submitted files, keyed by their names in the pack."""
    digest: str


def write_pack(
    path: Path, rows: Sequence[BenchRow], *, code: Mapping[str, bytes] | None = None, **texts: str
) -> Submission:
    """Write a submission without checking its rows; `code` has the source files from `code_files`.

    `texts` are `name`, `by`, `about`, `made` and `seal` of the `Submission`. ResultError if a text is too
    long or not one printable line, or if the pack would be too large.
    """
    members = {TABLE: table_bytes(rows_table(rows)), **(code or {})}
    files = {member: hashlib.sha256(content).hexdigest() for member, content in members.items()}
    told = _submission(rows, **texts, files=files)
    require_texts(msgspec.structs.asdict(told))
    packed = archive_of({ABOUT: msgspec.json.format(msgspec.json.encode(told)) + b"\n", **members})
    if len(packed) > MAX_PACK_BYTES:
        limit = f"{MAX_PACK_BYTES // 2**20} MiB"
        raise ResultError(f"{path}: would be larger than {limit}; make a submission of fewer scenarios")
    with atomic_write(path, "wb") as file:
        file.write(packed)
    return told


def made_when(folder: Path) -> str:
    """Return the time of a benchmark's last row, so that packing again gives the same file."""
    last_s = max(one.stat().st_mtime for one in folder.iterdir() if one.suffix in (".parquet", ".jsonl"))
    return datetime.datetime.fromtimestamp(int(last_s), datetime.UTC).isoformat()


def _submission(rows: Sequence[BenchRow], **given: Any) -> Submission:
    """Return the submission that summarises rows of one version; `given` has texts and file digests."""
    keys = dict.fromkeys(key for row in rows for key in row.versions)
    machines = {tuple(sorted(row.hardware.items())) for row in rows if row.hardware}
    own = {
        (kind, getattr(row, kind), row.objects.get(kind, ""), row.codes[kind])
        for row in rows
        for kind in ("planner", "estimator")
        if kind in row.codes
    }
    return Submission(
        flown=[
            Flown(
                scenario=scenario,
                meaning=here[0].codes.get("scenario", ""),
                methods=list(by_pair(here)),
                seeds=seeds_text(sorted({row.seed for row in here})),
            )
            for scenario, here in by_scenario(rows).items()
        ],
        version=", ".join(sorted({row.versions.get("wbf-mission", "") for row in rows})),
        code=rows[0].codes.get("code", ""),
        versions={key: sorted({row.versions.get(key, "") for row in rows}) for key in sorted(keys)},
        hardware=[dict(machine) for machine in sorted(machines)],
        own=[Own(kind=k, name=n, words=w, digest=d) for k, n, w, d in sorted(own)],
        **given,
    )


def code_files(paths: Iterable[Path]) -> dict[str, bytes]:
    """Return source files, keyed by name in the pack; hidden files and caches of folders are left out.

    With a single file, the files beside it that its digest covers are returned, too (`files_beside`).

    Raises ResultError if there is no file, or a file is too large or has an unsafe name.
    """
    found: dict[str, bytes] = {}
    taken: set[Path] = set()
    for given in paths:
        root = given.resolve() if given.is_dir() else given.resolve().parent
        inner = (
            sorted(root.rglob("*"))
            if given.is_dir()
            else [root / given.name, *files_beside(root / given.name)]
        )
        for path in inner:
            below = path.relative_to(root).parts
            hidden = any(part.startswith(".") or part == "__pycache__" for part in below)
            if path.is_symlink() or hidden or (given.is_dir() and not path.is_file()):
                continue
            member = "/".join((_CODE, *((root.name,) if given.is_dir() else ()), *below))
            if path in taken:
                continue
            taken.add(path)
            if not _CODE_NAME.fullmatch(member) or member in found:
                msg = f"{path}: cannot be packed as {member}; give it another name, of letters and digits"
                raise ResultError(msg)
            try:
                found[member] = read_file(path, _MAX_CODE_BYTES)
            except UnreadableError as error:
                raise ResultError(f"{path}: {error}; --code takes source files") from None
    if len(found) > _MAX_CODE_FILES:
        raise ResultError(f"--code gives {len(found)} files, but a pack takes at most {_MAX_CODE_FILES}")
    return found


def read_pack(path: Path) -> Pack:
    """Read an untrusted submission; its code is neither unpacked nor run.

    Raises ResultError if the file is not a submission, too large, damaged, or contradicts its rows.
    """
    try:
        data = read_file(path, MAX_PACK_BYTES)
    except UnreadableError as error:
        raise ResultError(f"{path}: {error}") from None
    members = _members(path, data)
    told = _told(path, members.pop(ABOUT))
    digests = {name: hashlib.sha256(content).hexdigest() for name, content in members.items()}
    if told.files != digests:
        wrong = min(name for name, _ in told.files.items() ^ digests.items())
        raise ResultError(f"{path}: {wrong} does not match {ABOUT}; get the file again")
    try:
        # A table may take more memory than the size that it states.
        with memory_bounded(_MAX_MEMORY_BYTES):
            rows = list(rows_of(path / TABLE, members[TABLE]))
    except MemoryError:
        raise ResultError(f"{path}: {TABLE} takes more memory than a submission is allowed") from None
    if not rows:
        raise ResultError(f"{path}: holds no rows")
    _require_labels(path, rows)
    given = {name: getattr(told, name) for name in ("name", "by", "about", "made", "seal", "files")}
    again = _submission(rows, **given)
    for field in Submission.__struct_fields__:
        if getattr(told, field) != getattr(again, field):
            raise ResultError(f"{path}: {ABOUT} and the rows differ in {field}; pack it again")
    code = {name: content for name, content in members.items() if name != TABLE}
    return Pack(told, rows, code, hashlib.sha256(data).hexdigest())


def unpack_code(pack: Pack, folder: Path) -> None:
    """Write the submitted code of a pack into an empty folder.

    Raises ResultError if the pack has no code.
    """
    if not pack.code:
        raise ResultError("has no code; 'bench submit --code FILE|DIR' packs code")
    for name, content in pack.code.items():
        file = folder.joinpath(*name.split("/")[1:])  # `_CODE_NAME` allows only plain names
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content)


def _members(path: Path, data: bytes) -> dict[str, bytes]:
    """Return the files of a pack's archive; ResultError if a name is unexpected, repeated or missing."""
    try:
        with Archive(data, _MAX_UNPACKED_BYTES) as archive:
            for name in archive.names:
                if (
                    not (name in (ABOUT, TABLE) or _CODE_NAME.fullmatch(name))
                    or archive.names.count(name) > 1
                ):
                    raise ResultError(f"{path}: holds {name[:80]!r}, which does not belong in a submission")
            found = {name: archive.read(name) for name in archive.names}
    except ArchiveError as error:
        raise ResultError(f"{path}: {error}") from None
    for name in (ABOUT, TABLE):
        if name not in found:
            raise ResultError(f"{path}: has no {name}; it was not written by 'bench submit'")
    return found


def _told(path: Path, data: bytes) -> Submission:
    try:
        version = msgspec.json.decode(data, type=_Format).format
        if version != FORMAT:
            msg = f"has format {version}, but this version reads {FORMAT}; use another version"
            raise ResultError(f"{path}: {msg}")
        told = msgspec.json.decode(data, type=Submission)
    except msgspec.ValidationError as error:
        raise ResultError(f"{path}: {ABOUT}: {misfit(error)}") from None
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise ResultError(f"{path}: {ABOUT}: {not_json(error, data)}") from None
    except RecursionError:
        raise ResultError(f"{path}: {ABOUT}: is nested too deeply") from None
    require_texts(msgspec.structs.asdict(told), f"{path}: ")
    return told


class _Format(msgspec.Struct):
    format: int


def require_texts(told: Mapping[str, Any], where: str = "") -> None:
    """Raise ResultError if a text is too long or not one printable line, or if the seal is malformed."""
    if told.get("seal") and not _SEAL.fullmatch(told["seal"]):
        raise ResultError(f"{where}seal does not have the 64 hexadecimal digits of a seal of 'bench seal'")
    limits = {"name": (1, _MAX_NAME), "by": (1, _MAX_NAME), "about": (0, _MAX_ABOUT), "made": (0, 40)}
    for field, (least, most) in limits.items():
        text = told.get(field)
        if text is None or (least <= len(text) <= most and text.isprintable() and text == text.strip()):
            continue
        raise ResultError(f"{where}{field} {text[:most]!r} is not a line of {least} to {most} characters")


def _require_labels(path: Path, rows: Iterable[BenchRow]) -> None:
    for row in rows:
        given = (row.objects, row.versions, row.codes, row.hardware, row.bad_answers)
        names = (row.key, row.scenario, row.planner, row.estimator, row.outcome or "", row.budget or "")
        values = (str(text) for one in given for text in (*one.keys(), *one.values()))
        for text in (*names, *values, (row.error or "")[:_MAX_LABEL]):
            if len(text) > _MAX_LABEL or not text.isprintable():
                why = f"is not a printable line of at most {_MAX_LABEL} characters"
                raise ResultError(f"{path}: {text[:40]!r} in {TABLE} {why}")
