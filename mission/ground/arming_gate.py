"""The conditions for starting motors: the vehicle can arm, and the operator agrees."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from enum import Enum

from mission.ground.standstill import Standstill
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.transfer.wire import command_long

__all__ = ["FARTHEST_M", "ArmingGate", "Stage"]

FARTHEST_M = 300.0
"""Largest distance from the start of the plan at which a vehicle is started."""
_PREARM = int(m.MAV_SYS_STATUS_PREARM_CHECK)
_ASK_AGAIN_S = 5.0
_STATUS_US = 1_000_000
# ArduPilot and PX4 begin the reason why they would not arm so.
_REASON = re.compile(r"(?:PreArm|Arm|Preflight Fail)\s*: *(.+)")
_MOST_REASONS = 8


class Stage(Enum):
    """Stage of the gate."""

    CHECKING = "the vehicle does not say that it can arm"
    ASKING = "the operator is asked"
    WAITING = "it waits for the vehicles that start with it"
    GRANTED = "the motors may start"
    REFUSED = "the operator does not want it to start"


class ArmingGate:
    """Waits for the vehicle's own checks, then for the operator.

    The vehicle's word is the bit PREARM_CHECK of the healthy parts in SYS_STATUS, as ArduPilot and PX4 send
    it, in the mode in which it is to arm: in others it may not need a position. An autopilot that does not
    know the bit is taken as ready; none is before it knows where it is. With a `clock`, an agreement ends
    when the program stands still.
    """

    def __init__(
        self, vehicle: tuple[int, int], *, agreed: bool = False, clock: Callable[[], float] | None = None
    ) -> None:
        self.stage = Stage.CHECKING
        self.reasons: list[str] = []  # Why the vehicle would not arm, in its own words, the latest last
        self.told = 0  # How often it gave a reason
        self._due_s = -math.inf
        self._vehicle = vehicle
        self._agreed = agreed
        self._standstill = None if clock is None else Standstill(clock)
        self._held = False

    def poll(self, now_s: float) -> list[Message]:
        """Request SYS_STATUS and a run of the vehicle's checks, until it can arm."""
        if self.stage is not Stage.CHECKING or now_s < self._due_s:
            return []
        self._due_s = now_s + _ASK_AGAIN_S
        status = (float(m.MAVLINK_MSG_ID_SYS_STATUS), float(_STATUS_US))
        return [
            command_long(self._vehicle, m.MAV_CMD_SET_MESSAGE_INTERVAL, *status),
            command_long(self._vehicle, m.MAV_CMD_RUN_PREARM_CHECKS),
        ]

    def next_deadline(self) -> float:
        """When `poll` has something to do."""
        if self.stage is Stage.CHECKING:
            return self._due_s
        return math.inf if self.stage in (Stage.ASKING, Stage.WAITING) else -math.inf

    def on_sys_status(self, message: m.MAVLink_sys_status_message, *, has_position: bool) -> None:
        """Take a SYS_STATUS; ``has_position``: the vehicle has a position estimate."""
        if self.stage not in (Stage.CHECKING, Stage.ASKING, Stage.WAITING):
            return
        knows = bool(message.onboard_control_sensors_present & _PREARM)
        healthy = bool(message.onboard_control_sensors_health & _PREARM)
        if has_position and (healthy or not knows):
            self.stage = self._willing if self._agreed else Stage.ASKING
        else:
            self.stage = Stage.CHECKING

    def on_text(self, text: str) -> None:
        """Take a text of the vehicle."""
        match = _REASON.match(text)
        if match is not None:
            reason = match.group(1).strip()
            self.told += 1
            self.reasons = [*(one for one in self.reasons if one != reason), reason][-_MOST_REASONS:]

    def outlived_s(self) -> float:
        """Return for how long the program stood still after the agreement; 0 if it did not."""
        stood_s = 0.0 if self._standstill is None else self._standstill.look()
        return stood_s if self._agreed else 0.0

    def check_again(self, now_s: float) -> None:
        """Begin again after the vehicle has refused to arm; the operator's word still counts."""
        self.stage = Stage.CHECKING
        self._due_s = now_s

    def agree(self) -> None:
        """The operator agrees; what the vehicle says still counts."""
        self._agreed = True
        if self.stage is Stage.ASKING:
            self.stage = self._willing

    def hold(self) -> None:
        """Do not let it start before `release`, even if it could."""
        self._held = True

    def release(self) -> None:
        """Let it start when it can."""
        self._held = False
        if self.stage is Stage.WAITING:
            self.stage = Stage.GRANTED

    @property
    def _willing(self) -> Stage:
        return Stage.WAITING if self._held else Stage.GRANTED

    def refuse(self) -> None:
        """The operator does not want it to start."""
        self.stage = Stage.REFUSED
