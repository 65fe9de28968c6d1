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
from wbf_mission.addons.boards.frozen import TABLE, sums_of

RESULTS = Path(__file__).parents[1] / "results"


def table() -> bytes:
    """Return the table of the packs in ``results``."""
    return msgspec.json.format(msgspec.json.encode(sums_of(RESULTS.glob("*/*.zip")))) + b"\n"


def main() -> None:
    """Write or check the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--check", action="store_true")
    if options.parse_args().check:
        sys.exit(0 if TABLE.read_bytes() == table() else f"{TABLE} is not that of {RESULTS}; write it anew")
    with atomic_write(TABLE, "wb") as file:
        file.write(table())


if __name__ == "__main__":
    main()
