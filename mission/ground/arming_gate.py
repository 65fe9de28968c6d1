"""Conditions for arming a real vehicle: the vehicle is ready to arm, and the operator agrees."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from enum import Enum

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.transfer.wire import command_long

LIFE_S = 2.0
"""Age at which an order, answer or agreement expires (s): the situation may have changed."""


class Standstill:
    """Measures the time between calls of `look`, with a clock that keeps running while the machine sleeps.

    >>> times_s = iter([0.0, 1.0, 15.0, 15.5])
    >>> standstill = Standstill(lambda: next(times_s))
    >>> [standstill.look() for _ in range(4)]
    [0.0, 0.0, 14.0, 0.0]
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._looked_s: float | None = None

    def look(self) -> float:
        """Return the time since the last call (s) if longer than `LIFE_S`, otherwise 0."""
        before_s, self._looked_s = self._looked_s, self._clock()
        stood_s = 0.0 if before_s is None else self._looked_s - before_s
        return stood_s if stood_s > LIFE_S else 0.0


FARTHEST_M = 300.0
"""Greatest distance from the start of the plan at which a vehicle may be armed (m)."""
_PREARM = int(m.MAV_SYS_STATUS_PREARM_CHECK)
_ASK_AGAIN_S = 5.0
_STATUS_US = 1_000_000
# Texts of ArduPilot and PX4 with a reason against arming begin with one of these words.
_REASON = re.compile(r"(?:PreArm|Arm|Preflight Fail)\s*: *(.+)")
_MOST_REASONS = 8


class Stage(Enum):
    """Stage of the arming gate."""

    CHECKING = "the vehicle does not report that it can arm"
    ASKING = "the operator is asked"
    WAITING = "the vehicle waits for the other vehicles that start together"
    GRANTED = "the motors may start"
    REFUSED = "the operator does not agree to the start"


class ArmingGate:
    """Gate that opens when the vehicle's arming checks pass and the operator agrees.

    ArduPilot and PX4 report that their checks passed by the bit PREARM_CHECK in SYS_STATUS. The bit counts
    only in the arming mode, because the checks of other modes may not need a position. An autopilot without
    this bit counts as ready. No autopilot is ready without a position estimate. With a `clock`, the
    operator's agreement expires when the program is suspended.
    """

    def __init__(
        self, vehicle: tuple[int, int], *, agreed: bool = False, clock: Callable[[], float] | None = None
    ) -> None:
        self.stage = Stage.CHECKING
        self.reasons: list[str] = []  # The vehicle's reasons against arming; the latest reason is the last.
        self.told = 0  # Number of reasons received.
        self._due_s = -math.inf
        self._vehicle = vehicle
        self._agreed = self._agreed_before = agreed
        self._standstill = None if clock is None else Standstill(clock)
        self._held = False

    def poll(self, now_s: float) -> list[Message]:
        """Request SYS_STATUS and a run of the arming checks while the vehicle is not ready."""
        if self.stage is not Stage.CHECKING or now_s < self._due_s:
            return []
        self._due_s = now_s + _ASK_AGAIN_S
        status = (float(m.MAVLINK_MSG_ID_SYS_STATUS), float(_STATUS_US))
        return [
            command_long(self._vehicle, m.MAV_CMD_SET_MESSAGE_INTERVAL, *status),
            command_long(self._vehicle, m.MAV_CMD_RUN_PREARM_CHECKS),
        ]

    def next_deadline(self) -> float:
        """Return the time of the next request; infinity while the gate waits, -infinity once decided."""
        if self.stage is Stage.CHECKING:
            return self._due_s
        return math.inf if self.stage in (Stage.ASKING, Stage.WAITING) else -math.inf

    def on_sys_status(self, message: m.MAVLink_sys_status_message, *, has_position: bool) -> None:
        """Handle a SYS_STATUS; ``has_position`` says whether the vehicle has a position estimate."""
        if self.stage not in (Stage.CHECKING, Stage.ASKING, Stage.WAITING):
            return
        knows = bool(message.onboard_control_sensors_present & _PREARM)
        healthy = bool(message.onboard_control_sensors_health & _PREARM)
        if has_position and (healthy or not knows):
            self.stage = self._willing if self._agreed else Stage.ASKING
        else:
            self.stage = Stage.CHECKING

    def on_text(self, text: str) -> None:
        """Handle a text of the vehicle, which may be a reason against arming."""
        match = _REASON.match(text)
        if match is not None:
            reason = match.group(1).strip()
            self.told += 1
            self.reasons = [*(known for known in self.reasons if known != reason), reason][-_MOST_REASONS:]

    def outlived_s(self) -> float:
        """Return the time for which the program was suspended after the operator's agreement (s)."""
        stood_s = 0.0 if self._standstill is None else self._standstill.look()
        return stood_s if self._agreed else 0.0

    def check_again(self, now_s: float) -> None:
        """Wait for the vehicle's arming checks again after a refusal; then ask an operator again."""
        self.stage, self._agreed = Stage.CHECKING, self._agreed_before
        self._due_s = now_s

    def agree(self) -> None:
        """Record the operator's agreement; the vehicle's checks must still pass."""
        self._agreed = True
        if self.stage is Stage.ASKING:
            self.stage = self._willing

    def hold(self) -> None:
        """Keep the gate closed until `release`."""
        self._held = True

    def release(self) -> None:
        """End a `hold`: open the gate as soon as vehicle and operator are ready."""
        self._held = False
        if self.stage is Stage.WAITING:
            self.stage = Stage.GRANTED

    @property
    def _willing(self) -> Stage:
        return Stage.WAITING if self._held else Stage.GRANTED

    def refuse(self) -> None:
        """Record the operator's refusal."""
        self.stage = Stage.REFUSED
