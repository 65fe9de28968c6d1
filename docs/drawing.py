"""Command line of the scripts that draw pictures of pages."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path


def asked_for(about: str | None, pictures: Iterable[str]) -> list[Path]:
    """Return the paths of the pictures to draw, by default of all `pictures`."""
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pictures", nargs="*", help=f"of {', '.join(pictures)}; by default all")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "images", help="folder")
    options = parser.parse_args()
    return [options.out / picture for picture in options.pictures or pictures]
