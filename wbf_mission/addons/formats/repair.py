"""Repairs invalid polygons, with a note for each changed feature.

Repairs are made on request. A ring that crosses or touches itself is replaced by the land that it encloses
(GEOS's "structure" method). Overlapping holes are joined and clipped to the land. Corners are rounded to
whole millimetres. Parts smaller than a thousandth of the land are dropped. If these repairs change more than
a hundredth of the area, the polygon is refused: corners in a wrong order cannot be repaired safely.
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

_MAX_CHANGE = 0.01  # Maximum change, as a fraction of the area: fields are not measured more accurately.
_SLIVER = 0.001  # Parts below this fraction of the land are slivers between crossing sides.
_GRID_M = 1e-3  # Grid step of repaired corners, coarser than the rounding of degrees in files.


def mended(feature: Feature, notes: list[str]) -> list[Feature]:
    """Return the repaired parts of a feature with closed rings, or the unchanged feature if it is valid.

    FarmError if the repair would change the area by more than a hundredth.
    """
    longitude_deg, latitude_deg = feature.rings[0][0].tolist()
    frame, changes = LocalFrame(latitude_deg, longitude_deg), list[str]()
    rings = [np.column_stack(frame.from_wgs84(ring[:, 1], ring[:, 0])) for ring in feature.rings]
    holes = [ring for ring in rings[1:] if len(np.unique(ring, axis=0)) >= 3]
    if len(holes) < len(rings) - 1:
        changes.append("holes that have no area are left out")
    if len(np.unique(rings[0], axis=0)) < 3:
        raise FarmError(f"{feature.where}: the polygon has no area")
    polygon = shapely.Polygon(rings[0], holes)
    if shapely.is_valid(polygon):
        parts = [polygon]
    else:
        reason = re.sub(r"\s*\[.*", "", shapely.is_valid_reason(polygon))
        changes.append(reason[:1].lower() + reason[1:])
        parts = _parts(rings[0], holes, feature.where)
    if not changes:
        return [feature]
    before, after = polygon.area, sum(part.area for part in parts)
    pieces = "" if len(parts) == 1 else f" in {len(parts)} parts"
    notes.append(f"{feature.where}: mended ({', '.join(changes)}): {before:.1f} -> {after:.1f} m2{pieces}")
    return [
        replace(
            feature,
            where=feature.where if len(parts) == 1 else f"{feature.where}, part {number}",
            name=feature.name if len(parts) == 1 else f"{feature.name} {number}",
            rings=tuple(_degrees(ring, frame) for ring in (part.exterior, *part.interiors)),
        )
        for number, part in enumerate(parts, 1)
    ]


def _degrees(ring: shapely.LinearRing, frame: LocalFrame) -> NDArray[np.float64]:
    xy = shapely.get_coordinates(ring)
    latitude_deg, longitude_deg = frame.to_wgs84(xy[:, 0], xy[:, 1])
    positions = np.column_stack([longitude_deg, latitude_deg])
    positions[-1] = positions[0]
    return positions


def _parts(shell: NDArray[np.float64], holes: list[NDArray[np.float64]], where: str) -> list[shapely.Polygon]:
    """Return the polygons that invalid rings enclose, largest first."""
    polygons = [shapely.Polygon(ring) for ring in (shell, *holes)]
    within = shapely.make_valid(polygons, method="structure", keep_collapsed=False)
    drawn = [polygon.area for polygon in polygons]
    changed = sum(abs(land.area - area) for land, area in zip(within, drawn, strict=True))
    land = within[0].difference(shapely.union_all(within[1:])) if holes else within[0]
    # On a grid, corners and sides keep a distance at which rounded positions leave the polygon valid.
    land = shapely.set_precision(land, _GRID_M)
    kept = [
        part
        for part in sorted(shapely.get_parts(land), key=lambda part: -part.area)
        if part.geom_type == "Polygon" and part.area > max(_SLIVER * land.area, _GRID_M * part.length)
    ]
    changed += land.area - sum(part.area for part in kept)
    if not kept or changed > _MAX_CHANGE * land.area:
        raise FarmError(
            f"{where}: cannot be mended safely: it has {drawn[0] - sum(drawn[1:]):.1f} m2 as drawn, but its "
            f"rings enclose {land.area:.1f} m2 (over {_MAX_CHANGE:.0%} differs); are its corners in order?"
        )
    return kept
