"""Reads terrain heights from rasters: GeoTIFF in any coordinate system, and SRTM tiles (.hgt)."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS, Transformer
from pyproj.exceptions import ProjError

from geo.errors import GroundError
from geo.imports import load_extra
from geo.texts import FOOT_M

_MAX_PIXELS = 50_000_000  # This number of heights takes 0.4 GB as float64.
_HIGHEST_M = 9000.0  # Larger numbers are not heights: rasters use them for missing values.
_MARGIN_PX = 2  # Extra pixels for interpolation, and for borders that are curved in the raster's system.
_US_FOOT_M = 1200.0 / 3937.0
_FEET = ("ft", "foot", "feet")
# Metres in each unit of heights, keyed by the name without spaces, brackets, points and hyphens.
_UNITS_M = {
    **dict.fromkeys(("m", "metre", "metres", "meter", "meters"), 1.0),
    **{f"{word}{foot}": FOOT_M for foot in _FEET for word in ("", "international")},
    **{f"{foot}{word}": FOOT_M for foot in _FEET for word in ("int", "intl", "international")},
    **{f"{word}{foot}": _US_FOOT_M for foot in _FEET for word in ("us", "survey", "ussurvey")},
    **{f"{foot}{word}": _US_FOOT_M for foot in _FEET for word in ("us", "ussurvey", "surveyus")},
}


@dataclass(frozen=True, slots=True, eq=False)
class _Tile:
    """A rectangular part of a raster."""

    heights_m: NDArray[np.float64]  # Heights, [row, column]; NaN if there is no height.
    to_pixel: tuple[float, ...]  # Affine transform from x, y to column, row.
    transformer: Transformer  # Transform from longitude, latitude to x, y.

    def at(
        self, latitude_deg: NDArray[np.float64], longitude_deg: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the heights (m), interpolated bilinearly between pixel centres; NaN outside the tile."""
        x, y = self.transformer.transform(longitude_deg, latitude_deg)
        a, b, c, d, e, f = self.to_pixel
        with np.errstate(invalid="ignore"):
            column, row = a * x + b * y + c - 0.5, d * x + e * y + f - 0.5
        rows, columns = self.heights_m.shape
        # The raster extends half a pixel beyond the outermost centres.
        inside = (column >= -0.5) & (column <= columns - 0.5) & (row >= -0.5) & (row <= rows - 0.5)
        column = np.clip(np.where(inside, column, 0.0), 0.0, columns - 1.0)
        row = np.clip(np.where(inside, row, 0.0), 0.0, rows - 1.0)
        left = np.minimum(column.astype(np.int64), max(columns - 2, 0))
        top = np.minimum(row.astype(np.int64), max(rows - 2, 0))
        right, below = np.minimum(left + 1, columns - 1), np.minimum(top + 1, rows - 1)
        across, down = column - left, row - top
        corners = np.stack(
            [self.heights_m[i, j] for i, j in ((top, left), (top, right), (below, left), (below, right))]
        )
        shares = np.stack(
            [(1 - across) * (1 - down), across * (1 - down), (1 - across) * down, across * down]
        )
        # Pixels without a height get weight 0; the other weights are scaled to the sum 1.
        shares = np.where(np.isnan(corners), 0.0, shares)
        total = shares.sum(axis=0)
        with np.errstate(invalid="ignore", divide="ignore"):
            found = (shares * np.nan_to_num(corners)).sum(axis=0) / total
        return np.where(inside & (total > 1e-9), found, np.nan)


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """Terrain heights above mean sea level; at each point, the first raster that has a height counts."""

    tiles: tuple[_Tile, ...]
    step_m: float  # Width of the smallest pixel.
    names: str  # Names of the rasters, for messages.

    @classmethod
    def read(cls, paths: Iterable[str], bounds_deg: tuple[float, float, float, float]) -> Ground:
        """Read the parts of rasters that are within bounds.

        `paths` are GeoTIFF or other files that GDAL reads, with one band of heights in metres, or in feet if
        that is the band's unit. The file name of an SRTM tile gives its position (N28W083.hgt). `bounds_deg`
        are south, west, north and east, in degrees of WGS84. GroundError if rasterio is not installed; if a
        file cannot be read, has no coordinate system or too many pixels; or if no file has a pixel inside.
        """
        names = [str(path) for path in paths]
        found = [_read(name, bounds_deg) for name in names]
        tiles = [part for part in found if part is not None]
        if not tiles:
            south, west, north, east = bounds_deg
            raise GroundError(
                f"terrain {', '.join(names)}: no pixel lies within {south:.5f}..{north:.5f} north,"
                f" {west:.5f}..{east:.5f} east, the area of the flight; give a raster that covers it"
            )
        return cls(tuple(tile for tile, _ in tiles), min(step for _, step in tiles), ", ".join(names))

    def heights(
        self, latitude_deg: NDArray[np.float64], longitude_deg: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the heights at points, metres above mean sea level; GroundError if a point has no height."""
        found = np.full(np.shape(latitude_deg), np.nan)
        for tile in self.tiles:
            missing = np.isnan(found)
            if not missing.any():
                break
            found[missing] = tile.at(latitude_deg[missing], longitude_deg[missing])
        if np.isnan(found).any():
            first = int(np.flatnonzero(np.isnan(found))[0])
            raise GroundError(
                f"terrain {self.names}: there is no height at {latitude_deg[first]:.6f},"
                f" {longitude_deg[first]:.6f}; give a raster that covers the flight"
            )
        return found


def _read(name: str, bounds_deg: tuple[float, float, float, float]) -> tuple[_Tile, float] | None:
    """Return the part of a raster within the bounds, and the pixel width (m); None if no part is inside."""
    rasterio, errors = (
        load_extra(module, "gis", "heights of the ground need", GroundError)
        for module in ("rasterio", "rasterio.errors")
    )
    where = f"terrain {name}"
    try:
        with rasterio.open(name) as raster:
            return _part(where, raster, bounds_deg)
    except (errors.RasterioError, ProjError, OSError, ValueError, MemoryError) as error:
        if isinstance(error, GroundError):
            raise
        raise GroundError(
            f"{where}: it cannot be read as a raster of heights ({' '.join(str(error).split())})"
        ) from None


def _part(
    where: str, raster: Any, bounds_deg: tuple[float, float, float, float]
) -> tuple[_Tile, float] | None:
    from rasterio.windows import Window

    if raster.crs is None:
        raise GroundError(f"{where}: it has no coordinate system; give a raster with one, such as a GeoTIFF")
    transformer = Transformer.from_crs(CRS.from_epsg(4326), CRS.from_wkt(raster.crs.to_wkt()), always_xy=True)
    south, west, north, east = bounds_deg
    side = np.linspace(0.0, 1.0, 9)
    border = [(west + (east - west) * u, south + (north - south) * v) for u in side for v in side]
    x, y = transformer.transform(*np.array(border).T)
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        return None
    a, b, c, d, e, f = tuple(~raster.transform)[:6]
    columns, rows = a * x + b * y + c, d * x + e * y + f
    first_column = max(0, math.floor(columns.min()) - _MARGIN_PX)
    first_row = max(0, math.floor(rows.min()) - _MARGIN_PX)
    width = min(raster.width, math.ceil(columns.max()) + _MARGIN_PX) - first_column
    height = min(raster.height, math.ceil(rows.max()) + _MARGIN_PX) - first_row
    if width <= 0 or height <= 0:
        return None
    if width * height > _MAX_PIXELS:
        raise GroundError(
            f"{where}: {width * height} pixels in the area of the flight, but at most {_MAX_PIXELS} are read"
        )
    window = Window(first_column, first_row, width, height)
    band = raster.read(1, window=window, masked=True).astype(np.float64)
    unit = str((raster.units or ("",))[0] or "").strip() or "m"
    scale = _UNITS_M.get(re.sub(r"[\s()._-]", "", unit.lower()))
    if scale is None:
        raise GroundError(
            f"{where}: its heights are in {unit!r:.60}; give a raster in metres or feet, or correct the unit"
            " (gdal_edit.py -units m FILE)"
        )
    heights = (np.ma.filled(band, np.nan) * raster.scales[0] + raster.offsets[0]) * scale
    heights[~(np.abs(heights) <= _HIGHEST_M)] = np.nan
    tile = _Tile(heights, (a, b, c - first_column, d, e, f - first_row), transformer)
    return tile, _pixel_m(raster, transformer, 0.5 * (south + north), 0.5 * (west + east))


def _pixel_m(raster: Any, transformer: Transformer, latitude_deg: float, longitude_deg: float) -> float:
    """Return the approximate length of the shorter side of a pixel at a point (m)."""
    metres_deg = 111_320.0  # Metres per degree at the equator.
    small = 1e-4  # In degrees; about 11 m.
    x0, y0 = transformer.transform(longitude_deg, latitude_deg)
    x1, y1 = transformer.transform(longitude_deg + small, latitude_deg)
    x2, y2 = transformer.transform(longitude_deg, latitude_deg + small)
    a, b, _, d, e, _ = tuple(~raster.transform)[:6]
    px_east = math.hypot(a * (x1 - x0) + b * (y1 - y0), d * (x1 - x0) + e * (y1 - y0))
    px_north = math.hypot(a * (x2 - x0) + b * (y2 - y0), d * (x2 - x0) + e * (y2 - y0))
    east_m = metres_deg * math.cos(math.radians(latitude_deg)) * small
    north_m = metres_deg * small
    most = max(px_east / east_m, px_north / north_m)
    return 1.0 / max(most, 1e-9)
