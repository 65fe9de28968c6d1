"""Spray that drifts over a farm: a plume that moves with the wind, widens, and leaves where it came in."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sensors.dynamics.continuous import ContinuousDynamics


@dataclass(frozen=True, slots=True)
class Haze(ContinuousDynamics):
    kind: ClassVar[str] = "haze"

    speed: float = 0.1
    width: float = 0.2

    def days(self, shape, rng):
        x, y = ((np.arange(cells) + 0.5) / cells for cells in shape)
        at, heading = rng.random(2), rng.uniform(0.0, 2.0 * np.pi)
        while True:
            along = np.exp(-0.5 * ((x - at[0]) / self.width) ** 2)
            across = np.exp(-0.5 * ((y - at[1]) / self.width) ** 2)
            yield np.outer(along, across)
            at = (at + self.speed * np.array([np.cos(heading), np.sin(heading)])) % 1.0
