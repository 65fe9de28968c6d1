"""MANUAL_CONTROL and RC_CHANNELS_OVERRIDE: the sticks of a ground station.

Source: ArduPilot's ``GCS_Common.cpp`` and ``GCS_MAVLink_Copter.cpp``, PX4's ``mavlink_receiver.cpp``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from mission.link.codec.dialect import mavlink as m
from mission.link.codec.typed import is_a
from sim_vehicle.autopilot.parameters import Setting
from sim_vehicle.autopilot.stick_rules import StickRules, Sticks

if TYPE_CHECKING:
    from sim_vehicle.autopilot.parameters import RuntimeParameters

__all__ = ["StickMessage", "StickReader"]

StickMessage = m.MAVLink_manual_control_message | m.MAVLink_rc_channels_override_message

_FULL = 1000.0
# MAVLink's number for an axis that the sender does not have.
_NO_AXIS = 2**15 - 1
_MIDDLE_US = 1500
_RELEASED, _KEPT = 0, 65535
_GROUND_STATION = Setting("MAV_GCS_SYSID", 255.0)


class StickReader:
    """Reads the positions of the sticks.

    Parameters
    ----------
    rules : StickRules or None
        How the autopilot takes them; None where it has no sticks.
    system_id : int
        Of the vehicle.
    """

    def __init__(self, rules: StickRules | None, system_id: int, parameters: RuntimeParameters) -> None:
        self._rules = rules
        self._system_id = system_id
        self._parameters = parameters
        self._channels = [_RELEASED] * 4

    def read(self, message: StickMessage) -> Sticks | None:
        """Return where the sticks are; None where the message does not count."""
        rules = self._rules
        if rules is None:
            return None
        release = rules.loss.release
        if release is not None and release.of(self._parameters) == 0.0:
            return None
        if rules.overrides and message.get_srcSystem() != int(_GROUND_STATION.of(self._parameters)):
            return None
        if is_a(message, m.MAVLink_rc_channels_override_message):
            return self._of_channels(message, rules) if rules.overrides else None
        if message.target != self._system_id:
            return None
        up = _axis(message.z, middle=rules.throttle_middle)
        return Sticks(_axis(message.x), _axis(message.y), up, _axis(message.r))

    def _of_channels(
        self, message: m.MAVLink_rc_channels_override_message, rules: StickRules
    ) -> Sticks | None:
        """Read roll, pitch, throttle and yaw; a channel that is not overridden is centred."""
        told = (message.chan1_raw, message.chan2_raw, message.chan3_raw, message.chan4_raw)
        self._channels = [
            before if now == _KEPT else now for before, now in zip(self._channels, told, strict=True)
        ]
        if not any(self._channels):
            return None
        right, back, up, turn = (
            min(max((pulse - _MIDDLE_US) / rules.pwm_half, -1.0), 1.0) if pulse != _RELEASED else 0.0
            for pulse in self._channels
        )
        return Sticks(-back, right, up, turn)


def _axis(value: int, middle: float = 0.0) -> float:
    """Position that an axis of MANUAL_CONTROL tells; one that is not there is centred."""
    return 0.0 if value == _NO_AXIS else min(max((value - middle) / (_FULL - middle), -1.0), 1.0)
