"""Controls of one vehicle: orders that may be refused, vehicle state, and notices to the operator."""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from typing import TYPE_CHECKING

from sim_vehicle.autopilot.parameters import RuntimeParameters
from sim_vehicle.errors import VehicleError

if TYPE_CHECKING:
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.autopilot import Firmware
    from sim_vehicle.execution.executor import MissionExecutor
    from sim_vehicle.execution.state import LandedState, VehicleState


class Severity(IntEnum):
    """Severity of a notice, with the values of MAV_SEVERITY."""

    CRITICAL = 2
    WARNING = 4
    NOTICE = 5
    INFO = 6


class MissionState(IntEnum):
    """Mission state, with the values of MISSION_STATE."""

    NO_MISSION = 1
    NOT_STARTED = 2
    ACTIVE = 3
    PAUSED = 4
    COMPLETE = 5


class RefusedError(VehicleError):
    """Refusal of an order by the vehicle.

    Parameters
    ----------
    reason : str
        Reason for the operator.
    denied : bool
        Whether the order is invalid; False if the vehicle may obey the order later.
    text : str
        Status text that the autopilot also sends; empty if it sends none, as with most refusals.
    """

    def __init__(self, reason: str, *, denied: bool = False, text: str = "") -> None:
        super().__init__(reason)
        self.denied = denied
        self.text = text


class Controls:
    """One vehicle under a pilot, with its executor, firmware rules, parameters, mode and notices."""

    def __init__(self, executor: MissionExecutor, firmware: Firmware) -> None:
        self.executor = executor
        self.frame = executor.mission.frame
        self.firmware = firmware
        self.rules, self.behaviour = firmware.rules, firmware.behaviour
        self.parameters = RuntimeParameters.of(executor.spec, firmware.rules.defaults)
        self.mode = firmware.mavlink.modes.boot
        self._notices: list[tuple[Severity, str]] = []
        # State of the vehicle after the last order or `advance`, and the time of the last `advance`.
        self.state: VehicleState = executor.state()
        self.now_s = 0.0
        # Roll and pitch of a commanded attitude; None if the motion determines them.
        self.flown_attitude: tuple[float, float] | None = None
        # Whether a position (GPS) is available, and whether all motors work.
        self.position_ok = self.motor_ok = True
        # Text of the latest complaint; empty after an order that was obeyed.
        self.complaint = ""

    @property
    def spec(self) -> VehicleSpec:
        """Vehicle specification with the defaults and limits now in force."""
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
        """Position of home relative to the start: east, north, up."""
        return self.executor.mission.return_points.home_m

    def order(self, order: Callable[[], None]) -> None:
        """Give an order to the executor; raises RefusedError if the vehicle cannot obey the order."""
        try:
            order()
        except RefusedError:
            raise
        except VehicleError as error:
            raise RefusedError(str(error)) from None
        self.refresh()

    def note(self, severity: Severity, text: str) -> None:
        """Add a notice to the operator, unless the text is empty."""
        if text:
            self._notices.append((severity, text))

    def warn(self, text: str) -> None:
        """Add a warning to the operator, unless the text is empty."""
        self.note(Severity.WARNING, text)

    def complain(self, text: str) -> None:
        """Warn the operator why an order is refused, unless the last complaint had the same text."""
        if text != self.complaint:
            self.complaint = text
            self.warn(text)

    def notices(self) -> list[tuple[Severity, str]]:
        """Return the notices since the last call, and clear them."""
        taken, self._notices = self._notices, []
        return taken

    def refresh(self) -> None:
        """Set the state to the executor's present state."""
        state = self.executor.state()
        if self.flown_attitude is not None:
            roll_rad, pitch_rad = self.flown_attitude
            state = state._replace(roll_rad=roll_rad, pitch_rad=pitch_rad)
        self.state = state
