"""Sticks as an extra of the simulated vehicle: stick messages and RC_CHANNELS.

Sources: MAVLink common.xml, ArduPilot's ``GCS_Common.cpp`` and ``GCS_MAVLink_Copter.cpp``, PX4's
``mavlink_receiver.cpp``.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias, get_args

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.typed import is_a
from sim_vehicle.autopilot.parameters import Setting
from sim_vehicle.autopilot.stick_rules import StickRules, Sticks
from sim_vehicle.mavlink.extras import VehicleExtra
from sim_vehicle.mavlink.wire_state import UNUSED, WireState
from sim_vehicle.pilot.controls import RefusedError, Severity
from wbf_mission.addons.sticks.pilot import StickPilot

if TYPE_CHECKING:
    from sim_vehicle.autopilot.behaviour import Mode
    from sim_vehicle.mavlink.parameters import ParameterSet
    from sim_vehicle.mavlink.plan_receiver import PlanReceiver
    from sim_vehicle.pilot.failsafe import Reaction

StickMessage: TypeAlias = m.MAVLink_manual_control_message | m.MAVLink_rc_channels_override_message
_GROUND_STATION = Setting("MAV_GCS_SYSID", 255.0)
_FULL = 1000.0
# Value of an axis that the sender does not have.
_NO_AXIS = 2**15 - 1
_MIDDLE_US = 1500
_RELEASED, _KEPT = 0, 65535
# Channels 5 to 18 of the RC receiver in ArduPilot's simulator.
_SWITCHES = (1800, 1000, 1000, 1800, *[0] * 10)


class SticksExtra(VehicleExtra):
    """Manual flight by a ground station's sticks, if the firmware has rules for sticks."""

    def __init__(self, state: WireState, parameters: ParameterSet, plans: PlanReceiver) -> None:
        super().__init__(state, parameters, plans)
        self._rules = rules = state.firmware.sticks
        self._flown = None if rules is None else StickPilot(state.pilot, rules)
        self._channels = [_RELEASED] * 4
        self.handlers = dict.fromkeys([kind.id for kind in get_args(StickMessage)], self._take)
        self.builders = {m.MAVLINK_MSG_ID_RC_CHANNELS: self._rc_channels}

    @property
    def sticks(self) -> Sticks | None:
        """Positions of the sticks, or None while no messages arrive."""
        return None if self._flown is None else self._flown.shown

    @property
    def throttle_down(self) -> bool:
        """Whether the throttle stick is at its lower end, or absent."""
        return self._flown is None or self._flown.throttle_down

    def why_not_enter(self, mode: Mode) -> str | None:
        """Return the reason if a mode needs sticks that are absent."""
        return "no sticks" if self._flown is not None and self._flown.lacks(mode) else None

    def why_not_arm(self, mode: Mode) -> str | None:
        """Return the reason why the sticks prevent arming in a mode, or None."""
        return None if self._flown is None else self._flown.why_not_arm(mode)

    def on_armed(self) -> None:
        """Forget the sticks if no stick messages arrive when the vehicle is armed."""
        if self._flown is not None:
            self._flown.forget()

    def check(self) -> Iterable[Reaction]:
        """Continue manual flight, and react to a loss of the sticks."""
        # A failsafe may just have changed the mode to one that ignores the sticks.
        flown = self._flies and not self.state.pilot.modes.by_itself
        return () if self._flown is None else self._flown.check(flown=flown)

    @property
    def _flies(self) -> bool:
        """Whether sticks move the vehicle in the present custom mode."""
        return self._rules is not None and self.state.custom_mode not in self._rules.without

    def _take(self, message: StickMessage, _now_s: float) -> None:
        """Fly by MANUAL_CONTROL or RC_CHANNELS_OVERRIDE."""
        rules, flown, pilot, mode = self._rules, self._flown, self.state.pilot, self.state.custom_mode
        if rules is None or flown is None or (sticks := self._read(message, rules)) is None:
            return
        if mode in rules.coordinated:
            sticks = replace(sticks, right=0.0, turn=min(max(sticks.turn + sticks.right, -1.0), 1.0))
        by_rate = rules.tilt is not None and mode in rules.tilt.by_rate
        try:
            if (left := flown.take(sticks, flown=self._flies, by_rate=by_rate)) is not None:
                pilot.turn_to(left)
            if flown.breaks_off_landing and not pilot.executor.mission.goes_around:
                with suppress(RefusedError):  # the vehicle is not landing
                    pilot.go_around()
                    pilot.note(Severity.INFO, "Landing aborted via throttle")
        except RefusedError as refusal:
            pilot.complain(str(refusal))

    def _read(self, message: StickMessage, rules: StickRules) -> Sticks | None:
        """Return the stick positions; None if the message has to be ignored."""
        parameters, release = self.state.pilot.parameters, rules.loss.release
        if release is not None and release.of(parameters) == 0.0:
            return None
        if rules.overrides and message.get_srcSystem() != int(_GROUND_STATION.of(parameters)):
            return None
        if is_a(message, m.MAVLink_rc_channels_override_message):
            return self._from_channels(message, rules) if rules.overrides else None
        if message.target != self.state.system_id:
            return None
        up = _axis(message.z, middle=rules.throttle_middle)
        return Sticks(_axis(message.x), _axis(message.y), up, _axis(message.r))

    def _from_channels(
        self, message: m.MAVLink_rc_channels_override_message, rules: StickRules
    ) -> Sticks | None:
        """Return roll, pitch, throttle and yaw sticks from channels 1 to 4; released channels are centred."""
        channels = (message.chan1_raw, message.chan2_raw, message.chan3_raw, message.chan4_raw)
        self._channels = [
            before if now == _KEPT else now for before, now in zip(self._channels, channels, strict=True)
        ]
        if not any(self._channels):
            return None
        right, back, up, turn = (
            min(max((pulse - _MIDDLE_US) / rules.pwm_half, -1.0), 1.0) if pulse != _RELEASED else 0.0
            for pulse in self._channels
        )
        return Sticks(-back, right, up, turn)

    def _rc_channels(self, source: WireState) -> Message:
        """Return RC_CHANNELS: the ground station's overrides, or ArduPilot's simulated receiver."""
        rules, heard = self._rules, self.sticks
        if rules is None or not rules.overrides:
            return m.MAVLink_rc_channels_message(source.boot_ms, 0, *([UNUSED] * 18 + [255]))
        sticks = heard or Sticks(up=0.0 if rules.drives else -1.0)
        half = rules.pwm_half if heard is not None else 500.0
        axes = (sticks.right, -sticks.forward, sticks.up, sticks.turn)
        numbers = [*(round(_MIDDLE_US + half * axis) for axis in axes), *_SWITCHES, 255]
        return m.MAVLink_rc_channels_message(source.boot_ms, 16, *numbers)


def _axis(value: int, middle: float = 0.0) -> float:
    """Return the position of a MANUAL_CONTROL axis from -1 to 1; a missing axis is centred."""
    return 0.0 if value == _NO_AXIS else min(max((value - middle) / (_FULL - middle), -1.0), 1.0)
