"""Chooses goals with PyPolo's myopic planning (Chen, Khardon & Liu), in a virtual environment that has it.

The first question of a flight gives the box and the kernel, and the answer the way of the pilot survey; each
further one gives where the vehicle is and what it has seen since; the answer is the next goal. PyPolo's own
robot is a boat with a sensor of its own rate: here the vehicle takes its place, which flies to the goal and
sees all on the way. Kernels, learning and pilot survey are as in the authors' experiments (attentive_kernels,
``experiments/main.py`` and ``experiments/configs``).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from lines import serve
from pypolo.kernels import AK, RBF
from pypolo.models import GPR
from pypolo.strategies import Bezier, MyopicPlanning

CANDIDATES = 1000
PILOT_SAMPLES = 50
AMPLITUDE, LENGTHSCALE, NOISE = 1.0, 0.5, 1.0
RATES = {"lr_hyper": 0.01, "lr_nn": 0.001}
LENGTHSCALES = np.linspace(0.01, 0.5, 10)


class Vehicle:
    """Stands for PyPolo's robot: it is at the goal at once, and the benchmark flies there."""

    def __init__(self) -> None:
        self.state = np.zeros(3)
        self.goal_states: list[Any] = []
        self.sampling_locations: list[Any] = []

    @property
    def has_goal(self) -> bool:
        """Whether there is somewhere to go."""
        return len(self.goal_states) > 0

    def control(self) -> tuple[float, None]:
        """Nothing to control."""
        return 0.0, None

    def update(self, _distance: float, _action: None) -> None:
        """Arrive."""
        self.sampling_locations.append(self.goal_states.pop(0))

    def commit_data(self) -> Any:
        """Return where it arrived."""
        found, self.sampling_locations = np.vstack(self.sampling_locations), []
        return found


class Flight:
    """One flight: the model of what was seen, and the strategy."""

    def __init__(self, asked: dict[str, Any]) -> None:
        self.low, self.high = np.array(asked["low"]), np.array(asked["high"])
        self.kernel = asked["kernel"]
        self.mean, self.deviation = float(asked["mean"]), float(asked["deviation"])
        torch.manual_seed(int(asked["seed"]))
        self.vehicle = Vehicle()
        low, high = self._scaled(self.low), self._scaled(self.high)
        extent = [low[0], high[0], low[1], high[1]]
        random = np.random.RandomState(int(asked["seed"]))
        self.strategy = MyopicPlanning(extent, random, CANDIDATES, self.vehicle)
        self.pilot = self._unscaled(Bezier(extent, random).get(PILOT_SAMPLES)).tolist()
        self.model: Any = None

    def goal(self, position: list[float], seen: list[list[float]]) -> list[float]:
        """Learn what was seen, and return the next goal."""
        data = np.array(seen, dtype=np.float64).reshape(-1, 3)
        places, values = self._scaled(data[:, :2]), (data[:, 2:] - self.mean) / self.deviation
        if self.model is None:
            self.model = GPR(places, values, self._kernel(), NOISE, **RATES, is_normalized=False)
        elif len(data):
            self.model.add_data(places, values)
        # A step for each new sample, after the pilot survey, too.
        self.model.optimize(len(data), verbose=False)
        self.vehicle.state[:2] = self._scaled(np.array([position]))[0]
        return self._unscaled(self.strategy.get(self.model))[0].tolist()

    @property
    def _half_m(self) -> float:
        return 0.5 * float((self.high - self.low).max())

    def _scaled(self, places_m: Any) -> Any:
        """Bring places to -1..1, as the kernels expect them.

        The library's own scaling takes the limits of the places and the mean and deviation of the values from
        the pilot survey; the deviation is zero where all plants of it are healthy.
        """
        return (places_m - (self.low + self.high) / 2) / self._half_m

    def _unscaled(self, places: Any) -> Any:
        return places * self._half_m + (self.low + self.high) / 2

    def _kernel(self) -> Any:
        if self.kernel == "RBF":
            return RBF(amplitude=AMPLITUDE, lengthscale=LENGTHSCALE)
        size = len(LENGTHSCALES)
        return AK(amplitude=AMPLITUDE, lengthscales=LENGTHSCALES, dim_input=2, dim_hidden=10, dim_output=size)


def main() -> None:
    """Serve one flight after the other."""
    torch.set_num_threads(1)  # the matrices are small
    flights: dict[str, Flight] = {}

    def answer(asked: dict[str, Any]) -> dict[str, Any]:
        if asked["ask"] == "start":
            flights["now"] = Flight(asked)
            return {"pilot": flights["now"].pilot}
        return {"goal": flights["now"].goal(asked["position"], asked["seen"])}

    serve(answer)


if __name__ == "__main__":
    main()
