"""Sealed rounds: their environments are unknown to participants until the end, and nobody can choose them.

The organiser draws a secret, publishes its seal and keeps the secret. The seeds of the round are derived from
the secret (HMAC-SHA256, RFC 2104). The seal is a commitment to the secret: a SHA-256 of the secret and all
settings of the round. Once the secret is published, anyone can check that the seeds match the seal.
"""

from __future__ import annotations

import datetime
import hashlib
import hmac
import json
import os
import secrets
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from geo.atomic import atomic_write
from geo.reading import UnreadableError, misfit, not_json, read_file
from wbf_mission.bench.rows import BenchRow, by_scenario
from wbf_mission.results.storage import ResultError
from wbf_mission.scenario import ScenarioError, scenario_ids

_SEAL_TAG = b"wbf-mission seal 1\n"
_SEED_TAG = b"wbf-mission seed 1\n"
_SECRET_BYTES = 32
MOST_ENVIRONMENTS = 10_000
_MAX_BYTES = 2**20
_FORMAT = 1


class Seal(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Seal of a round, published when the round begins."""

    format: int = _FORMAT
    seal: str
    """SHA-256 of the secret and the round's settings, in hexadecimal digits."""
    environments: int
    scenarios: list[str] = []
    """Ids of the round's scenarios; an empty list allows any scenario."""
    made: str
    """Time of creation, UTC."""


class Secret(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Secret of a round (256 bits, hexadecimal), published at its end; other attributes as in `Seal`."""

    format: int = _FORMAT
    secret: str
    environments: int
    scenarios: list[str] = []
    made: str

    def seal(self) -> Seal:
        """Return the seal of this secret."""
        bound = [self.format, self.environments, self.scenarios, self.made, self.secret]
        text = json.dumps(bound, separators=(",", ":")).encode()
        return Seal(
            format=self.format,
            seal=hashlib.sha256(_SEAL_TAG + text).hexdigest(),
            environments=self.environments,
            scenarios=self.scenarios,
            made=self.made,
        )

    def seeds(self) -> tuple[int, ...]:
        """Return the seeds of the round, of 63 bits; seed k is derived from the secret and k.

        >>> Secret(secret="00" * 32, environments=2, made="").seeds()
        (5396267416502128160, 5740642076869374249)
        """
        key = bytes.fromhex(self.secret)
        texts = (_SEED_TAG + str(number).encode() for number in range(self.environments))
        digests = (hmac.digest(key, text, "sha256") for text in texts)
        return tuple(int.from_bytes(digest[:8], "big") >> 1 for digest in digests)


def new_secret(environments: int, scenarios: Sequence[str], made: datetime.datetime) -> Secret:
    """Draw a secret of 256 bits from the system's randomness.

    ScenarioError if a scenario is not in the catalogue.
    """
    known = scenario_ids()
    for name in scenarios:
        if name not in known:
            raise ScenarioError(f"scenarios: {name!r} is not in the catalogue; 'bench list' prints the ids")
    return Secret(
        secret=secrets.token_hex(_SECRET_BYTES),
        environments=environments,
        scenarios=list(scenarios),
        made=made.astimezone(datetime.UTC).isoformat(timespec="seconds"),
    )


def write_round(secret: Secret, stem: Path) -> tuple[Path, Path]:
    """Write ``STEM.secret``, readable only by its owner, and ``STEM.seal.json``; return both paths.

    ScenarioError if one of the files exists: an overwritten secret cannot be recovered.
    """
    paths = stem.with_name(f"{stem.name}.secret"), stem.with_name(f"{stem.name}.seal.json")
    for path in paths:
        if path.exists():
            raise ScenarioError(f"{path}: already exists, from an older round; give another name")
    # The file is created with mode 0600: before a later chmod, other users could read it.
    with open(os.open(paths[0], os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:  # noqa: PTH123
        file.write(_document(secret))
    with atomic_write(paths[1], "wb") as file:
        file.write(_document(secret.seal()))
    return paths


def _document(what: Seal | Secret) -> bytes:
    return msgspec.json.format(msgspec.json.encode(what)) + b"\n"


def read_secret(path: Path) -> Secret:
    """Read a secret file that `write_round` wrote; ScenarioError for any other file."""
    found = _read(path, Secret)
    try:
        right = len(bytes.fromhex(found.secret)) == _SECRET_BYTES
    except ValueError:
        right = False
    if not right:
        raise ScenarioError(f"{path}: the secret is not {_SECRET_BYTES} bytes in hexadecimal digits")
    return found


def opened(seal_file: Path, secret_file: Path) -> Secret:
    """Return the secret of a round, checked against the round's seal.

    ScenarioError if a file cannot be read, or the secret belongs to another seal.
    """
    seal, secret = _read(seal_file, Seal), read_secret(secret_file)
    if secret.seal() != seal:
        raise ScenarioError(f"{secret_file}: is not the secret of {seal_file}; give two files of one round")
    return secret


def of_round(selected: Mapping[str, Any], path: Path) -> dict[str, Any]:
    """Return arguments for `BenchSpec.of` with the seeds of the round in the secret file `path`.

    Raises ScenarioError if `selected` has seeds, or a scenario that is not in the round.
    """
    secret = read_secret(path)
    if selected.get("seeds") is not None:
        raise ScenarioError(f"the seeds come from {path}; leave out --seeds, or --sealed")
    scenarios = selected.get("scenarios") or secret.scenarios or None
    for name in scenarios or ():
        if secret.scenarios and name not in secret.scenarios:
            known = ", ".join(secret.scenarios)
            raise ScenarioError(f"scenarios: {name} is not in the round of {path}, which has {known}")
    return {**selected, "scenarios": scenarios, "seeds": list(secret.seeds())}


def require_seeds(secret: Secret, rows: Iterable[BenchRow]) -> None:
    """Raise ResultError unless each scenario is in the round, and has exactly the round's environments."""
    seeds = set(secret.seeds())
    for scenario, here in by_scenario(rows).items():
        own = {row.seed for row in here}
        if secret.scenarios and scenario not in secret.scenarios:
            raise ResultError(f"{scenario} is not in the round; pack its rows separately")
        if own != seeds:
            known = len(own & seeds)
            others = f"{len(own) - known} other environments"
            msg = f"{scenario} has {known} of the round's {len(seeds)} environments, and {others}"
            raise ResultError(f"{msg}; fly it with 'bench run --sealed'")


_T = TypeVar("_T", Seal, Secret)


def _read(path: Path, kind: type[_T]) -> _T:
    what = "a seal" if kind is Seal else "the secret of a round"
    try:
        data = read_file(path, _MAX_BYTES)
        found = msgspec.json.decode(data, type=kind)
    except UnreadableError as error:
        raise ScenarioError(f"{path}: {error}") from None
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        why = misfit(error) if isinstance(error, msgspec.ValidationError) else not_json(error, data)
        raise ScenarioError(f"{path}: is not {what} of 'bench seal' ({why})") from None
    if found.format != _FORMAT or not 1 <= found.environments <= MOST_ENVIRONMENTS:
        msg = f"{path}: is of format {found.format} with {found.environments} environments"
        raise ScenarioError(f"{msg}; this version reads format {_FORMAT} with 1 to {MOST_ENVIRONMENTS}")
    return found
