"""The vehicle as its pilot handles it: orders that may be refused, the state, what works."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from sim_vehicle.errors import VehicleError
from sim_vehicle.pilot.notices import NoticeLog, RefusedError

if TYPE_CHECKING:
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.autopilot.modes import Mode
    from sim_vehicle.autopilot.parameters import RuntimeParameters
    from sim_vehicle.execution.executor import MissionExecutor
    from sim_vehicle.execution.state import FlightEvent, LandedState, VehicleState

__all__ = ["Controls"]


class Controls:
    """One vehicle under a pilot's hands: what flies, its parameters, its mode, and what the operator is told.

    Attributes
    ----------
    state : VehicleState
        After the last order or `advance`.
    attitude : tuple of 2 floats or None
        Roll and pitch where they are flown as they are told; None where they follow from the motion.
    now_s : float
        Time of the last `advance`.
    position_ok, motor_ok : bool
        Whether there is a position (GPS), and whether all motors run.
    """

    def __init__(self, executor: MissionExecutor, parameters: RuntimeParameters, mode: Mode) -> None:
        self.executor = executor
        self.parameters = parameters
        self.mode = mode
        self.notices = NoticeLog()
        self.state: VehicleState = executor.state()
        self.attitude: tuple[float, float] | None = None
        self.now_s = 0.0
        self.position_ok = self.motor_ok = True

    @property
    def spec(self) -> VehicleSpec:
        """The vehicle, with the defaults and limits that hold now."""
        return self.executor.spec

    @property
    def armed(self) -> bool:
        """Whether the motors run."""
        return self.executor.armed

    @property
    def landed(self) -> LandedState:
        """Ground contact."""
        return self.state.landed

    @property
    def home_m(self) -> tuple[float, float]:
        """Where home is, east and north of the start."""
        return self.executor.return_points.home_m

    def order(self, order: Callable[[], None]) -> None:
        """Give the executor an order."""
        try:
            order()
        except RefusedError:
            raise
        except VehicleError as error:
            raise RefusedError(str(error)) from None
        self.refresh()

    def advance(self, now_s: float) -> list[FlightEvent]:
        """Fly up to a time; the events until then, in order."""
        self.now_s = now_s
        events = self.executor.advance(now_s)
        self.refresh()
        return events

    def refresh(self) -> None:
        """Read the state anew."""
        state = self.executor.state()
        if self.attitude is not None:
            roll_rad, pitch_rad = self.attitude
            state = state._replace(roll_rad=roll_rad, pitch_rad=pitch_rad)
        self.state = state
