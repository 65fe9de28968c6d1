"""Cause of a flight's early end, from the vehicle's texts, battery and sensors."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from mission.ground.vehicle_state import drives
from mission.link.codec.dialect import mavlink as m
from mission.outcome import Outcome

_FAILSAFE_STATES = frozenset({m.MAV_STATE_CRITICAL, m.MAV_STATE_EMERGENCY, m.MAV_STATE_FLIGHT_TERMINATION})
_LOW_CHARGE_STATES = frozenset(
    {
        m.MAV_BATTERY_CHARGE_STATE_LOW,
        m.MAV_BATTERY_CHARGE_STATE_CRITICAL,
        m.MAV_BATTERY_CHARGE_STATE_EMERGENCY,
        m.MAV_BATTERY_CHARGE_STATE_FAILED,
    }
)
_ACTION = r": (?:holding|returning|landing|terminating the flight)$"


@dataclass(frozen=True, slots=True)
class _TextCause:
    """STATUSTEXT that names the cause of an early end.

    With ``acts``, the text itself shows that the vehicle reacted; otherwise a HEARTBEAT must show a failsafe.
    With ``first_only``, the cause counts only if no earlier text names a cause.
    """

    pattern: re.Pattern[str]
    outcome: Outcome
    reason: Callable[[re.Match[str], float], str]
    acts: bool = True
    first_only: bool = False


def _group(template: str = "{}") -> Callable[[re.Match[str], float], str]:
    return lambda match, _time_s: template.format(match.group(1))


_CAUSES = (
    _TextCause(
        re.compile(r"Battery empty"),
        Outcome.BATTERY_DEPLETED,
        lambda _match, time_s: f"battery empty at {time_s:.0f} s",
    ),
    _TextCause(re.compile(r"Battery (.+)" + _ACTION), Outcome.BATTERY_LOW, _group("battery {}")),
    _TextCause(re.compile(r"Flight terminated: (.+)"), Outcome.CRASHED, _group()),
    _TextCause(re.compile(r"Position lost"), Outcome.POSITION_LOST, lambda *_: "position lost"),
    _TextCause(
        re.compile(r"(?:Data link lost|GCS Failsafe)" + _ACTION),
        Outcome.LINK_LOST,
        lambda *_: "ground station lost",
    ),
    # The text "Data link lost" itself does not arrive, because the link is down.
    _TextCause(
        re.compile(r"Data link regained|GCS Failsafe Cleared"),
        Outcome.LINK_LOST,
        lambda *_: "ground station lost",
        acts=False,
    ),
    _TextCause(
        re.compile(r"(?:Geofence violated|Fence breached): (.+)"),
        Outcome.FENCE_BREACHED,
        _group("fence: {}"),
        acts=False,
    ),
    _TextCause(re.compile(r"Mission rejected: (.+)"), Outcome.MISSION_REJECTED, _group()),
    _TextCause(
        re.compile(r"(Item \d+: .+|cannot make progress.+)"),
        Outcome.CANNOT_FLY_ITEM,
        _group(),
        first_only=True,
    ),
)


@dataclass(slots=True)
class FailureWatch:
    """Signs of failures in a flight, collected from HEARTBEAT, SYS_STATUS, BATTERY_STATUS and texts."""

    failsafe: bool = False  # Whether the last HEARTBEAT showed an active failsafe.
    began: list[int] = field(default_factory=list)  # Number of texts received at each start of a failsafe.
    low_battery: bool = False  # Whether the last BATTERY_STATUS reported a low charge.
    empty_battery: bool = False  # Whether the last BATTERY_STATUS reported an empty battery.
    unhealthy: int = 0  # MAV_SYS_STATUS_SENSOR bits enabled and unhealthy in any SYS_STATUS.

    def on_heartbeat(self, message: m.MAVLink_heartbeat_message, texts_heard: int) -> None:
        """Handle a HEARTBEAT; ``texts_heard`` is the number of texts that arrived before the HEARTBEAT."""
        before, self.failsafe = self.failsafe, message.system_status in _FAILSAFE_STATES
        if self.failsafe and not before:
            self.began.append(texts_heard)

    def on_sys_status(self, message: m.MAVLink_sys_status_message) -> None:
        """Handle a SYS_STATUS."""
        self.unhealthy |= message.onboard_control_sensors_enabled & ~message.onboard_control_sensors_health

    def on_battery_status(self, message: m.MAVLink_battery_status_message) -> None:
        """Handle a BATTERY_STATUS of a battery of the motors."""
        if drives(message):
            self.low_battery = message.charge_state in _LOW_CHARGE_STATES
            self.empty_battery = message.battery_remaining == 0

    def cause(self, texts: Sequence[tuple[float, int, str]]) -> tuple[Outcome, str] | None:
        """Return outcome and reason of an aborted flight, or None without any sign of a failure.

        The vehicle's texts have priority. If they name no cause, battery and sensors decide.
        """
        found: tuple[Outcome, str] | None = None
        candidate: tuple[Outcome, str] | None = None
        for index, (time_s, _severity, text) in enumerate(texts):
            if candidate is not None and index in self.began:
                found, candidate = candidate, None
            for cause in _CAUSES:
                match = cause.pattern.match(text)
                if match is None:
                    continue
                named = (cause.outcome, cause.reason(match, time_s))
                if not cause.acts:
                    candidate = named
                elif found is None or not cause.first_only:
                    found, candidate = named, None
                break
        if candidate is not None and len(texts) in self.began:
            found = candidate
        return found or self._cause_without_texts()

    def _cause_without_texts(self) -> tuple[Outcome, str] | None:
        if not self.began:
            return None
        if self.empty_battery:
            return Outcome.BATTERY_DEPLETED, "battery empty"
        if self.low_battery:
            return Outcome.BATTERY_LOW, "battery low"
        if self.unhealthy & m.MAV_SYS_STATUS_SENSOR_GPS:
            return Outcome.POSITION_LOST, "position lost"
        if self.unhealthy & m.MAV_SYS_STATUS_GEOFENCE:
            return Outcome.FENCE_BREACHED, "fence breached"
        return None
