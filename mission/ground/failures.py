"""Why a flight ended before its mission did, from the vehicle's telemetry alone."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from mission.link.codec.dialect import mavlink as m
from mission.outcome import Outcome

__all__ = ["FailureWatch"]

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
    """A STATUSTEXT that names a cause.

    ``acts`` tells whether the text says that the vehicle does something about it; of the others a HEARTBEAT
    has to tell it. ``first_only`` is a cause that counts only while there is no other.
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
    # What was told while the link was down did not arrive.
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
    """Notes what the vehicle tells of its troubles in one flight."""

    failsafe: bool = False  # Whether the last HEARTBEAT told that a safety function has taken over
    began: list[int] = field(default_factory=list)  # How many texts had been heard whenever one took over
    low_battery: bool = False  # low_battery, empty_battery: what BATTERY_STATUS told at the end
    empty_battery: bool = False
    # MAV_SYS_STATUS_SENSOR bits that SYS_STATUS told to be enabled and not healthy at any time
    unhealthy: int = 0

    def on_heartbeat(self, message: m.MAVLink_heartbeat_message, texts_heard: int) -> None:
        """Take a HEARTBEAT of the vehicle, after so many texts."""
        before, self.failsafe = self.failsafe, message.system_status in _FAILSAFE_STATES
        if self.failsafe and not before:
            self.began.append(texts_heard)

    def on_sys_status(self, message: m.MAVLink_sys_status_message) -> None:
        """Take a SYS_STATUS of the vehicle."""
        self.unhealthy |= message.onboard_control_sensors_enabled & ~message.onboard_control_sensors_health

    def on_battery_status(self, message: m.MAVLink_battery_status_message) -> None:
        """Take a BATTERY_STATUS of the vehicle."""
        self.low_battery = message.charge_state in _LOW_CHARGE_STATES
        self.empty_battery = message.battery_remaining == 0

    def cause(self, texts: Sequence[tuple[float, int, str]]) -> tuple[Outcome, str] | None:
        """Outcome and reason of a flight that was broken off; None when the vehicle told of no trouble.

        The vehicle's texts say it best. When they were lost on the way, its state, battery and health are
        what is left.
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
                told = (cause.outcome, cause.reason(match, time_s))
                if not cause.acts:
                    candidate = told
                elif found is None or not cause.first_only:
                    found, candidate = told, None
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
