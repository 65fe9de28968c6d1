"""Map layers of a page, in tiles of bytes; a tile that changes gets a new version number."""

from __future__ import annotations

import base64
import math
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from geo import Farm
from geo.farms import get_farm
from geo.grid import NOT_GROWN
from sensors.fields import ALL_CROPS
from sensors.scoring.information import TILE_CELLS
from wbf_mission.addons.web.schema import Raster, Tile

Floats = NDArray[np.float32]
Bools = NDArray[np.bool_]
Window = tuple[int, int, int, int]
Pixels = Callable[[Window], Floats]

TILE = 128
"""Side of a tile (pixels)."""
LONGEST = 1024
"""Maximum number of pixels along the longer side of a farm; smaller farms get one pixel per cell."""
NOTHING, FULL = 255, 254


class _Layer:
    """One layer: means float32[pixels along x, y], NaN where there is no value, and the displayed bytes."""

    def __init__(self, shape: tuple[int, int], scale: float | None) -> None:
        self.means = np.full(shape, np.nan, np.float32)
        self.pixels = np.full(shape, NOTHING, np.uint8)
        self.fixed, self.scale = scale is not None, scale or 0.0
        self.versions = np.zeros([-(-side // TILE) for side in shape], np.int64)
        self.packed: dict[tuple[int, int], tuple[int, str]] = {}


@dataclass(frozen=True, slots=True)
class Drawing:
    """New bytes of a layer for each pixel window x0, x1, y0, y1; `Layers.put` makes them."""

    name: str
    layer: _Layer
    scale: float
    windows: list[tuple[Window, NDArray[np.uint8]]]


@dataclass(frozen=True, slots=True)
class Shown:
    """A tile in one version, packed or raw."""

    layer: _Layer
    version: int
    tile: Tile
    pixels: bytes

    def packed(self) -> Tile:
        """Return the packed tile, and cache it for other viewers."""
        if not self.tile.data:
            self.tile.data = base64.b64encode(zlib.compress(self.pixels)).decode("ascii")
            self.layer.packed[self.tile.x, self.tile.y] = self.version, self.tile.data
        return self.tile


class Layers:
    """Map layers over one farm, in tiles that have versions.

    `put` is slow, and only one thread at a time may call it. `draw`, `show` and `scales` are fast, and need
    the lock of the layers. Arrays have a value per cell. A layer has at most `longest` pixels per side.
    """

    def __init__(self, farm: Farm, longest: int = LONGEST) -> None:
        self._grid = grid = farm.grid()
        self.cells = cells = -(-max(grid.shape) // longest)
        self.shape = -(-grid.shape[0] // cells), -(-grid.shape[1] // cells)
        self.raster = Raster(*self.shape, cells * farm.cell_size_m, cells, TILE)
        self._layers: dict[str, _Layer] = {}
        if cells > 1:
            # Load the compiled code now, so that the first drawing is not delayed.
            self.of_cells(np.zeros(grid.shape, np.float32), ())((0, 1, 0, 1))

    @property
    def scales(self) -> dict[str, float]:
        """Value that byte 254 stands for, by layer."""
        return {name: layer.scale or 1.0 for name, layer in self._layers.items()}

    def of_cells(self, value: Floats, crops: Iterable[str]) -> Pixels:
        """Return the means of `value`, float32[W, H], over owned cells of `crops` (names, or `ALL_CROPS`)."""
        if value.shape != self._grid.shape:  # Compiled code would read beyond the array
            raise ValueError(f"an array of {value.shape} for a farm of {self._grid.shape} cells")
        named = set(crops)
        grown = ALL_CROPS in named
        wanted = [crop in named or (grown and crop not in NOT_GROWN) for crop in self._grid.crops]
        return partial(self._means, value, np.array(wanted))

    def of_blocks(self, value: Floats, block_m: float) -> Pixels:
        """Return the pixels of a map of blocks, float32[w, h]; NaN where the value is not positive."""
        pixel_m = self.raster.pixel_m

        def pixels(window: Window) -> Floats:
            x, y = (
                np.minimum((np.arange(first, stop) + 0.5) * pixel_m // block_m, side - 1).astype(int)
                for first, stop, side in zip(window[::2], window[1::2], value.shape, strict=True)
            )
            found: Floats = value[np.ix_(x, y)]
            return np.where(found > 0.0, found, np.float32(np.nan))

        return pixels

    def put(
        self, name: str, pixels: Pixels, *, changed: Bools | None = None, scale: float | None = None
    ) -> Drawing:
        """Draw a layer's new values; return the drawing, which `draw` then displays.

        `pixels` returns the values of a window, NaN where there is no value. Tiles outside `changed`,
        bool[tiles along x, y] (`sensors.scoring.information`), keep their values. Byte 254 stands for
        `scale`, by default a round number above all means.
        """
        layer = self._layers.get(name) or _Layer(self.shape, scale)
        windows = list(self._windows(changed if name in self._layers else None))
        for x0, x1, y0, y1 in windows:
            layer.means[x0:x1, y0:y1] = pixels((x0, x1, y0, y1))
        scale = layer.scale
        if not layer.fixed and windows:
            peak = max(np.nanmax(layer.means[x0:x1, y0:y1], initial=0.0) for x0, x1, y0, y1 in windows)
            if peak > scale:
                scale, windows = _round_up(float(peak)), list(self._windows(None))
        drawn = [
            (box, _bytes(layer.means[box[0] : box[1], box[2] : box[3]], scale or 1.0)) for box in windows
        ]
        return Drawing(name, layer, scale, drawn)

    def draw(self, drawing: Drawing, version: int) -> None:
        """Display a drawing; changed tiles get this version."""
        layer, rescaled = drawing.layer, drawing.layer.scale != drawing.scale
        self._layers[drawing.name], layer.scale = layer, drawing.scale
        for (x0, x1, y0, y1), pixels in drawing.windows:
            # On another scale, equal bytes are other values, except for zero and no value.
            other = rescaled and ((pixels != 0) & (pixels != NOTHING)).any()
            if other or not np.array_equal(layer.pixels[x0:x1, y0:y1], pixels):
                layer.pixels[x0:x1, y0:y1] = pixels
                layer.versions[x0 // TILE, y0 // TILE] = version

    def show(self, version: int) -> list[Shown]:
        """Return the tiles newer than a version."""
        shown = []
        for name, layer in self._layers.items():
            for x, y in np.argwhere(layer.versions > version).tolist():
                own, (known, data) = int(layer.versions[x, y]), layer.packed.get((x, y), (0, ""))
                data = data if known == own else ""
                part = layer.pixels[x * TILE : (x + 1) * TILE, y * TILE : (y + 1) * TILE]
                shown.append(Shown(layer, own, Tile(name, x, y, data), b"" if data else part.T.tobytes()))
        return shown

    def _windows(self, changed: Bools | None) -> Iterator[Window]:
        """Yield the windows of tiles with changed cells."""
        side = TILE * self.cells // TILE_CELLS  # TILE is a multiple of TILE_CELLS
        for i, x in enumerate(range(0, self.shape[0], TILE)):
            for j, y in enumerate(range(0, self.shape[1], TILE)):
                part = (slice(i * side, (i + 1) * side), slice(j * side, (j + 1) * side))
                if changed is None or changed[part].any():
                    yield x, min(x + TILE, self.shape[0]), y, min(y + TILE, self.shape[1])

    def _means(self, value: Floats, crops: Bools, window: Window) -> Floats:
        """Return the means of a window's pixels over owned cells of crops with `crops[number]` true."""
        x0, x1, y0, y1 = window
        crop, owned = self._grid.crop, self._grid.owned
        if self.cells == 1:
            part = slice(x0, x1), slice(y0, y1)
            cells: Floats = value[part]
            return np.where(owned[part] & crops[crop[part]] & np.isfinite(cells), cells, np.float32(np.nan))
        from wbf_mission.addons.web.block_means import block_means

        means = np.empty((x1 - x0, y1 - y0), np.float32)
        value = np.ascontiguousarray(value).view()
        value.flags.writeable = False  # Avoids a second compilation
        block_means(value, crop, owned, crops, self.cells, x0, y0, means)
        return means


def warm_up(begin: Callable[[str], None]) -> None:
    """Draw a layer of a farm larger than the page, for ``wbf-mission warm-up``."""
    begin("the live page of large farms")
    Layers(get_farm("miniberry-100"), longest=50)


def _bytes(means: Floats, scale: float) -> NDArray[np.uint8]:
    """Return means as bytes: means from 0 to `scale` become 0 to `FULL`, and NaN becomes `NOTHING`."""
    pixels, some = np.full(means.shape, NOTHING, np.uint8), np.isfinite(means)
    pixels[some] = np.clip(np.rint(means[some] * (FULL / scale)), 0, FULL)
    return pixels


def _round_up(value: float) -> float:
    """Return the next higher number that is 1, 2 or 5 times a power of ten."""
    unit = 10.0 ** math.floor(math.log10(value))
    return next((unit * step for step in (1.0, 2.0, 5.0) if unit * step >= value), unit * 10.0)
