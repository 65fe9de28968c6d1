"""How much of an area a path passes within half a footprint of: round ends as 16-gons."""

import numpy as np
import shapely


def seen_share(path, area, footprint_m):
    points = np.asarray(getattr(path, "points_m", path), dtype=np.float64)
    legs = shapely.linestrings(np.stack((points[:-1], points[1:]), axis=1))
    seen = shapely.union_all(shapely.buffer(legs, footprint_m / 2, quad_segs=4))
    return shapely.intersection(seen, area).area / area.area
