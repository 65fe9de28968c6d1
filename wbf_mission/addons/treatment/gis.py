"""Imports of the extra ``gis``, and the UTM georeference of a farm's cells."""

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
    """A treatment map cannot be made or written, or a cost is invalid."""


def gis(module: str) -> Any:
    """Import a module of the extra ``gis``; raise MapError with installation advice if it is missing."""
    return load_extra(module, "gis", "treatment maps need", MapError)


def require_gis() -> None:
    """Raise MapError if a library for map files is missing; call this before long computations."""
    for module in ("rasterio", "pyogrio"):
        gis(module)


@contextlib.contextmanager
def gdal_errors(folder: Path) -> Iterator[None]:
    """Raise errors of rasterio and pyogrio as a MapError of one line."""
    failures = gis("rasterio.errors").RasterioError, gis("pyogrio.errors").DataSourceError
    try:
        yield
    except failures as error:
        raise MapError(f"{folder}: the map cannot be written: {one_line(str(error), 200)}") from error


@dataclass(frozen=True, slots=True)
class UtmCells:
    """Affine map from a farm's cells to the UTM zone of the farm's centre.

    The cells are not resampled. The affine map contains the rotation of the farm's frame, the meridian
    convergence, and the scale factor of UTM. The error of the map grows with the square of the farm's size:
    half a millimetre on a farm of one kilometre.
    """

    epsg: int  # EPSG code of the UTM zone on WGS84
    # a, b, c, d, e, f: east = a column + b row + c, north = d column + e row + f for the corners of cells.
    # Row 0 is the farm's northernmost row if the frame is not rotated.
    affine: tuple[float, float, float, float, float, float]
    error_m: float  # Largest error of the affine map at the fitted points (m)

    @classmethod
    def of(cls, farm: Farm) -> UtmCells:
        """Fit the affine map by least squares to a grid of 9 x 9 points over the farm.

        Raises MapError if the error is larger than half a cell, or the latitude is beyond 84 degrees.
        """
        width, height, cell_m = farm.width_cells, farm.height_cells, farm.cell_size_m
        latitude, longitude = farm.frame.to_wgs84(0.5 * width * cell_m, 0.5 * height * cell_m)
        if abs(latitude) > _HIGHEST_DEG:
            raise MapError(f"farm {farm.name!r}: latitude {latitude:.1f} lies beyond UTM (84 degrees)")
        zone = int((longitude + 180.0) // 6.0) % 60 + 1
        epsg = (_UTM_NORTH if latitude >= 0.0 else _UTM_SOUTH) + zone
        column, row = (
            axis.ravel()
            for axis in np.meshgrid(np.linspace(0.0, width, _SAMPLES), np.linspace(0.0, height, _SAMPLES))
        )
        places = farm.frame.to_wgs84(column * cell_m, (height - row) * cell_m)
        east_north = np.column_stack(
            Transformer.from_crs("EPSG:4326", f"EPSG:{epsg}", always_xy=True).transform(*places[::-1])
        )
        # Fit coordinates relative to the mean: values of millions of metres would lose digits.
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
    """Return a view of cells [W, H] as raster rows [H, W]; the last row of cells comes first."""
    return cells.T[::-1]
