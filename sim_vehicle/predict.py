"""What a flight will take, without flying it: the same executor and the same motion, without telemetry."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from geo.frame import LocalFrame
from sim_vehicle.battery import WH_J
from sim_vehicle.errors import VehicleError
from sim_vehicle.executor import MissionExecutor
from sim_vehicle.feasibility import mission_problems
from sim_vehicle.flight import BatteryDepleted, CannotFly, MissionComplete
from sim_vehicle.itinerary import item_places
from sim_vehicle.sequencer import EPOCH_UNIX_S

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mission.model import Mission
    from sim_vehicle.spec import VehicleSpec
    from sim_vehicle.wind import Wind

_LIMIT_S = {"multirotor": 86_400.0, "ideal": 3e8}
_TRACK_POINTS = 20_000
_GRID_STEPS = 5


@dataclass(frozen=True, slots=True)
class Prediction:
    """What a mission takes, from the take-off to the end of its last item.

    Parameters
    ----------
    duration_s : float
        Until the mission is complete (on the ground if it ends with a landing), or until it failed.
    energy_wh : float
        0 for a vehicle without a power model.
    battery_fraction : float
        What is left at the end, 0 to 1.
    path_length_m : float
        Flown, climbs included.
    track_m : float64[n, 3]
        East, north, up about home, every ``track_step_s`` and at the end.
    track_step_s : float
    feasible : bool
        Whether the vehicle completes the mission with the battery's reserve left.
    reason : str
        Why not; empty when feasible.
    """

    duration_s: float
    energy_wh: float
    battery_fraction: float
    path_length_m: float
    track_m: NDArray[np.float64]
    track_step_s: float
    feasible: bool
    reason: str


def predict_flight(
    mission: Mission,
    spec: VehicleSpec,
    *,
    wind: Wind | None = None,
    frame: LocalFrame | None = None,
    track_step_s: float = 1.0,
    epoch_unix_s: float = EPOCH_UNIX_S,
    endless: bool = False,
) -> Prediction:
    """Predict a flight of the mission from home.

    The vehicle is the one that flies in the simulation, so duration, energy and length are those of an
    undisturbed flight with the same wind; a failsafe that brings a real flight home early is not played.

    Parameters
    ----------
    mission : Mission
    spec : VehicleSpec
    wind : Wind, optional
    frame : LocalFrame, optional
        About home; by default about the mission's home, otherwise about its first place.
    track_step_s : float
        Spacing of the track in time, rounded to tenths of a second (to steps for the ideal vehicle).
    epoch_unix_s : float
        Time of day at the start, for items that wait for one.
    endless : bool
        Fly on when the battery is empty: what the whole mission takes, however much that is.

    Raises
    ------
    VehicleError
        If neither ``frame`` nor the mission tells where home is, or ``track_step_s`` is not positive.

    Examples
    --------
    >>> from mission.model import GeoPoint, Mission, MissionItem
    >>> from sim_vehicle.spec import get_vehicle
    >>> takeoff = MissionItem(22, 3, 0, 0, 0, None, 28.05, -82.15, 10.0)
    >>> there = MissionItem.waypoint(28.051, -82.15, 10.0)
    >>> flight = predict_flight(Mission((takeoff, there), GeoPoint(28.05, -82.15)), get_vehicle("quad"))
    >>> flight.feasible, 115.0 < flight.path_length_m < 122.0
    (True, True)
    """
    if not track_step_s > 0.0:
        msg = f"track_step_s {track_step_s} must be positive"
        raise VehicleError(msg)
    if endless:
        spec = replace(spec, battery=None)
    home = frame if frame is not None else home_frame(mission)
    places = item_places(mission.items, home)
    problems = mission_problems(mission.items, places, spec)
    if problems:
        return Prediction(
            0.0, 0.0, 1.0, 0.0, np.zeros((1, 3)), track_step_s, feasible=False, reason=problems[0]
        )
    executor = MissionExecutor(spec, home, wind=wind)
    executor.epoch_unix_s = epoch_unix_s
    motion = executor.motion
    tick_s = motion.step_s if spec.is_ideal else motion.step_s * _GRID_STEPS
    motion.track_every = max(1, round(track_step_s / tick_s))
    motion.track = np.empty((_TRACK_POINTS, 3))
    executor.load(mission.items, places)
    executor.arm()
    executor.start()
    events = executor.fly_through(_LIMIT_S["ideal" if spec.is_ideal else "multirotor"])
    state = executor.state()
    end_s = next((event.time_s for event in reversed(events) if isinstance(event, MissionComplete)), None)
    reason = ""
    for event in events:
        if isinstance(event, CannotFly):
            reason = f"item {event.seq}: {event.reason}"
        elif isinstance(event, BatteryDepleted):
            reason = f"the battery is empty after {event.time_s:.0f} s, at item {executor.current_seq}"
        if reason:
            end_s = event.time_s
            break
    if end_s is None:
        end_s = executor.time_s
        reason = f"item {executor.current_seq} never ends"
    # What the idling motors take between touch-down and disarming is no part of the mission.
    energy_j = motion.energy_j
    if executor.time_s > end_s and spec.power is not None and not reason:
        idle_w = spec.power.avionics_w + spec.power.camera_w + spec.power.idle_w
        energy_j -= idle_w * (executor.time_s - end_s)
    fraction = 1.0
    if spec.battery is not None:
        fraction = min(1.0, max(0.0, 1.0 - energy_j / WH_J / spec.battery.capacity_wh))
        if not reason and fraction < spec.battery.reserve_fraction:
            reserve = 100.0 * spec.battery.reserve_fraction
            left = 100.0 * fraction
            reason = f"{left:.0f} % of the battery is left at the end, the reserve is {reserve:.0f} %"
    track = np.vstack([motion.track[: motion.track_points], np.array([state.position_m])])
    return Prediction(
        duration_s=end_s,
        energy_wh=energy_j / WH_J,
        battery_fraction=fraction,
        path_length_m=state.path_length_m,
        track_m=track,
        track_step_s=motion.track_every * tick_s,
        feasible=not reason,
        reason=reason,
    )


def home_frame(mission: Mission) -> LocalFrame:
    """Return the frame about a mission's home, or about its first place.

    Raises
    ------
    VehicleError
        If the mission has neither.
    """
    if mission.home is not None:
        return LocalFrame(mission.home.latitude_deg, mission.home.longitude_deg, mission.home.altitude_m)
    for item in mission.items:
        if item.has_place and (item.x, item.y) != (0.0, 0.0):
            return LocalFrame(item.x, item.y)
    msg = "the mission has no home and no place: where does it begin?"
    raise VehicleError(msg)
