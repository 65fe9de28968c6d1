"""Task of a training environment: a scenario in which robots move cell by cell, and observations.

Agents observe position, remaining budget, the estimate and its uncertainty; never the truth. Maps hold the
means of square blocks of cells, at most `MOST_BLOCKS` blocks along a side.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from gymnasium import spaces
from numpy.typing import NDArray

from geo import Farm
from geo.texts import one_line
from mission.planners import parse_budget
from sensors.camera.leaf_camera import LeafCameraOptions
from sensors.environment import Environment
from sensors.errors import EstimatorError
from sensors.estimators import Estimator
from sensors.field_files import load_field_set
from wbf_mission.addons.rl.catalogue import TrainingError, why_not_stepped
from wbf_mission.addons.rl.kernels import block_means
from wbf_mission.run.estimation import estimator_of, readings_a_score
from wbf_mission.run.resolve import cameras_of, make_environment
from wbf_mission.scenario import Scenario, load_scenario, scenario_with

if TYPE_CHECKING:
    from geo.grid import FarmGrid

MOVE_NAMES = ("stay", "east", "north", "west", "south")
"""Names of the actions, by number; east is along x, north along y."""
MOVES = np.array([(0, 0), (1, 0), (0, 1), (-1, 0), (0, -1)])
MOVES.flags.writeable = False


def checked_moves(actions: object, shape: tuple[int, ...], who: str) -> NDArray[np.int64]:
    """Return actions as int64[shape]; TrainingError unless all are whole numbers, 0 to 4, of this shape."""
    try:
        moves = np.asarray(actions)
        fit = moves.shape == shape and moves.dtype.kind in "iu"
    except ValueError:
        fit = False
    if not fit or not ((moves >= 0) & (moves < len(MOVES))).all():
        whom = f" to each of {shape[0]} runs" if shape else ""
        told = one_line(repr(actions), 80)
        raise TrainingError(f"{who} {told}: give a whole number from 0 (stay) to 4 (south){whom}")
    return moves.astype(np.int64)


class SurveyTask:
    """Scenario of the paper's robots (an object, id or file), with one cell and one image per step."""

    def __init__(self, scenario: Scenario | str | Path, estimator: Estimator | str = "adaptive-disk") -> None:
        given = scenario if isinstance(scenario, Scenario) else load_scenario(scenario)
        name = given.farm.name if isinstance(scenario, Scenario) else str(scenario)
        # The scenario with the estimator; its seed is not used.
        self.scenario = given = scenario_with(given, {"estimator": estimator})
        if unfit := why_not_stepped(given):
            raise TrainingError(f"{name}: {unfit}")
        assert given.mission.budget is not None
        self.robots = len(given.vehicle.fleet)
        # Images per robot and flight, including the image at home: one more than moves.
        self.steps = int(parse_budget(given.mission.budget)[0])
        self.farm = farm = given.farm.load()
        self.grid, self.fields = farm.grid(), load_field_set(given.farm.fields)
        self.cameras = cameras_of(given, self.fields)  # Camera of each robot
        of = given.farm
        # Day of each flight of the run, and its number on that day.
        self.flights = tuple(
            (day, flight)
            for day in range(of.day, of.day + of.days)
            for flight in range(1, of.flights_per_day + 1)
        )
        readings = self.robots * self.steps * given.camera.footprint**2
        learner = estimator_of(given.estimate.estimator, 0, self.fields)
        points, count = given.score.points, len(self.flights)
        # Number of readings between scored times of a flight.
        self.every = readings_a_score(points, farm, learner, count, readings, ideal=True)
        # Number of scored times of the run. Each flight is also scored at its end, and each later day at its
        # start.
        self.points = count * -(-readings // self.every) + of.days - 1
        # Start cell of every flight.
        self.home = int(farm.home_m[0] / farm.cell_size_m), int(farm.home_m[1] / farm.cell_size_m)
        self.allowed = _allowed(farm, self.grid)

    def possible(self, cells: NDArray[np.integer]) -> NDArray[np.bool_]:
        """Return a mask of possible moves, bool[n, 5], from cells int[n, 2]; staying is always possible."""
        there = cells[:, None] + MOVES
        inside = ((there >= 0) & (there < self.grid.shape)).all(axis=2)
        x, y = np.moveaxis(np.where(inside[..., None], there, 0), 2, 0)
        possible: NDArray[np.bool_] = inside & self.allowed[x, y]
        possible[:, 0] = True
        return possible

    @property
    def camera(self) -> LeafCameraOptions:
        """Camera of the first robot; the other cameras differ only in their sensed fields."""
        return self.cameras[0]

    @property
    def moves(self) -> int:
        """Number of moves of a robot in the run."""
        return len(self.flights) * (self.steps - 1)

    def environment(self, seed: int) -> Environment:
        """Return the environment of a run with this seed."""
        return make_environment(scenario_with(self.scenario, {"seed": seed}), self.farm)

    def estimator(self, seed: int) -> Estimator:
        """Return the estimator of a run with this seed, fitted to the farm."""
        choice = self.scenario.estimate.estimator
        learner = estimator_of(choice, seed, self.fields)
        try:
            return learner.fit(self.grid)
        except Exception as error:
            if isinstance(error, EstimatorError):
                raise
            raise EstimatorError(f"estimator {choice} failed: {type(error).__name__}: {error}") from error


def _allowed(farm: Farm, grid: FarmGrid) -> NDArray[np.bool_]:
    """Return a mask of the cells open to flight, bool[W, H]: owned, and without an obstacle at the centre."""
    allowed: NDArray[np.bool_] = np.array(grid.owned)
    if farm.obstacles:
        x, y = np.nonzero(allowed)
        size = farm.cell_size_m
        inside = shapely.intersects_xy(
            shapely.union_all([obstacle.polygon for obstacle in farm.obstacles]),
            (x + 0.5) * size,
            (y + 0.5) * size,
        )
        allowed[x, y] = ~inside
    allowed.flags.writeable = False
    return allowed


MOST_BLOCKS = 64


class Shown:
    """Spaces and observations of a task.

    `block` is the side of a map block in cells, by default the smallest that `MOST_BLOCKS` allows.
    `map_shape` counts blocks along x and y. Raises TrainingError unless `block` is from 1 to the farm's size.
    """

    def __init__(self, task: SurveyTask, block: int | None = None) -> None:
        width, height = task.grid.shape
        longest = max(width, height)
        self.task = task
        self.block = -(-longest // MOST_BLOCKS) if block is None else block
        if not isinstance(self.block, int) or not 1 <= self.block <= longest:
            raise TrainingError(f"block {block!r}: give a whole number of cells from 1 to {longest}")
        self.map_shape = -(-width // self.block), -(-height // self.block)

    def action_space(self) -> spaces.Discrete[Any]:
        """Return the space of the moves of one robot."""
        return spaces.Discrete(len(MOVE_NAMES))

    def space(self) -> spaces.Dict:
        """Return the observation space of one robot."""
        maps = (len(self.task.fields), *self.map_shape)
        parts: dict[str, spaces.Space[Any]] = {
            "position": _unit((2,)),
            "left": _unit((2,)),
            "value": _unit(maps),
            "uncertainty": _unit(maps),
            "seen": _unit(self.map_shape),
        }
        if self.task.robots > 1:
            parts["others"] = _unit((self.task.robots - 1, 2))
        return spaces.Dict(parts)

    def positions(self, cells: NDArray[np.integer]) -> NDArray[np.float32]:
        """Return the centres of cells as fractions of the farm's width and height, float32[..., 2]."""
        parts: NDArray[np.float64] = (cells + 0.5) / np.array(self.task.grid.shape)
        return parts.astype(np.float32)

    def maps(self, array: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the block means, limited to 0..1, float32[n, blocks along x, blocks along y]."""
        out = np.empty((len(array), *self.map_shape), np.float32)
        block_means(np.ascontiguousarray(array), self.block, out)
        return out


def _unit(shape: tuple[int, ...]) -> spaces.Box:
    return spaces.Box(0.0, 1.0, shape, np.float32)
