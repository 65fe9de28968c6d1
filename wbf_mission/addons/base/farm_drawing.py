"""SVG map of a farm: border, raster picture, block names, scale bar and north arrow."""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from functools import partial
from html import escape

import numpy as np
import shapely
from numpy.typing import NDArray

from geo import Farm
from wbf_mission.addons.base.markup import data_uri
from wbf_mission.maps.blocks import MapGrid

Colours = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class FarmDrawing:
    """Drawing area around the owner's land, in metres, y downwards; `unit` is 1 % of the longer side."""

    farm: Farm
    left: float
    right: float
    top: float
    foot: float
    unit: float

    @classmethod
    def of(cls, farm: Farm) -> FarmDrawing:
        """Return the drawing area of a farm: the bounds of the owner's land."""
        left, low, right, high = farm.owner_area.bounds
        height = farm.height_cells * farm.cell_size_m
        return cls(farm, left, right, height - high, height - low, max(right - left, high - low) / 100.0)

    def down(self, y_m: float) -> float:
        """Return the y coordinate in the drawing, which points down, for `y_m` in the farm's frame (m)."""
        return self.farm.height_cells * self.farm.cell_size_m - y_m

    def text(self, x: float, y: float, text: str, size: float = 3.0, **attributes: str) -> str:
        """Return a text element; `size` is the font size in units, `attributes` are SVG attributes."""
        how = "".join(f' {name.replace("_", "-")}="{value}"' for name, value in attributes.items())
        return f'<text x="{x:.3f}" y="{y:.3f}" font-size="{size * self.unit:.3f}"{how}>{escape(text)}</text>'

    def dot(self, x_m: float, y_m: float, label: str) -> str:
        """Return a round mark with a short label inside, at a position in the farm's frame."""
        x, y, unit = x_m, self.down(y_m), self.unit
        return (
            f'<circle cx="{x:.3f}" cy="{y:.3f}" r="{2.2 * unit:.3f}" fill="#1d1d1b" stroke="#fff"'
            f' stroke-width="{0.4 * unit:.3f}"/>'
            + self.text(x, y + 1.05 * unit, label, text_anchor="middle", fill="#fff")
        )

    def svg(
        self, name: str, shows: str, pixels: NDArray[np.uint8], pixel_m: float, palette: Colours, over: str
    ) -> str:
        """Return the map as an SVG element.

        `name` is unique in the page; `shows` is a description for screen readers. `pixels`, uint8[columns,
        rows], are indices into the RGB colours of `palette`, uint8[n, 3]; 0 is transparent. The first pixel
        lies at the frame's origin, and the side of a pixel is `pixel_m`. `over` are SVG elements drawn over
        the picture.
        """
        unit, clip = self.unit, f"land-{name}"
        across, up = (n * pixel_m for n in pixels.shape)
        rings = [
            ring
            for polygon in shapely.get_parts(self.farm.owner_area)
            for ring in (polygon.exterior, *polygon.interiors)
        ]
        border = "".join(
            "M" + "L".join(f"{x:.2f} {self.down(y):.2f}" for x, y in shapely.get_coordinates(ring)) + "Z"
            for ring in rings
        )
        wide, high = self.right - self.left + 6.0 * unit, self.foot - self.top + 13.0 * unit
        return (
            f'<svg viewBox="{self.left - 5.0 * unit:.3f} {self.top - 4.0 * unit:.3f} {wide:.3f} {high:.3f}"'
            f' role="img" aria-label="{escape(shows)}"><clipPath id="{clip}"><path d="{border}"'
            f' clip-rule="evenodd"/></clipPath><image x="0" y="{self.down(up):.3f}" width="{across:.3f}"'
            f' height="{up:.3f}" preserveAspectRatio="none" clip-path="url(#{clip})"'
            f' image-rendering="pixelated" href="{_picture(pixels, palette)}"/>'
            f'<path d="{border}" fill="none" stroke="#1d1d1b" stroke-width="{0.5 * unit:.3f}"/>'
            f"{self._edges()}{over}{self._scale()}{self._north()}</svg>"
        )

    def _edges(self) -> str:
        """Return labels along the edges of the map: the names by which reports refer to blocks."""
        grid, unit = MapGrid.of(self.farm), self.unit
        side = grid.block * grid.cell_size_m
        label = partial(self.text, size=2.3, text_anchor="middle", fill="#55534f")
        middles = [(k + 0.5) * side for k in range(max(grid.blocks))]
        texts = [
            label(x, self.top - 1.2 * unit, grid.name(k, 0)[:-1])
            for k, x in enumerate(middles)
            if self.left < x < self.right
        ]
        texts += [
            label(self.left - 2.6 * unit, self.down(y) + 0.8 * unit, str(k + 1))
            for k, y in enumerate(middles)
            if self.top < self.down(y) < self.foot
        ]
        return "".join(texts)

    def _scale(self) -> str:
        """Return a scale bar: 1, 2 or 5 times a power of ten long, at most 0.3 of the map's width."""
        longest, unit = 0.3 * (self.right - self.left), self.unit
        power = 10.0 ** math.floor(math.log10(longest))
        length = max(step * power for step in (1.0, 2.0, 5.0) if step * power <= longest)
        x, y = self.left, self.foot + 4.0 * unit
        return (
            f'<path d="M{x:.3f} {y - unit:.3f}V{y:.3f}H{x + length:.3f}V{y - unit:.3f}" fill="none"'
            f' stroke="#1d1d1b" stroke-width="{0.5 * unit:.3f}"/>'
            + self.text(x + length + unit, y, f"{length:g} m" if length < 1e3 else f"{length / 1e3:g} km")
        )

    def _north(self) -> str:
        """Return a north arrow, turned by the rotation of the farm's frame."""
        x, y = self.farm.frame.from_east_north(0.0, 1.0)
        turn, unit = math.degrees(math.atan2(x, y)), self.unit
        at = f"translate({self.right - 4.0 * unit:.3f} {self.foot + 4.8 * unit:.3f}) scale({unit:.4f})"
        return (
            f'<g transform="{at}"><path transform="rotate({turn:.2f})" d="M0 -3L1.6 3L0 1.8L-1.6 3Z"'
            ' fill="#1d1d1b"/><text x="2.4" y="1" font-size="3">N</text></g>'
        )


def _picture(pixels: NDArray[np.uint8], palette: Colours) -> str:
    from PIL import Image

    picture = Image.fromarray(np.ascontiguousarray(pixels.T[::-1]))
    picture.putpalette(palette.ravel().tolist())
    file = io.BytesIO()
    picture.save(file, "PNG", transparency=0, optimize=True)
    return data_uri(file.getvalue())
