"""The frozen baselines that come with this version: the SHA-256 of each pack, and what flew it."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping
from pathlib import Path

import msgspec

from wbf_mission.bench.submission import read_pack
from wbf_mission.results.storage import ResultError

TABLE = Path(__file__).with_name("frozen.json")


class FrozenPack(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The SHA-256 of a pack's file, the version and the state of the code that flew it."""

    sha256: str
    version: str
    code: str


@functools.cache
def frozen_packs() -> Mapping[str, FrozenPack]:
    """Return what is known of each frozen pack, by its folder and name, such as ``0.1.0/own.zip``."""
    return msgspec.json.decode(TABLE.read_bytes(), type=dict[str, FrozenPack])


def is_frozen(path: Path, digest: str) -> bool:
    """Return whether a file is a frozen pack of this version, by its SHA-256.

    ResultError if it only has the name of one.
    """
    name = "/".join(path.resolve().parts[-2:])
    known = frozen_packs()
    if name in known and known[name].sha256 != digest:
        raise ResultError(f"{path}: is not the frozen {name}, whose SHA-256 is another; get the file again")
    return any(pack.sha256 == digest for pack in known.values())


def version_of(code: str) -> str | None:
    """Return the version of a state of the code that flew a frozen pack; None if it flew none."""
    return next((pack.version for pack in frozen_packs().values() if pack.code == code), None)


def table_of(packs: Iterable[Path]) -> dict[str, FrozenPack]:
    """Return the table of packs; ResultError if one cannot be read, or is not of its folder's version."""
    found = {}
    for path in sorted(packs):
        pack = read_pack(path)
        if pack.submission.version != path.resolve().parent.name:
            raise ResultError(f"{path}: is of version {pack.submission.version}; put it into its folder")
        told = pack.submission
        found["/".join(path.resolve().parts[-2:])] = FrozenPack(pack.digest, told.version, told.code)
    return found
