"""Compiles the motion of vehicles before a user or client has to wait for it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from geo.frame import LocalFrame
from mission.model import GeoPoint, Mission, MissionItem
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.airframe.kind import NO_AUTOPILOT, get_kind, kind_names
from sim_vehicle.airframe.navigation_errors import EstimateErrors
from sim_vehicle.autopilot import autopilot_names, flight_procedures, get_autopilot, with_autopilot
from sim_vehicle.execution.executor import MissionExecutor
from sim_vehicle.prediction.predict import predict_flights
from sim_vehicle.weather.wind import Wind

if TYPE_CHECKING:
    from collections.abc import Callable

    from sim_vehicle.airframe.spec import VehicleSpec

__all__ = ["compile_all", "warm_up"]

_WIND = Wind(1.0, gust_m_s=0.5)


def warm_up(spec: VehicleSpec) -> None:
    """Compile the motion of a vehicle by simulating a two-second flight.

    Without this, the motion of a vehicle is compiled on its first flight, and a client that orders a take-off
    would time out. Compilation takes up to a minute once per machine; loading the compiled functions takes
    half a second in each process. `geo.compiled.compile_notices` names the functions that are being compiled.
    The ideal vehicle needs no compiled functions.

    Examples
    --------
    >>> warm_up(get_vehicle("ideal"))
    """
    if spec.is_ideal:
        return
    executor = MissionExecutor(spec, LocalFrame(0.0, 0.0), wind=_WIND, estimate_errors=EstimateErrors())
    executor.arm()
    if spec.drives:
        executor.goto(1.0, 0.0, 0.0)
    else:
        executor.takeoff(min(2.0, spec.max_altitude_m))
    executor.advance(1.0)
    if spec.hovers:
        executor.steer((0.5, 0.0, 0.0))
    executor.advance(1.5)
    executor.flight.hold()
    executor.advance(2.0)


def compile_all(progress: Callable[[str, int, int], None] | None = None) -> None:
    """Compile the motion of all vehicles, for single flights and for batches, unless it is cached.

    `progress` is called before each vehicle with a title, the number of finished vehicles, and the total.
    """
    dynamics = _dynamics()
    for done, (name, spec) in enumerate(dynamics):
        if progress is not None:
            progress(name, done, len(dynamics))
        warm_up(spec)
        items = (
            MissionItem(22, 3, 0, 0, 0, None, 0.0, 0.0, 2.0),
            MissionItem.waypoint(0.0001, 0.0, 2.0),
            MissionItem(20, 2),
        )
        short = Mission(items, GeoPoint(0.0, 0.0))
        predict_flights([short, short], spec, wind=_WIND)


def _dynamics() -> list[tuple[str, VehicleSpec]]:
    """Return one vehicle, with a title, for each motion class that the installed autopilots use."""
    found: dict[type, tuple[str, VehicleSpec]] = {}
    for bare in [get_vehicle(get_kind(kind).typical) for kind in kind_names()]:
        if bare.is_ideal:
            continue
        kind = bare.kind.replace("-", " ")
        flown = {kind: with_autopilot(bare, NO_AUTOPILOT)}
        for name in autopilot_names():
            autopilot = get_autopilot(name)
            if autopilot.firmware(bare.kind) is not None:
                flown[f"{kind} under {autopilot.title}"] = with_autopilot(bare, name)
        for title, spec in flown.items():
            motion = flight_procedures(spec).motion(spec, None, 0.0)
            found.setdefault(type(motion), (title, spec))
    return list(found.values())
