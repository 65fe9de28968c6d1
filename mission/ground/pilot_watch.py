"""Notices that somebody else flies: the pilot, another operator, a safety function, or a restart."""

from __future__ import annotations

import math
from collections.abc import Collection

from mission.ground.modes import Maneuver, VehicleModes, is_in_mission, mode_name
from mission.link.codec.dialect import mavlink as m

__all__ = ["PilotWatch"]

_TAKEN = "taken out of its mission"
_STOPPED = "stopped on its way home"
_HOMEWARD = frozenset({"RTL", "SMART_RTL", "LAND", "QRTL", "QLAND", "PRECLAND", "FOLLOW_ME_LAND", "AUTOLAND"})
"""Modes in which a vehicle comes home or down, whoever chose them."""
_RESTARTED = "its autopilot has started again"
_DOUBT_S = 5.0
"""Messages of one moment may come in any order, up to 3 s late, and the first of each may be lost."""
_SHOWS = {Maneuver.HOLD: "holds", Maneuver.RETURN: "returns", Maneuver.LAND: "lands"}


class PilotWatch:
    """Follows the flight mode from the start of a mission."""

    def __init__(self) -> None:
        self.events: list[tuple[float, str]] = []
        self.mode = ""
        self._in_mission: bool | None = None
        self._shows_mission = False
        # The maneuver that we ordered; None again when the vehicle is back in its mission
        self.ordered: Maneuver | None = None
        # How the vehicle showed that it obeys; empty before that
        # The state after a restart that ended the mission; empty without one
        self.obeyed = self.ended_by_restart = ""
        self._held: list[tuple[float, str]] = []
        self._restarted = False
        self.mission_over = False  # The vehicle reported the end of its mission
        self._over_s = -math.inf
        self._doubt: tuple[float, str] | None = None
        self._is_stopped = False

    @property
    def in_doubt(self) -> bool:
        """Whether it is not known yet if the mission's own end or somebody else chose the flight mode."""
        return self._doubt is not None

    @property
    def somebody_else_flies(self) -> bool:
        """Whether the vehicle left its mission without an order of ours."""
        return self._in_mission is False and self.ordered is None

    @property
    def taken_out(self) -> bool:
        """Whether the vehicle was taken out of its mission, by somebody else or by us, or may have been."""
        return self._in_mission is False or self.ordered is not None or self.in_doubt

    @property
    def ended_mission(self) -> bool:
        """Whether the vehicle left its mission; an order that it never obeyed has not ended it."""
        return self._in_mission is False or bool(self.obeyed)

    @property
    def reason(self) -> str:
        """How somebody else took the vehicle over last; empty if nobody did."""
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
        """Take a HEARTBEAT of the vehicle in flight.

        With `expects_change` the vehicle may be out of its mission now: that is being changed, or it is on
        the way home (`flies_home`), where only a mode that leads neither home nor down is told. `unsure`: it
        was silent, and has not told its clock since, so what it does may come from a restart; what happened
        is told by `settle` or `on_restart`. To the modes `ends_in` leads the mission's own end: such a mode
        is left open until the vehicle tells that its mission is over, or five seconds have passed.
        """
        flies_home |= self.mission_over
        if flies_home and self.ordered is None and not unsure:
            self._follow_home(message, now_s, ends_in)
        self._follow(message, now_s, expects_change=expects_change or flies_home, ends_in=ends_in)
        if self._restarted:
            self._tell_restart(message, now_s)
        elif not unsure:
            self.settle()

    def on_mission_end(self, now_s: float) -> None:
        """Note that a message reports the end of the mission."""
        self.mission_over, self._over_s, self._doubt = True, now_s, None

    def on_mission_goes_on(self, now_s: float) -> None:
        """Note that items are left to fly: an end reported before is outdated.

        Messages sent before the end may arrive after it; and PX4 on its way home reports as active a mission
        that came just after the old one had ended.
        """
        if self._shows_mission and now_s > self._over_s + _DOUBT_S:
            self.mission_over = False

    def on_new_mission(self) -> None:
        """Forget a reported end: it was that of another mission."""
        self.mission_over = False

    def poll(self, now_s: float, *, unsure: bool = False) -> None:
        """Decide after `_DOUBT_S` that the mission did not end by itself; ``unsure``: not reported yet."""
        if now_s >= self.next_deadline():
            assert self._doubt is not None
            self._held.append(self._doubt)
            self._doubt, self._in_mission = None, False
        if not unsure and not self._restarted:
            self.settle()

    def next_deadline(self) -> float:
        """When `poll` has something to do."""
        return math.inf if self._doubt is None else self._doubt[0] + _DOUBT_S

    def order(self, ordered: Maneuver | None) -> None:
        """Note the maneuver that is ordered; None for none."""
        self.ordered, self.obeyed = ordered, ""

    def settle(self) -> None:
        """Report the changes that were held back: no restart caused them."""
        self.events += self._held
        self._held.clear()

    def on_restart(self, message: m.MAVLink_heartbeat_message | None, now_s: float) -> None:
        """Note a restart; it is reported with the first HEARTBEAT since (None: not here yet)."""
        self._restarted = True
        if message is not None:
            self._tell_restart(message, now_s)

    def _tell_restart(self, message: m.MAVLink_heartbeat_message, now_s: float) -> None:
        """Report a restart in one line, in place of the changes that it caused."""
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
        """Report when somebody stops the vehicle on its way home, and when it goes on."""
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
        """Follow the mode."""
        before, self.mode = self.mode, mode_name(message)
        self._shows_mission = is_in_mission(message)
        if self._shows_mission:
            if not message.base_mode & m.MAV_MODE_FLAG_SAFETY_ARMED:
                # PX4 goes back to it when it is disarmed, also if it was taken out before.
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
            # An order to resume is obeyed once the mission mode shows, above.
            if self.ordered is not Maneuver.RESUME and (not modes or self.mode in modes):
                self.obeyed = f"{_SHOWS[self.ordered]} (mode {self.mode})"
            # On its way home it may be out of its mission without that.
            self._in_mission = bool(self._in_mission) and expects_change and not self.obeyed
            return
        # The mission cannot be left before its mode was seen once.
        if expects_change or self._in_mission is None:
            self._doubt = None
            return
        if self._in_mission:
            taken = (now_s, f"{_TAKEN}: mode {self.mode}")
            if self.mode in ends_in:
                self._doubt = self._doubt or taken
                self.poll(now_s, unsure=True)
                return
            # A doubt is settled by a mode to which no mission leads.
            self._held.append(self._doubt or taken)
            if self._doubt is not None:
                self._held.append((now_s, f"mode {self.mode}"))
            self._in_mission, self._doubt = False, None
        elif before != self.mode:
            self._held.append((now_s, f"mode {self.mode}"))
