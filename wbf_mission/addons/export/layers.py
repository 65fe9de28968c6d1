"""Fields of a whole farm as pixels and colours, for export to other tools."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sensors.fields import FieldSet
from wbf_mission.addons.export.style import rgb
from wbf_mission.maps.blocks import MapGrid
from wbf_mission.maps.field_maps import pixel_means
from wbf_mission.run.record import RunRecord

LONGEST = 500
"""Maximum number of pixels along the longer side of a farm; smaller farms get one pixel per cell."""
_LEAST_SHARE = 0.02  # Lower limit of a disease's colour scale on a large farm (share of sick plants)
_UNCERTAIN = ("#440154", "#3b528b", "#21918c", "#5ec962", "#fde725")  # Five colours of matplotlib's viridis

Pixels = NDArray[np.float32]


class Layers:
    """Pixels and colours of a run's fields: truth, estimate and uncertainty.

    Attributes
    ----------
    grid : MapGrid
        Size of the pixels; the first pixel is at the origin of the farm frame.
    """

    def __init__(self, record: RunRecord) -> None:
        farm, self.fields = record.farm, record.fields
        longest = max(farm.width_cells, farm.height_cells)
        self.grid = MapGrid(
            (farm.width_cells, farm.height_cells), farm.cell_size_m, -(-longest // LONGEST), 1
        )
        cells = farm.grid()
        self._masks = [field.mask(cells) for field in self.fields]
        self._tops = _tops(record, self.fields) if self.grid.pixel > 1 else [1.0] * len(self.fields)
        self._most = [0.0] * len(self.fields)

    @property
    def pixel_m(self) -> float:
        """Side of a pixel (m)."""
        return self.grid.pixel * self.grid.cell_size_m

    def means(self, k: int, values: NDArray[np.float32]) -> Pixels:
        """Return the pixel means of values [W, H] as float32[pixels along x, y]; NaN outside the field."""
        return pixel_means(self.grid, self._masks[k], values).astype(np.float32)

    def colours(self, k: int, means: Pixels) -> NDArray[np.uint8]:
        """Return the colours of truth or estimate, uint8[pixels along x, y, 4]: red, green, blue, opacity.

        For a disease on a large farm, the scale ends at the highest share of sick plants in a pixel.
        """
        shown = 1.0 - (1.0 - means) / self._tops[k]
        return _painted(shown, self.fields[k].colours)

    def uncertainty_colours(self, k: int, means: Pixels) -> NDArray[np.uint8]:
        """Return the colours of an uncertainty, as of `colours`; the first uncertainty sets the scale."""
        if not self._most[k]:
            self._most[k] = max(float(np.nanmax(means, initial=0.0)), 1e-3)
        return _painted(means / self._most[k], _UNCERTAIN)


def _tops(record: RunRecord, fields: FieldSet) -> list[float]:
    """Return the highest share of sick plants shown for each field; 1 for a field that is no disease."""
    tops = [1.0] * len(fields)
    for k, (field, one) in enumerate(zip(fields, record.true_maps or record.maps, strict=False)):
        if field.kind == "disease":
            tops[k] = max(_LEAST_SHARE, float(np.nanmax(one.share, initial=0.0)))
    return tops


def _painted(shown: NDArray[np.floating], colours: Sequence[str]) -> NDArray[np.uint8]:
    """Map values from 0 to 1 to a colour scale; unknown values are transparent."""
    known = np.isfinite(shown)
    scale = np.array([rgb(colour) for colour in colours], np.float64)
    at = np.linspace(0.0, 1.0, len(colours))
    # Unknown pixels are white for tools that ignore opacity.
    painted = np.full((*shown.shape, 4), (255, 255, 255, 0), np.uint8)
    for part in range(3):
        painted[known, part] = np.rint(np.interp(shown[known], at, scale[:, part]))
    painted[known, 3] = 255
    return painted


def reading_colours(fields: FieldSet, values: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return the colours of readings, float32[n, fields], as uint8[n, 4].

    The colour is that of the worst disease, or of the first field if no disease is sensed.
    """
    diseases = [k for k, field in enumerate(fields) if field.kind == "disease"] or [0]
    return _painted(np.fmin.reduce(values[:, diseases], axis=1), fields[diseases[0]].colours)
