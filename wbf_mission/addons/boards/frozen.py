"""Frozen baselines of this version: the SHA-256 of each pack."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping
from pathlib import Path

import msgspec

from wbf_mission.addons.boards.submission import read_pack
from wbf_mission.results.storage import ResultError

TABLE = Path(__file__).with_name("frozen.json")


@functools.cache
def frozen_sums() -> Mapping[str, str]:
    """Return the SHA-256 of each frozen pack by folder and name, such as ``0.1.0/own.zip``."""
    return msgspec.json.decode(TABLE.read_bytes(), type=dict[str, str])


def is_frozen(path: Path, digest: str) -> bool:
    """Return whether a file is a frozen pack of this version, by its SHA-256.

    Raises ResultError for a file with the name of a frozen pack but another SHA-256.
    """
    name = _name(path)
    if frozen_sums().get(name, digest) != digest:
        raise ResultError(f"{path}: is not the frozen {name}, whose SHA-256 is another; get the file again")
    return digest in frozen_sums().values()


def sums_of(packs: Iterable[Path]) -> dict[str, str]:
    """Return the contents of `TABLE` for some packs; ResultError if a pack cannot be read."""
    return {_name(path): read_pack(path).digest for path in sorted(packs)}


def _name(path: Path) -> str:
    return "/".join(path.resolve().parts[-2:])
