"""Mission Planner's polygons (``.poly``): a line with latitude and longitude for each corner.

The first corner stands at the end again, ``#`` begins a comment. Its regions have several, each below a line
``Name:...`` and one ``Color:...``. Source: ArduPilot/MissionPlanner, FlightPlanner.cs and Regions.cs.
"""

from __future__ import annotations

import re
from pathlib import Path

from geo.errors import FarmError
from geo.features import MAX_FEATURES, MAX_VERTICES, Document, Entry
from geo.reading import UnreadableError, read_text
from geo.texts import decimal_point, one_line, parse_number

MAX_FILE_BYTES = 32 * 2**20
_WORDS = re.compile(r"(name|color):(.*)", re.IGNORECASE)


def read_poly(path: Path) -> Document:
    """Return the polygons of a file; FarmError if it cannot be read or holds anything else."""
    try:
        text = read_text(path, MAX_FILE_BYTES)
    except UnreadableError as error:
        raise FarmError(f"cannot be read: {error}") from None
    named: list[tuple[str, list[list[float]]]] = []
    corners = 0
    for number, line in enumerate(text.split("\n"), 1):
        line = line.strip()
        if not line or line.startswith("#"):
            continue
        word = _WORDS.fullmatch(line)
        if word is not None and word[1].lower() == "name":
            named.append((one_line(word[2].strip(), 60), []))
        elif word is None:
            named = named or [("", [])]
            named[-1][1].append(_corner(line, number))
            corners += 1
        if corners > MAX_VERTICES or len(named) > MAX_FEATURES:
            raise FarmError(
                f"line {number}: more than {MAX_VERTICES} corners up to here; simplify the polygons"
            )
    if not corners:
        raise FarmError("holds no corners; give a .poly of Mission Planner")
    return Document(
        {},
        [
            Entry(
                number,
                {"name": name} if name else {},
                {"type": "Polygon", "coordinates": [ring] if ring else []},
            )
            for number, (name, ring) in enumerate(named, 1)
        ],
    )


def _corner(line: str, number: int) -> list[float]:
    try:
        latitude_deg, longitude_deg = (parse_number(decimal_point(word)) for word in line.split())
    except ValueError:
        raise FarmError(
            f"line {number}: {line!r:.60} is no latitude and longitude, as a .poly of Mission Planner has"
        ) from None
    return [longitude_deg, latitude_deg]
