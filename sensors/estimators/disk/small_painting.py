"""The painting of disks in numpy, for farms of one tile: loading compiled code takes longer than that."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["paint"]


def paint(
    tiles: NDArray[np.bool_],
    reset: bool,
    x: NDArray[np.int32],
    y: NDArray[np.int32],
    first: int,
    low: NDArray[np.int32],
    high: NDArray[np.int32],
    table: NDArray[np.float32],
    doubts: NDArray[np.float32],
    defaults: NDArray[np.float32],
    fields: NDArray[np.int64],
    value: NDArray[np.float32],
    planes: NDArray[np.int64],
    uncertainty: NDArray[np.float32],
    changed: NDArray[np.bool_],
) -> None:
    """Paint the disks of observations into the only tile: see `sensors.estimators.disk.painting.paint`."""
    if not tiles[0, 0]:
        return
    width, height = value.shape[1:]
    columns = np.arange(low.min(), high.max())
    disk = (columns >= low[:, None]) & (columns < high[:, None])
    # Room around the farm for what disks have beyond it.
    rows, side = disk.shape
    owner = np.full((width + 2 * rows, height + 2 * side), -1, np.intp)
    for index, (left, bottom) in enumerate(zip((x + first).tolist(), (y + columns[0]).tolist(), strict=True)):
        part = owner[left + rows : left + 2 * rows, bottom + side : bottom + 2 * side]
        part[disk] = index
    owner = owner[rows : rows + width, side : side + height]
    taken = owner >= 0
    others = defaults[:, None, None] if reset else value[fields]
    painted = np.broadcast_to(others, (len(fields), width, height))
    if len(x):
        painted = np.where(taken, table[:, owner], others)
    unsure = np.broadcast_to(np.float32(1.0) if reset else uncertainty[planes], (len(planes), width, height))
    if len(x):
        unsure = np.where(taken, doubts[:, owner], unsure)
    if (value[fields] != painted).any() or (uncertainty[planes] != unsure).any():
        changed[0, 0] = True
    value[fields], uncertainty[planes] = painted, unsure
