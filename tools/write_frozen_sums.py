"""Write the table of SHA-256 digests with which the package checks the frozen packs in ``results``.

Run ``python tools/write_frozen_sums.py`` after packs were added or flown again. ``--check`` writes nothing
and exits with 1 if the table is out of date.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import msgspec

from geo.atomic import atomic_write
from wbf_mission.addons.boards.board import FROZEN
from wbf_mission.addons.boards.submission import read_pack

RESULTS = Path(__file__).parents[1] / "results"


def table() -> bytes:
    """Return the table of the packs in ``results``."""
    packs = sorted(RESULTS.glob("*/*.zip"))
    sums = {path.relative_to(RESULTS).as_posix(): read_pack(path).digest for path in packs}
    return msgspec.json.format(msgspec.json.encode(sums)) + b"\n"


def main() -> None:
    """Write or check the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--check", action="store_true")
    if options.parse_args().check:
        sys.exit(0 if FROZEN.read_bytes() == table() else f"{FROZEN} is not that of {RESULTS}; write it anew")
    with atomic_write(FROZEN, "wb") as file:
        file.write(table())


if __name__ == "__main__":
    main()
