"""Broken polygons, mended where it is plain what they should be; what changes is told, a line a feature.

Many programs leave out the last position of a ring, which repeats the first (DJI Pilot 2, scripts): it is
added. A side that is more than twice as long as the longest one is no slip: part of the ring is missing.

The rest is mended only if asked for. A ring that crosses or touches itself becomes the land within it (GEOS's
"structure": nodes are set where sides cross, spikes without width vanish); holes are joined where they
overlap, and end where the land ends. Corners are then on whole millimetres. Parts below a thousandth of the
land are left out. All that, added up, changes at most a hundredth of the land, or the polygon is refused:
corners in a wrong order, say, are no slip that can be mended.
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import shapely

from geo.errors import FarmError
from geo.features import Feature
from geo.frame import LocalFrame

if TYPE_CHECKING:
    from numpy.typing import NDArray

MAX_CHANGE = 0.01
"""The part of the land that mending may change."""
MAX_MISSING = 2.0
"""By how much the side that an open ring lacks may be longer than its longest one."""
_LEFT_OUT = 0.001
_GRID_M = 1e-3


def closed(feature: Feature, notes: list[str]) -> Feature:
    """Return a feature with its rings closed; FarmError if part of one is missing."""
    if all(np.array_equal(ring[0], ring[-1]) for ring in feature.rings):
        return feature
    rings = []
    for ring in feature.rings:
        steps_m = np.hypot(*np.diff(_metres(np.vstack([ring, ring[:1]]), _frame(ring)), axis=0).T)
        gap_m, longest_m = steps_m[-1], steps_m[:-1].max()
        if gap_m > MAX_MISSING * longest_m:
            raise FarmError(
                f"{feature.where}: a ring is open over {gap_m:.1f} m, and its longest side has "
                f"{longest_m:.1f} m: part of it is missing; draw it anew"
            )
        is_open = not np.array_equal(ring[0], ring[-1])
        if is_open:
            notes.append(f"{feature.where}: a ring was open, closed over {gap_m:.2f} m")
        rings.append(np.vstack([ring, ring[:1]]) if is_open else ring)
    return replace(feature, rings=tuple(rings))


def mended(feature: Feature, notes: list[str]) -> list[Feature]:
    """Return a feature, whose rings are closed, as it is if it is valid, else its parts, mended.

    The area does not change by more than `MAX_CHANGE`; FarmError if it would.
    """
    frame = _frame(feature.rings[0])
    told: list[str] = []
    rings = [_metres(ring, frame) for ring in feature.rings]
    holes = [ring for ring in rings[1:] if len(np.unique(ring, axis=0)) >= 3]
    if len(holes) < len(rings) - 1:
        told.append("holes without area are left out")
    if len(np.unique(rings[0], axis=0)) < 3:
        raise FarmError(f"{feature.where}: the polygon has no area")
    polygon = shapely.Polygon(rings[0], holes)
    if shapely.is_valid(polygon):
        parts = [polygon]
    else:
        reason = re.sub(r"\s*\[.*", "", shapely.is_valid_reason(polygon))
        told.append(reason[:1].lower() + reason[1:])
        parts = _parts(rings[0], holes, feature.where)
    if not told:
        return [feature]
    before, after = polygon.area, sum(part.area for part in parts)
    pieces = "" if len(parts) == 1 else f" in {len(parts)} parts"
    notes.append(f"{feature.where}: mended ({', '.join(told)}): {before:.1f} -> {after:.1f} m2{pieces}")
    return [
        replace(
            feature,
            where=feature.where if len(parts) == 1 else f"{feature.where}, part {number}",
            name=feature.name if len(parts) == 1 else f"{feature.name} {number}",
            rings=tuple(_degrees(ring, frame) for ring in (part.exterior, *part.interiors)),
        )
        for number, part in enumerate(parts, 1)
    ]


def _frame(ring: NDArray[np.float64]) -> LocalFrame:
    longitude_deg, latitude_deg = ring[0].tolist()
    return LocalFrame(latitude_deg, longitude_deg)


def _metres(ring: NDArray[np.float64], frame: LocalFrame) -> NDArray[np.float64]:
    return np.column_stack(frame.from_wgs84(ring[:, 1].copy(), ring[:, 0].copy()))


def _degrees(ring: shapely.LinearRing, frame: LocalFrame) -> NDArray[np.float64]:
    xy = shapely.get_coordinates(ring)
    latitude_deg, longitude_deg = frame.to_wgs84(xy[:, 0].copy(), xy[:, 1].copy())
    positions = np.column_stack([longitude_deg, latitude_deg])
    positions[-1] = positions[0]
    return positions


def _parts(shell: NDArray[np.float64], holes: list[NDArray[np.float64]], where: str) -> list[shapely.Polygon]:
    """Return the polygons that rings mean, the largest first."""
    within = [_land(ring) for ring in (shell, *holes)]
    drawn = [shapely.Polygon(ring).area for ring in (shell, *holes)]
    changed = sum(abs(land.area - area) for land, area in zip(within, drawn, strict=True))
    land = within[0].difference(shapely.union_all(within[1:])) if holes else within[0]
    # On a grid corners and sides are so far apart that rounded positions stay valid.
    land = shapely.set_precision(land, _GRID_M)
    every = sorted(_polygons(land), key=lambda part: -part.area)
    kept = [part for part in every if part.area > max(_LEFT_OUT * land.area, _GRID_M * part.length)]
    changed += land.area - sum(part.area for part in kept)
    if not kept or changed > MAX_CHANGE * land.area:
        raise FarmError(
            f"{where}: cannot be mended safely: as drawn it has {drawn[0] - sum(drawn[1:]):.1f} m2, what its "
            f"rings enclose {land.area:.1f} m2 (over {MAX_CHANGE:.0%} differs); are its corners in order?"
        )
    return kept


def _land(ring: NDArray[np.float64]) -> shapely.Geometry:
    return shapely.make_valid(shapely.Polygon(ring), method="structure", keep_collapsed=False)


def _polygons(land: shapely.Geometry) -> list[shapely.Polygon]:
    return [part for part in shapely.get_parts(land) if part.geom_type == "Polygon" and part.area > 0]
