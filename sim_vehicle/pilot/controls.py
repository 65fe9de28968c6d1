"""One vehicle under a pilot: orders that may be refused, its state, and notices to the operator."""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from typing import TYPE_CHECKING

from sim_vehicle.autopilot.parameters import RuntimeParameters
from sim_vehicle.errors import VehicleError

if TYPE_CHECKING:
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.autopilot.autopilot import Firmware
    from sim_vehicle.execution.executor import MissionExecutor
    from sim_vehicle.execution.state import LandedState, VehicleState

__all__ = ["Controls", "MissionState", "RefusedError", "Severity"]


class Severity(IntEnum):
    """As MAV_SEVERITY numbers them."""

    CRITICAL = 2
    WARNING = 4
    NOTICE = 5
    INFO = 6


class MissionState(IntEnum):
    """As MISSION_STATE numbers them."""

    NO_MISSION = 1
    NOT_STARTED = 2
    ACTIVE = 3
    PAUSED = 4
    COMPLETE = 5


class RefusedError(VehicleError):
    """An order that the vehicle does not take.

    Parameters
    ----------
    reason : str
        For the operator.
    denied : bool
        The order can never be taken as it is; False when it may be taken later.
    text : str
        Text of the autopilot besides its answer; empty for none, as with most refusals.
    """

    def __init__(self, reason: str, *, denied: bool = False, text: str = "") -> None:
        super().__init__(reason)
        self.denied = denied
        self.text = text


class Controls:
    """One vehicle under a pilot: executor, rules of its firmware, parameters, mode, and notices."""

    def __init__(self, executor: MissionExecutor, firmware: Firmware) -> None:
        self.executor = executor
        self.frame = executor.mission.frame
        self.firmware = firmware
        self.rules, self.behaviour = firmware.rules, firmware.behaviour
        self.parameters = RuntimeParameters.of(executor.spec, firmware.rules.defaults)
        self.mode = firmware.mavlink.modes.boot
        self._notices: list[tuple[Severity, str]] = []
        # After the last order or `advance`, and the time of that.
        self.state: VehicleState = executor.state()
        self.now_s = 0.0
        # Roll and pitch of an attitude that is flown; None where they follow from the motion.
        self.flown_attitude: tuple[float, float] | None = None
        # Whether there is a position (GPS), and whether all motors run.
        self.position_ok = self.motor_ok = True

    @property
    def spec(self) -> VehicleSpec:
        """The vehicle, with the defaults and limits that hold now."""
        return self.executor.spec

    @property
    def armed(self) -> bool:
        """Whether the motors run."""
        return self.executor.flight.armed

    @property
    def landed(self) -> LandedState:
        """Ground contact."""
        return self.state.landed

    @property
    def home_m(self) -> tuple[float, float, float]:
        """Home: east and north of the start, height above it."""
        return self.executor.mission.return_points.home_m

    def order(self, order: Callable[[], None]) -> None:
        """Give the executor an order."""
        try:
            order()
        except RefusedError:
            raise
        except VehicleError as error:
            raise RefusedError(str(error)) from None
        self.refresh()

    def note(self, severity: Severity, text: str) -> None:
        """Add a notice to the operator; none for an empty text."""
        if text:
            self._notices.append((severity, text))

    def warn(self, text: str) -> None:
        """Add a warning; none for an empty text."""
        self.note(Severity.WARNING, text)

    def notices(self) -> list[tuple[Severity, str]]:
        """Return the notices since the last call."""
        taken, self._notices = self._notices, []
        return taken

    def refresh(self) -> None:
        """Read the state anew."""
        state = self.executor.state()
        if self.flown_attitude is not None:
            roll_rad, pitch_rad = self.flown_attitude
            state = state._replace(roll_rad=roll_rad, pitch_rad=pitch_rad)
        self.state = state
