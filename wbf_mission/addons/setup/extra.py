"""Calibrations and outputs as an extra of the simulated vehicle."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from sim_vehicle.component import NEVER
from sim_vehicle.mavlink.extras import VehicleExtra
from sim_vehicle.pilot.controls import RefusedError, Severity

if TYPE_CHECKING:
    from sim_vehicle.mavlink.parameters import ParameterSet
    from sim_vehicle.mavlink.plan_receiver import PlanReceiver
    from sim_vehicle.mavlink.vehicle_command import Result, VehicleCommand
    from sim_vehicle.mavlink.wire_state import WireState

_FIRST_FREE_SERVO, _LAST_SERVO = 5, 16
_FAILED = m.MAV_RESULT_FAILED
_CALIBRATION_STEP_S = 0.25
_CALIBRATION_TEXTS = (
    "[cal] calibration started: 2 gyro",
    *(f"[cal] progress <{share}>" for share in range(0, 100, 10)),
    "[cal] calibration done: gyro",
)


class SetupExtra(VehicleExtra):
    """Calibrations and outputs, if the firmware has them; most have no effect in the simulator."""

    def __init__(self, state: WireState, parameters: ParameterSet, plans: PlanReceiver) -> None:
        super().__init__(state, parameters, plans)
        self._remaining_texts: list[str] = []
        self.due_s = NEVER
        self.timed = (self,)
        self.commands = {
            m.MAV_CMD_PREFLIGHT_CALIBRATION: self._calibrate,
            m.MAV_CMD_DO_SET_ACTUATOR: lambda _: None,
            m.MAV_CMD_DO_SET_SERVO: self._servo,
            # The simulated board has one relay, number 0.
            m.MAV_CMD_DO_SET_RELAY: lambda command: None if command.number(1, -1) == 0 else _FAILED,
            m.MAV_CMD_DO_START_MAG_CAL: lambda _: None,
            m.MAV_CMD_DO_CANCEL_MAG_CAL: lambda _: None,
            # The simulated compass is never calibrated, so there is no result to accept.
            m.MAV_CMD_DO_ACCEPT_MAG_CAL: lambda _: _FAILED,
        }

    def execute(self, command: VehicleCommand) -> None:
        """Switch the fence by ArduPilot's mission item DO_FENCE_ENABLE; other outputs have no effect."""
        if command.id == m.MAV_CMD_DO_FENCE_ENABLE:
            self.state.pilot.parameters.fence_enable = int(command.number(1) > 0)
            self.state.pilot.apply_parameters()

    def _calibrate(self, command: VehicleCommand) -> None:
        """Calibrate the gyroscopes: send PX4's sequence of status texts, for which clients wait.

        A vehicle at rest has no offsets to estimate, so the calibration only takes time. Sources: PX4
        ``calibration_messages.h`` and ``gyro_calibration.cpp``.
        """
        if self.state.pilot.armed:
            raise RefusedError("Calibration refused: armed", text=self.state.mavlink.calibration_text)
        if command.number(1) == 1 and self.state.mavlink.reports_calibration:
            self._remaining_texts = list(_CALIBRATION_TEXTS)
            self.due_s = self.state.now_us / 1e6

    def poll(self, now_s: float) -> list[Message]:
        """Send the status texts that are due; return no messages."""
        while self.due_s <= now_s:
            self.state.pilot.note(Severity.INFO, self._remaining_texts.pop(0))
            self.due_s = self.due_s + _CALIBRATION_STEP_S if self._remaining_texts else NEVER
        return []

    def _servo(self, command: VehicleCommand) -> Result:
        """Handle DO_SET_SERVO, but refuse the motor outputs."""
        channel = command.number(1)
        if 1 <= channel < _FIRST_FREE_SERVO:
            self.state.pilot.warn(f"ServoRelayEvent: Channel {channel} is already in use")
        return None if _FIRST_FREE_SERVO <= channel <= _LAST_SERVO else _FAILED
