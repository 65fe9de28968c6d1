"""Write the farms of the scenarios ``WBF/Field-NAME-v1``: scaled outlines of real fields.

    python tools/write_field_farms.py [--out FOLDER]

The outlines, their sources and licences are in `tools/fields.json`. Each farm file has the source, too. The
outlines keep their shape, direction and place. Lengths are scaled so that the land has about a thousand cells
of a foot, nearly as many as Miniberry-30. The crops are planted in blocks of equal area across the land,
strawberries first. The farm of a scenario id never changes: a new farm gets a new name.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import shapely
from shapely import affinity

from geo import Crop, Farm, Obstacle, Patch
from geo.atomic import atomic_write
from geo.frame import LocalFrame
from geo.geojson import save_farm
from geo.texts import FOOT_M

SOURCE = Path(__file__).with_name("fields.json")
OUT = Path(__file__).parents[1] / "wbf_mission" / "scenario" / "catalogue" / "WBF" / "farms"
CELLS = 1000
GAP_CELLS = 3  # Gap between the parts of a farm


class Wanted(NamedTuple):
    """Specification of a farm: outlines, number of blocks, and the axis across which blocks are cut."""

    fields: tuple[str, ...]
    blocks: int
    axis: int = 1
    island_cells: float = 0.0  # Side of square obstacles in the outline's holes


FARMS = {
    "strip": Wanted(("nl-3",), 4),
    "bend": Wanted(("fi-1",), 4),
    "wing": Wanted(("bg-1",), 2, 0),
    "bays": Wanted(("us-ca-scm-3",), 2),
    "islands": Wanted(("fi-3",), 2, 0, island_cells=3.0),
    "pair": Wanted(("dk-2", "dk-4"), 2),
}


def make_farm(name: str, wanted: Wanted, known: dict[str, dict[str, Any]]) -> Farm:
    """Return a farm with the bounds of its land as grid."""
    outlines = [shapely.Polygon(*_rings(known[field]["rings"])) for field in wanted.fields]
    factor = math.sqrt(CELLS * FOOT_M**2 / sum(outline.area for outline in outlines))
    land, right_m = list[shapely.Polygon](), 0.0
    for outline in outlines:
        scaled = affinity.scale(outline, factor, factor, origin=(0.0, 0.0))
        west_m, south_m, _, _ = scaled.bounds
        land.append(affinity.translate(scaled, right_m - west_m, -south_m))
        right_m = land[-1].bounds[2] + GAP_CELLS * FOOT_M
    reach_m = 0.5 * wanted.island_cells * FOOT_M
    islands = [
        shapely.box(x - reach_m, y - reach_m, x + reach_m, y + reach_m)
        for polygon in land
        for ring in polygon.interiors
        for x, y in [shapely.Polygon(ring).centroid.coords[0]]
    ]
    whole = shapely.difference(
        shapely.union_all([shapely.Polygon(polygon.exterior) for polygon in land]), shapely.union_all(islands)
    )
    width, height = (math.ceil(whole.bounds[k] / FOOT_M - 1e-6) for k in (2, 3))
    centres = [((x + 0.5) * FOOT_M, (y + 0.5) * FOOT_M) for x in range(width) for y in range(height)]
    latitude_deg, longitude_deg = known[wanted.fields[0]]["place"]
    return Farm(
        name=f"field-{name}",
        frame=LocalFrame(latitude_deg, longitude_deg, 0.0),
        width_cells=width,
        height_cells=height,
        patches=tuple(_patches(whole, wanted)),
        owner="owner",
        home_m=min((at for at in centres if whole.contains(shapely.Point(at))), key=sum),
        obstacles=tuple(
            Obstacle(island, margin_m=FOOT_M, name=f"island {k}") for k, island in enumerate(islands, start=1)
        ),
    )


def _rings(rings: list[list[list[float]]]) -> tuple[Any, Any]:
    return rings[0], rings[1:]


def _patches(land: shapely.Geometry, wanted: Wanted) -> Iterator[Patch]:
    """Yield the blocks of a farm: strips of equal area across the axis, with alternating crops."""
    low, high = land.bounds[wanted.axis], land.bounds[wanted.axis + 2]
    ends = [_end(land, wanted.axis, low, high, k / wanted.blocks) for k in range(1, wanted.blocks)]
    for k, (begin, end) in enumerate(pairwise([low - 1.0, *ends, high + 1.0])):
        crop = (Crop.STRAWBERRY, Crop.TOMATO)[k % 2]
        pieces = shapely.get_parts(_cut(land, wanted.axis, begin, end))
        for number, piece in enumerate((part for part in pieces if part.area > 0.0), start=1):
            yield Patch(f"{crop} {k // 2 + 1}.{number}", crop, "owner", piece)


def _cut(land: shapely.Geometry, axis: int, begin: float, end: float) -> shapely.Geometry:
    box = (begin, -1e6, end, 1e6) if axis == 0 else (-1e6, begin, 1e6, end)
    return shapely.intersection(land, shapely.box(*box))


def _end(land: shapely.Geometry, axis: int, low: float, high: float, share: float) -> float:
    """Return the coordinate below which `share` of the land's area lies, by bisection."""
    begin = low - 1.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        if _cut(land, axis, begin, middle).area < share * land.area:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def main() -> None:
    """Write the farm files, with the sources of the outlines."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--out", type=Path, default=OUT)
    out = options.parse_args().out
    known = {field["name"]: field for field in json.loads(SOURCE.read_text())["fields"]}
    for name, wanted in FARMS.items():
        path = out / f"{name}.geojson"
        save_farm(make_farm(name, wanted, known), path)
        sources = [f"{known[field]['source']}, {known[field]['licence']}, scaled" for field in wanted.fields]
        table = {**json.loads(path.read_text()), "sources": sources}
        with atomic_write(path) as file:
            file.write(json.dumps(table) + "\n")


if __name__ == "__main__":
    main()
