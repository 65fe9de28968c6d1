"""Makes a vehicle's compiled motion ready before somebody waits for an answer."""

from __future__ import annotations

from geo.frame import LocalFrame
from sim_vehicle.airframe.spec import VehicleSpec
from sim_vehicle.execution.executor import MissionExecutor
from sim_vehicle.weather.wind import Wind

__all__ = ["warm_up"]


def warm_up(spec: VehicleSpec) -> None:
    """Fly a second of a flight that nobody sees.

    The motion of a multirotor is compiled when it is first flown: about ten seconds once on a machine, half a
    second in each further process. A client that has just ordered a take-off would give up waiting.

    Parameters
    ----------
    spec : VehicleSpec
        The ideal vehicle needs no compiler and returns at once.

    Examples
    --------
    >>> from sim_vehicle.airframe.catalog import get_vehicle
    >>> warm_up(get_vehicle("ideal"))
    """
    if spec.is_ideal:
        return
    executor = MissionExecutor(spec, LocalFrame(0.0, 0.0), wind=Wind(1.0, gust_m_s=0.5))
    executor.arm()
    if spec.kind == "rover":
        executor.goto(1.0, 0.0, 0.0)
    else:
        executor.takeoff(min(2.0, spec.max_altitude_m))
    executor.advance(1.0)
    if spec.kind == "multirotor":
        executor.steer((0.5, 0.0, 0.0))
    executor.advance(1.5)
    executor.hold()
    executor.advance(2.0)
