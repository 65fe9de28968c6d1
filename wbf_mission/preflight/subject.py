"""Subject of a preflight check: a plan with its vehicle, autopilot, weather, farm and predicted flight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol, Self

import numpy as np
import shapely
from numpy.typing import NDArray

from geo import Farm, Obstacle
from geo.frame import LocalFrame
from mission.autopilots import GENERIC, profile_for
from mission.autopilots.profile import Profile
from mission.link.codec.dialect import mavlink as m
from mission.model import Command, Frame, GeoPoint, Mission, MissionItem
from sensors.camera.optics import Imaging
from sim_vehicle.airframe.spec import VehicleSpec
from sim_vehicle.autopilot import estimate_errs, firmware_of
from sim_vehicle.camera.component import MIN_INTERVAL_S
from sim_vehicle.execution.items import (
    DO_COMMANDS,
    NAV_COMMANDS,
    ItemProblem,
    item_positions,
    mission_problems,
)
from sim_vehicle.execution.state import BatteryDepleted, CannotFly
from sim_vehicle.motion.legs import Position
from sim_vehicle.prediction.flight import PredictedFlight, Prediction, climbs_by_itself, fly_all, home_frame
from sim_vehicle.prediction.predict import plan_prediction, rehearsals
from sim_vehicle.weather.wind import Wind
from wbf_mission.planning.builder import flown_vehicle, home_of
from wbf_mission.planning.conditions import FlightLevel, flight_level, wind_of
from wbf_mission.planning.coverage import predicted_coverage
from wbf_mission.preflight.finding import PreflightError
from wbf_mission.scenario import MissionOptions, VehicleOptions, WeatherOptions
from wbf_mission.scenario.parts import VehicleParts

_ENDINGS = frozenset({int(Command.NAV_RETURN_TO_LAUNCH), int(Command.NAV_LOITER_UNLIM)})
TAKEOFFS = frozenset({int(Command.NAV_TAKEOFF), 84})
LANDINGS = frozenset({int(Command.NAV_LAND), 85})
PLACED = frozenset({16, 17, 18, 19, 22, 31, 82})
"""Commands with a position and a height."""
LAST_NAV = 95
"""Last NAV command (MAV_CMD)."""


def followers(items: Sequence[MissionItem], seq: int) -> tuple[int, ...]:
    """Return the items that may follow item ``seq``, counted from 0; ``len(items)`` is the end.

    After a landing, only a take-off continues the mission. An endless jump to an invalid item leads nowhere.
    """
    item = items[seq]
    if item.command in _ENDINGS:
        return ()
    if item.command in LANDINGS:
        later = (k for k in range(seq + 1, len(items)) if items[k].command <= LAST_NAV)
        following = next(later, None)
        goes_on = following is not None and items[following].command in TAKEOFFS
        return (seq + 1,) if goes_on else (len(items),)
    if item.command == Command.DO_JUMP:
        target, repeat = item.param1 or 0.0, item.param2 or 0.0
        inside = target == int(target) and 0.0 <= target < len(items)
        jumps = (int(target),) if inside and repeat != 0.0 else ()
        return (*jumps, seq + 1) if repeat >= 0.0 else jumps
    return (seq + 1,)


def reachable(items: Sequence[MissionItem]) -> frozenset[int]:
    """Return the items that a vehicle can reach, and ``len(items)`` if it can reach the mission's end.

    A vehicle begins at item 0; a return may also enter the mission at a DO_LAND_START.

    Examples
    --------
    >>> there = MissionItem.waypoint(28.05, -82.15, 10.0)
    >>> sorted(reachable([there, MissionItem(Command.NAV_RETURN_TO_LAUNCH), there]))
    [0, 1]
    """
    open_ = [0, *(k for k, one in enumerate(items) if one.command == Command.DO_LAND_START)] if items else []
    seen: set[int] = set()
    while open_:
        seq = open_.pop()
        if seq in seen:
            continue
        seen.add(seq)
        if seq < len(items):
            open_ += followers(items, seq)
    return frozenset(seen)


def never_ends(items: Sequence[MissionItem]) -> bool:
    """Return whether jumps repeat for ever, so that the mission cannot end.

    Examples
    --------
    >>> there = MissionItem.waypoint(28.05, -82.15, 10.0)
    >>> never_ends([there, MissionItem(Command.DO_JUMP, param1=0.0, param2=-1.0)])
    True
    """
    seen = reachable(items)
    ends = any(seq < len(items) and items[seq].command in _ENDINGS for seq in seen)
    return bool(items) and len(items) not in seen and not ends


_TRACK_STEP_S = 0.2
_TRACK_POINTS = 100_000  # Enough for five hours at the shortest step; longer flights get longer steps.
# This DO command has no effect on a flight.
_NO_OPERATION = int(m.MAV_CMD_SET_CAMERA_MODE)


@dataclass(frozen=True, slots=True)
class FlownTrack:
    """A predicted flight of the plan."""

    points_m: NDArray[np.float64]
    """East, north, up from home."""
    items: NDArray[np.int64]
    """Item flown at each point, from 0."""


class Answers(Protocol):
    """Answers of a vehicle; `wbf_mission.addons.base.inquiry.ask_vehicle` gets them."""

    @property
    def autopilot(self) -> int:
        """MAV_AUTOPILOT."""

    @property
    def vehicle_type(self) -> int:
        """MAV_TYPE."""

    @property
    def parameters(self) -> Mapping[str, float]:
        """The parameters that the vehicle sent on request."""

    @property
    def position(self) -> GeoPoint | None:
        """Position of the vehicle, or None if it is unknown."""

    def as_set(self, options: VehicleOptions) -> VehicleOptions:
        """Return the options with the vehicle's parameters in place of the assumed parameters."""


@dataclass(frozen=True, slots=True)
class Circumstances:
    """Vehicle, farm and weather for which a plan is checked."""

    vehicle: VehicleOptions = field(default_factory=VehicleOptions)  # Options of one vehicle
    weather: WeatherOptions = field(default_factory=WeatherOptions)
    farm: Farm | None = None  # Farm with the obstacles; None: no obstacles.
    # Least distance of the flown path from fence and obstacles
    margin_m: float = MissionOptions().margin_m
    max_altitude_m: float = MissionOptions().max_altitude_m  # Highest allowed altitude above home.
    image_interval_s: float = MIN_INTERVAL_S  # The camera's shortest interval.
    assumed: bool = False  # Whether the vehicle is only assumed; its errors are then warnings.
    snapshot: Answers | None = None  # The vehicle's answers.
    footprint: int = 1  # Side of an image, in cells of the farm.
    imaging: Imaging | None = None  # Mapping camera; None: the leaf camera.
    # Prediction that planning made for this vehicle and weather; None: the check makes the prediction
    prediction: Prediction | None = None
    predicted_coverage: float | None = None  # Coverage of `prediction`, if planning computed it.
    planner: str | None = None  # The planner with its parameters, if it is known.
    # Joint coverage with other vehicles' plans, or None for a single vehicle
    coverage: float | None = None

    @classmethod
    def of(cls, one: VehicleParts, farm: Farm, snapshot: Answers | None = None) -> Self:
        """Return the circumstances of one vehicle of a run."""
        return cls(
            one.vehicle,
            one.weather,
            farm,
            one.mission.margin_m,
            one.mission.max_altitude_m,
            snapshot=snapshot,
            footprint=one.camera.footprint,
        )


@dataclass(frozen=True, slots=True)
class Subject:
    """A plan with everything that its checks need."""

    mission: Mission  # Mission, with a home if the home is known
    given: Circumstances
    vehicle: VehicleSpec  # The vehicle with its autopilot and the parameters that it sent.
    planned: VehicleSpec  # The vehicle with the parameters that plans assume.
    profile: Profile  # Mission protocol of the autopilot.
    wind: Wind
    frame: LocalFrame  # Frame with home as the origin
    positions: tuple[
        Position, ...
    ]  # Positions of the items: east, north, up from home; NaN for items without position.
    problems: tuple[ItemProblem, ...]  # Items that the vehicle cannot fly.
    # Predicted flights with an exact estimate, one per sample of gusts; empty if the plan cannot be flown
    tracks: tuple[FlownTrack, ...] = ()
    # The prediction that planning shows (`sim_vehicle.prediction.predict.plan_prediction`)
    prediction: Prediction | None = None
    # The coverage of the predicted flight, or None without a farm or a prediction
    coverage: float | None = None
    # Item, from 0, at which a predicted flight ended early, and the reason
    stopped: tuple[int, str] | None = None

    @property
    def items(self) -> tuple[MissionItem, ...]:
        """The items of the mission."""
        return self.mission.items

    @property
    def vehicle_type(self) -> int:
        """MAV_TYPE from the vehicle's heartbeat; for an assumed vehicle, the MAV_TYPE of its firmware."""
        if self.given.snapshot is not None:
            return self.given.snapshot.vehicle_type
        firmware = firmware_of(self.vehicle)
        return int(m.MAV_TYPE_QUADROTOR) if firmware is None else firmware.mavlink.identity.mav_type

    @property
    def parameters(self) -> Mapping[str, float]:
        """Parameters received from the vehicle."""
        return {} if self.given.snapshot is None else self.given.snapshot.parameters

    @property
    def obstacles(self) -> list[Obstacle]:
        """Obstacles of the farm, in metres from home."""
        farm, frame = self.given.farm, self.frame

        def moved(points: NDArray[np.float64]) -> NDArray[np.float64]:
            assert farm is not None
            return np.column_stack(frame.from_wgs84(*farm.frame.to_wgs84(points[:, 0], points[:, 1])))

        obstacles = () if farm is None else farm.obstacles
        return [
            replace(obstacle, polygon=shapely.transform(obstacle.polygon, moved)) for obstacle in obstacles
        ]


def subject_of(mission: Mission, given: Circumstances) -> Subject:
    """Predict the flights of a plan, and return the subject of its check; raises as `check_mission` does.

    A mission without home gets the farm's home or, without a farm, the position of the vehicle.
    """
    if len(given.vehicle.fleet) > 1:
        msg = f"vehicle {given.vehicle.name}: a plan is for one vehicle; name only one vehicle"
        raise PreflightError(msg)
    options = given.vehicle if given.snapshot is None else given.snapshot.as_set(given.vehicle)
    placed, planned = _with_home(mission, given), flown_vehicle(given.vehicle)
    vehicle = planned if options == given.vehicle else flown_vehicle(options)
    frame = home_frame(placed)
    flown = replace(placed, items=tuple(_predictable(item) for item in placed.items))
    positions = tuple(item_positions(flown.items, frame))
    problems = mission_problems(flown.items, positions, vehicle, needs_takeoff=not climbs_by_itself(vehicle))
    firmware = firmware_of(vehicle)
    profile = GENERIC if firmware is None else firmware.profile
    subject = Subject(
        mission=placed,
        given=given,
        vehicle=vehicle,
        planned=planned,
        profile=profile if given.snapshot is None else profile_for(given.snapshot.autopilot),
        wind=wind_of(given.weather, level_of_plan(mission, given.vehicle)),
        frame=frame,
        positions=positions,
        problems=tuple(problems),
    )
    return subject if problems else _predicted(subject, flown)


def level_of_plan(mission: Mission, options: VehicleOptions) -> FlightLevel:
    """Return the height and speed of a plan, for which the wind is predicted."""
    level = flight_level(MissionOptions(), options)
    heights = [
        item.z
        for item in mission.items
        if item.command in PLACED and item.frame == Frame.GLOBAL_RELATIVE_ALT and item.z > 0.0
    ]
    return replace(level, altitude_m=max(heights, default=level.altitude_m))


def _with_home(mission: Mission, given: Circumstances) -> Mission:
    """Return the mission with a home: the mission's home, the farm's home, or the vehicle's position."""
    if mission.home is not None:
        return mission
    if given.farm is not None:
        return replace(mission, home=home_of(mission, given.farm))
    if given.snapshot is not None and given.snapshot.position is not None:
        return replace(mission, home=given.snapshot.position)
    if not any(item.has_position and (item.x, item.y) != (0.0, 0.0) for item in mission.items):
        msg = "the mission has neither a home nor a position, so its start is unknown: give the plan a home"
        raise PreflightError(msg)
    return mission


def _predictable(item: MissionItem) -> MissionItem:
    """Return an item for the prediction; a height above terrain becomes a height above home.

    An item that the prediction cannot fly becomes an item without effect.
    """
    if item.frame == Frame.GLOBAL_TERRAIN_ALT:
        item = replace(item, frame=int(Frame.GLOBAL_RELATIVE_ALT))
    return item if item.command in NAV_COMMANDS | DO_COMMANDS else MissionItem(_NO_OPERATION)


def _predicted(subject: Subject, mission: Mission) -> Subject:
    """Return the subject with its predicted flights."""
    vehicle, wind, frame = subject.vehicle, subject.wind, subject.frame
    airs, endless = [(air, None) for air in rehearsals(wind)], not never_ends(mission.items)

    def flights(step_s: float) -> list[PredictedFlight]:
        (found,) = fly_all(
            [mission], vehicle, airs, frame, step_s, endless=endless, track_points=_TRACK_POINTS
        )
        return found

    flown = flights(_TRACK_STEP_S)
    longest_s = max(flight.prediction().duration_s for flight in flown)
    if longest_s > _TRACK_STEP_S * _TRACK_POINTS:
        flown = flights(longest_s / _TRACK_POINTS + _TRACK_STEP_S)
    # Flights are lazy: a flight is predicted when its track or prediction is first read.
    ended = [flight.prediction() for flight in flown]
    stops = [stop for flight in flown if (stop := _stop_of(flight)) is not None]
    given = subject.given
    errs = given.vehicle.estimate_errors and estimate_errs(vehicle)
    prediction = given.prediction or plan_prediction(
        mission, vehicle, wind=wind, frame=frame, estimate_errors=errs
    )
    coverage = given.predicted_coverage
    if coverage is None and given.farm is not None:
        coverage = predicted_coverage(given.farm, subject.mission, prediction, given.footprint, given.imaging)
    return replace(
        subject,
        tracks=tuple(FlownTrack(one.track_m, one.items) for one in ended),
        prediction=prediction,
        coverage=coverage,
        stopped=stops[-1] if stops else None,
    )


def _stop_of(flight: PredictedFlight) -> tuple[int, str] | None:
    """Return the item at which a flight ended early, and the reason; None if the battery ran out."""
    for event in flight.events or ():
        if isinstance(event, CannotFly):
            return max(event.seq, 0), event.reason
        if isinstance(event, BatteryDepleted):
            return None
    executor = flight.executor
    if flight.completed or executor is None:
        return None
    return max(executor.mission.current_seq, 0), "this item never ends"
