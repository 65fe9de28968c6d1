"""Worker for PyPolo's myopic planning (Chen, Khardon & Liu), run in a virtual environment with PyPolo.

The first request of a flight has the box and the kernel; the response is the path of the pilot survey. Later
requests have the vehicle's position and the new observations; the response is the next goal. PyPolo's robot
is a boat with its own sensor rate. Here the vehicle replaces the boat: it flies to the goal and observes all
cells on the path. Kernels, training and pilot survey are the same as in the authors' experiments
(attentive_kernels, ``experiments/main.py`` and ``experiments/configs``).
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
    """Replacement of PyPolo's robot that reaches a goal at once; the benchmark flies the real path."""

    def __init__(self) -> None:
        self.state = np.zeros(3)
        self.goal_states: list[Any] = []
        self.sampling_locations: list[Any] = []

    @property
    def has_goal(self) -> bool:
        """Whether a goal is pending."""
        return len(self.goal_states) > 0

    def control(self) -> tuple[float, None]:
        """Return a null control input."""
        return 0.0, None

    def update(self, _distance: float, _action: None) -> None:
        """Move to the goal."""
        self.sampling_locations.append(self.goal_states.pop(0))

    def commit_data(self) -> Any:
        """Return the position reached."""
        found, self.sampling_locations = np.vstack(self.sampling_locations), []
        return found


class Flight:
    """One flight: the model of the observations, and the planning strategy."""

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
        """Fit the model to new observations, and return the next goal."""
        data = np.array(seen, dtype=np.float64).reshape(-1, 3)
        places, values = self._scaled(data[:, :2]), (data[:, 2:] - self.mean) / self.deviation
        if self.model is None:
            self.model = GPR(places, values, self._kernel(), NOISE, **RATES, is_normalized=False)
        elif len(data):
            self.model.add_data(places, values)
        # One optimiser step for each new sample, including the samples of the pilot survey.
        self.model.optimize(len(data), verbose=False)
        self.vehicle.state[:2] = self._scaled(np.array([position]))[0]
        return self._unscaled(self.strategy.get(self.model))[0].tolist()

    @property
    def _half_m(self) -> float:
        return 0.5 * float((self.high - self.low).max())

    def _scaled(self, places_m: Any) -> Any:
        """Return positions scaled to -1..1, the input range of the kernels.

        PyPolo's own scaling takes limits, mean and deviation from the pilot survey. If all plants of the
        survey are healthy, the deviation is zero.
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
    """Answer requests until the input ends; a "start" request begins a new flight."""
    torch.set_num_threads(1)  # The matrices are too small for threads
    flights: dict[str, Flight] = {}

    def answer(asked: dict[str, Any]) -> dict[str, Any]:
        if asked["ask"] == "start":
            flights["now"] = Flight(asked)
            return {"pilot": flights["now"].pilot}
        return {"goal": flights["now"].goal(asked["position"], asked["seen"])}

    serve(answer)


if __name__ == "__main__":
    main()
