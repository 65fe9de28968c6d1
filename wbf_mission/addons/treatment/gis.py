"""The libraries of the extra ``gis``, and the farm's cells in a coordinate reference system that GIS know."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyproj import Transformer

from geo import Farm
from geo.errors import WbfMissionError
from geo.imports import load_extra
from geo.texts import one_line

_MOST_CELLS_OFF = 0.5
_SAMPLES = 9
_UTM_NORTH, _UTM_SOUTH = 32600, 32700
_HIGHEST_DEG = 84.0


class MapError(WbfMissionError, ValueError):
    """A treatment map that cannot be made or written, or costs that make no sense."""


def gis(module: str) -> Any:
    """Import a library of the extra ``gis``; MapError that says how to install it if it is not there."""
    return load_extra(module, "gis", "treatment maps need", MapError)


def require_gis() -> None:
    """Raise MapError, before anything takes long, if a library that writes maps is not there."""
    for module in ("rasterio", "pyogrio"):
        gis(module)


@contextlib.contextmanager
def gdal_errors(folder: Path) -> Iterator[None]:
    """Tell in one line what GDAL could not write."""
    failures = gis("rasterio.errors").RasterioError, gis("pyogrio.errors").DataSourceError
    try:
        yield
    except failures as error:
        raise MapError(f"{folder}: the map cannot be written: {one_line(str(error), 200)}") from error


@dataclass(frozen=True, slots=True)
class UtmCells:
    """The cells of a farm in the UTM zone of its middle.

    The cells are not resampled. An affine map carries them to UTM: turned by the frame's rotation and the
    meridian's convergence, scaled by UTM's scale. `error_m` is how far it is off where it is worst, which
    grows with the square of the farm's size: half a millimetre on a farm of a kilometre.

    Parameters
    ----------
    epsg : int
        Of the zone, on WGS84.
    affine : tuple of float
        a, b, c, d, e, f: ``east = a column + b row + c``, ``north = d column + e row + f`` of the corners of
        cells; row 0 is the farm's last row of cells, so that a frame that is not turned has north up.
    """

    epsg: int
    affine: tuple[float, float, float, float, float, float]
    error_m: float

    @classmethod
    def of(cls, farm: Farm) -> UtmCells:
        """Fit the affine map to the farm's corners, edges and inside.

        Raises
        ------
        MapError
            If it would be off by more than half a cell, or the farm lies beyond UTM.
        """
        width, height, cell_m = farm.width_cells, farm.height_cells, farm.cell_size_m
        latitude, longitude = farm.frame.to_wgs84(0.5 * width * cell_m, 0.5 * height * cell_m)
        if abs(latitude) > _HIGHEST_DEG:
            raise MapError(f"farm {farm.name!r}: latitude {latitude:.1f} lies beyond UTM (84 degrees)")
        zone = int((longitude + 180.0) // 6.0) % 60 + 1
        epsg = (_UTM_NORTH if latitude >= 0.0 else _UTM_SOUTH) + zone
        column, row = (
            one.ravel()
            for one in np.meshgrid(np.linspace(0.0, width, _SAMPLES), np.linspace(0.0, height, _SAMPLES))
        )
        places = farm.frame.to_wgs84(column * cell_m, (height - row) * cell_m)
        east_north = np.column_stack(
            Transformer.from_crs("EPSG:4326", f"EPSG:{epsg}", always_xy=True).transform(*places[::-1])
        )
        # About the middle: numbers of millions of metres would cost digits.
        middle = east_north.mean(axis=0)
        terms = np.column_stack((column, row, np.ones(len(column))))
        fitted, *_ = np.linalg.lstsq(terms, east_north - middle, rcond=None)
        error_m = float(np.hypot(*(terms @ fitted - (east_north - middle)).T).max())
        if error_m > _MOST_CELLS_OFF * cell_m:
            raise MapError(
                f"farm {farm.name!r}: in UTM its cells would be {error_m:.2f} m off; choose a smaller farm"
                f" or larger cells than {cell_m:g} m"
            )
        fitted[2] += middle
        (a, d), (b, e), (c, f) = fitted.tolist()
        return cls(epsg, (a, b, c, d, e, f), error_m)


def raster(cells: NDArray[Any]) -> NDArray[Any]:
    """Return cells [W, H] as rows of a raster, the last row of cells first: a view."""
    return cells.T[::-1]
