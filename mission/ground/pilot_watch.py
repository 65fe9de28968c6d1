"""Detection of mode changes by a pilot, another operator, a failsafe or a reboot."""

from __future__ import annotations

import math
from collections.abc import Collection

from mission.ground.modes import Maneuver, VehicleModes, is_in_mission, mode_name
from mission.link.codec.dialect import mavlink as m

__all__ = ["PilotWatch"]

_TAKEN = "taken out of its mission"
_STOPPED = "stopped on its way home"
_HOMEWARD = frozenset({"RTL", "SMART_RTL", "LAND", "QRTL", "QLAND", "PRECLAND", "FOLLOW_ME_LAND", "AUTOLAND"})
"""Modes in which a vehicle returns or lands."""
_RESTARTED = "its autopilot has started again"
_DOUBT_S = 5.0
"""Wait for a message that explains a mode change (s): messages may be lost, reordered, and up to 3 s late."""
_SHOWS = {Maneuver.HOLD: "holds", Maneuver.RETURN: "returns", Maneuver.LAND: "lands"}


class PilotWatch:
    """Tracks the flight mode from the start of a mission."""

    def __init__(self) -> None:
        self.events: list[tuple[float, str]] = []
        self.mode = ""
        self._in_mission: bool | None = None
        self._shows_mission = False
        self.ordered: Maneuver | None = None  # maneuver ordered by the station, None in the mission
        self.obeyed = ""  # description of the vehicle's response to the order, empty before
        self.ended_by_restart = ""  # state after a reboot that ended the mission, empty without one
        self._held: list[tuple[float, str]] = []
        self._restarted = False
        self.mission_over = False  # whether the vehicle reported the end of its mission
        self._over_s = -math.inf
        self._doubt: tuple[float, str] | None = None
        self._is_stopped = False

    @property
    def in_doubt(self) -> bool:
        """Whether it is still open if the mission ended in this mode or another pilot chose it."""
        return self._doubt is not None

    @property
    def somebody_else_flies(self) -> bool:
        """Whether the vehicle left its mission without an order of the station."""
        return self._in_mission is False and self.ordered is None

    @property
    def taken_out(self) -> bool:
        """Whether the vehicle left its mission, or may have left it, by an order or by another pilot."""
        return self._in_mission is False or self.ordered is not None or self.in_doubt

    @property
    def ended_mission(self) -> bool:
        """Whether the vehicle left its mission; an order that the vehicle did not obey does not count."""
        return self._in_mission is False or bool(self.obeyed)

    @property
    def reason(self) -> str:
        """Text of the last takeover by another pilot, empty without one."""
        return next((text for _, text in reversed(self.events) if text.startswith(_TAKEN)), "")

    def on_heartbeat(
        self,
        message: m.MAVLink_heartbeat_message,
        now_s: float,
        *,
        expects_change: bool,
        flies_home: bool = False,
        unsure: bool = False,
        ends_in: Collection[str] = (),
    ) -> None:
        """Handle a HEARTBEAT of the vehicle in flight.

        `expects_change`: the mission is being changed, so leaving the mission mode is not reported.
        `flies_home`: the vehicle returns, so only modes that neither return nor land are reported.
        `unsure`: a mode change may result from a reboot, so reports wait for `settle` or `on_restart`.
        `ends_in`: modes after the mission's end, a takeover only if no end is reported within five seconds.
        """
        flies_home |= self.mission_over
        if flies_home and self.ordered is None and not unsure:
            self._follow_home(message, now_s, ends_in)
        self._follow(message, now_s, expects_change=expects_change or flies_home, ends_in=ends_in)
        if self._restarted:
            self._report_restart(message, now_s)
        elif not unsure:
            self.settle()

    def on_mission_end(self, now_s: float) -> None:
        """Record that the vehicle reported the end of the mission."""
        self.mission_over, self._over_s, self._doubt = True, now_s, None

    def on_mission_goes_on(self, now_s: float) -> None:
        """Record that items remain to fly, which cancels an earlier report of the mission's end.

        Messages sent before the end may arrive later. If a new mission arrives just after the end of the old
        one, PX4 reports the new mission as active although the vehicle returns.
        """
        if self._shows_mission and now_s > self._over_s + _DOUBT_S:
            self.mission_over = False

    def on_new_mission(self) -> None:
        """Discard a reported end, which was that of the previous mission."""
        self.mission_over = False

    def poll(self, now_s: float, *, unsure: bool = False) -> None:
        """Decide after `_DOUBT_S` that another pilot took over; ``unsure`` delays the report."""
        if now_s >= self.next_deadline():
            assert self._doubt is not None
            self._held.append(self._doubt)
            self._doubt, self._in_mission = None, False
        if not unsure and not self._restarted:
            self.settle()

    def next_deadline(self) -> float:
        """Return the time of the next `poll` that has an effect, infinite if none."""
        return math.inf if self._doubt is None else self._doubt[0] + _DOUBT_S

    def order(self, ordered: Maneuver | None) -> None:
        """Record the ordered maneuver, None for none."""
        self.ordered, self.obeyed = ordered, ""

    def settle(self) -> None:
        """Report the delayed mode changes, since no reboot explains them."""
        self.events += self._held
        self._held.clear()

    def on_restart(self, message: m.MAVLink_heartbeat_message | None, now_s: float) -> None:
        """Record a reboot, and report it with the first HEARTBEAT after the reboot (None if not received)."""
        self._restarted = True
        if message is not None:
            self._report_restart(message, now_s)

    def _report_restart(self, message: m.MAVLink_heartbeat_message, now_s: float) -> None:
        """Report a reboot in place of the mode changes that it caused."""
        out = bool(self._held) and self._in_mission is False
        self._restarted = False
        self._doubt = None
        self._held.clear()
        disarmed = not message.base_mode & m.MAV_MODE_FLAG_SAFETY_ARMED
        text = _RESTARTED + f": mode {self.mode}" * (out or disarmed) + ", motors off" * disarmed
        if out or disarmed:
            self.ended_by_restart = text
        self.events.append((now_s, text))

    def _follow_home(
        self, message: m.MAVLink_heartbeat_message, now_s: float, ends_in: Collection[str]
    ) -> None:
        """Report when the return home is interrupted, and when it continues."""
        mode = mode_name(message)
        goes = is_in_mission(message) or mode in _HOMEWARD or mode in ends_in
        if not message.base_mode & m.MAV_MODE_FLAG_SAFETY_ARMED or self._in_mission is not True:
            return
        if self._is_stopped is goes:
            self._is_stopped = not goes
            self.events.append((now_s, f"{'goes on home' if goes else _STOPPED}: mode {mode}"))

    def _follow(
        self,
        message: m.MAVLink_heartbeat_message,
        now_s: float,
        *,
        expects_change: bool,
        ends_in: Collection[str],
    ) -> None:
        """Update the mode, and detect takeovers, returns to the mission and obeyed orders."""
        before, self.mode = self.mode, mode_name(message)
        self._shows_mission = is_in_mission(message)
        if self._shows_mission:
            if not message.base_mode & m.MAV_MODE_FLAG_SAFETY_ARMED:
                # PX4 switches back to the mission mode when disarmed, even if a pilot took over before.
                return
            if self.somebody_else_flies:
                self._held.append((now_s, f"back in its mission (mode {self.mode})"))
                self.ended_by_restart = ""
            if self._in_mission is False or self.ordered is Maneuver.RESUME:
                self.order(None)
            self._in_mission, self._doubt = True, None
            return
        if self.ordered is not None:
            modes = VehicleModes(message.autopilot, message.type).shows(self.ordered)
            # An order to resume counts as obeyed with the mission mode, as handled above.
            if self.ordered is not Maneuver.RESUME and (not modes or self.mode in modes):
                self.obeyed = f"{_SHOWS[self.ordered]} (mode {self.mode})"
            # During a change or a return home, another mode does not mean that the mission was left.
            self._in_mission = bool(self._in_mission) and expects_change and not self.obeyed
            return
        # The vehicle cannot leave the mission before it has shown the mission mode once.
        if expects_change or self._in_mission is None:
            self._doubt = None
            return
        if self._in_mission:
            taken = (now_s, f"{_TAKEN}: mode {self.mode}")
            if self.mode in ends_in:
                self._doubt = self._doubt or taken
                self.poll(now_s, unsure=True)
                return
            # No mission ends in this mode, so another pilot chose it.
            self._held.append(self._doubt or taken)
            if self._doubt is not None:
                self._held.append((now_s, f"mode {self.mode}"))
            self._in_mission, self._doubt = False, None
        elif before != self.mode:
            self._held.append((now_s, f"mode {self.mode}"))
