"""Cameras that number what they would read, so that one flight serves for all that is seen on its path."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from sensors.camera.leaf_camera import Camera, LeafCameraOptions, footprint_offsets

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

__all__ = ["MOST_READINGS", "ImageList", "NumberingCamera"]

MOST_READINGS = 1 << 24
"""A reading is a 32-bit float, which holds every whole number below this."""


@dataclass(slots=True)
class ImageList:
    """The images of the cameras of a flight, in the order in which they were taken.

    Parameters
    ----------
    cells : int
        Of a footprint.
    """

    cells: int
    _x: list[int] = field(default_factory=list)
    _y: list[int] = field(default_factory=list)
    _camera: list[int] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self._x)

    @property
    def is_exact(self) -> bool:
        """Whether every number of a reading is one that a reading can hold."""
        return len(self) * self.cells <= MOST_READINGS

    def add(self, ix: Sequence[int], iy: Sequence[int], camera: int) -> None:
        """Note images of a camera, by the cells that it looked at."""
        self._x += ix
        self._y += iy
        self._camera += [camera] * len(ix)

    def read(self, cameras: Sequence[Camera]) -> NDArray[np.float32]:
        """Return what cameras read in these images, float32[images * cells, fields], by number.

        Parameters
        ----------
        cameras : sequence of Camera
            By their numbers; each takes its images in their order.
        """
        x, y, by = (np.array(column, np.int64) for column in (self._x, self._y, self._camera))
        fields = len(cameras[0].options.fields)
        readings = np.empty((len(x), self.cells, fields), np.float32)
        for number, camera in enumerate(cameras):
            own = by == number
            readings[own] = camera.capture(x[own].tolist(), y[own].tolist())
        return readings.reshape(-1, fields)


class NumberingCamera:
    """A leaf camera that gives as every field's value the number of the reading among all of a flight.

    Cells beyond the farm give no value, as with any leaf camera.

    Parameters
    ----------
    images : ImageList
        Takes the images, of this camera and of others that fly with it.
    number : int
        Of this camera there.
    shape : tuple of int
        Width and height of the farm in cells.
    """

    def __init__(
        self, images: ImageList, number: int, shape: tuple[int, int], options: LeafCameraOptions
    ) -> None:
        self.options = options
        self._images = images
        self._number = number
        self._shape = shape

    def capture(self, ix: Sequence[int], iy: Sequence[int]) -> NDArray[np.float32]:
        """Take one image centred on each of the cells; see `LeafCamera.capture`."""
        images = self._images
        first, fields = len(images) * images.cells, len(self.options.fields)
        images.add(ix, iy, self._number)
        dx, dy = footprint_offsets(self.options.footprint_cells)
        x, y = np.array(ix)[:, None] + dx, np.array(iy)[:, None] + dy
        numbers = np.arange(first, len(images) * images.cells, dtype=np.float32).reshape(x.shape)
        numbers[(x < 0) | (x >= self._shape[0]) | (y < 0) | (y >= self._shape[1])] = np.nan
        return np.repeat(numbers[:, :, None], fields, axis=2)
