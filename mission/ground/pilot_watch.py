"""Detection of another pilot's orders during a mission, from the flight modes that the vehicle shows."""

from __future__ import annotations

import math
from collections.abc import Collection

from mission.ground.contact import LATE_ORDER_S
from mission.ground.modes import Maneuver, VehicleModes, is_in_mission, mode_name
from mission.link.codec.dialect import mavlink as m

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
        self.ordered: Maneuver | None = None  # Maneuver ordered by the station, None in the mission.
        self.obeyed = ""  # Description of the vehicle's response to the order, empty before.
        self.ended_by_restart = ""  # State after a reboot that ended the mission, empty without one.
        self._held: list[tuple[float, str]] = []
        self.restarted = False  # Whether no HEARTBEAT has arrived since a reboot.
        self._late: tuple[Maneuver, float] | None = None  # Unanswered order, and its latest arrival (s).
        self.mission_over = False  # whether the vehicle reported the end of its mission
        self.replaced = False  # whether another station has sent the vehicle another mission
        self._over_s = -math.inf
        self._doubt: tuple[float, str] | None = None
        self._is_stopped = False

    @property
    def in_doubt(self) -> bool:
        """Whether it is unclear if the mission has ended or another pilot chose the present mode."""
        return self._doubt is not None

    @property
    def somebody_else_flies(self) -> bool:
        """Whether the vehicle left its mission without an order of the station."""
        return self._in_mission is False and self.ordered is None

    @property
    def taken_out(self) -> bool:
        """Whether an order or another pilot has taken, or may have taken, the vehicle out of its mission."""
        return self._in_mission is False or self.ordered is not None or self.in_doubt

    @property
    def ended_mission(self) -> bool:
        """Whether the vehicle left its mission, by another pilot or by an order that the vehicle obeyed."""
        return self._in_mission is False or bool(self.obeyed) or self.replaced

    @property
    def reason(self) -> str:
        """Text of the last takeover by another pilot, or an empty text."""
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

        `expects_change`: the mission is being changed, so other modes than the mission mode are not reported.
        `flies_home`: the vehicle returns, so only modes that neither return nor land are reported.
        `unsure`: a reboot may have changed the mode, so reports wait for `settle` or `on_restart`.
        `ends_in`: modes after the mission's end; they mean a takeover if no end is reported within 5 s.
        """
        flies_home |= self.mission_over
        if flies_home and self.ordered is None and not unsure:
            self._follow_home(message, now_s, ends_in)
        self._follow(message, now_s, expects_change=expects_change or flies_home, ends_in=ends_in)
        if self.restarted:
            self._report_restart(message, now_s)
        elif not unsure:
            self.settle()

    def on_mission_end(self, now_s: float) -> None:
        """Record that the vehicle reported the end of the mission."""
        self.mission_over, self._over_s, self._doubt = True, now_s, None

    def on_mission_goes_on(self, now_s: float) -> None:
        """Record that items remain to be flown; later than 5 s after a reported end, this cancels the end.

        Within these 5 s, messages from before the end may still arrive. Outside the mission mode, the end is
        not cancelled: a returning PX4 reports a newly uploaded mission as active.
        """
        if self._shows_mission and now_s > self._over_s + _DOUBT_S:
            self.mission_over = False

    def on_new_mission(self) -> None:
        """Discard a reported end, which belongs to the previous mission."""
        self.mission_over = False

    def on_other_mission(self, items: int | None, now_s: float) -> None:
        """Report once that the vehicle holds a mission of another station."""
        if not self.replaced:
            self.replaced = True
            count = "" if items is None else f" ({items} items)"
            self.events.append((now_s, f"{_TAKEN}: another station has sent another mission{count}"))

    def poll(self, now_s: float, *, unsure: bool = False) -> None:
        """Report a takeover if no message explains the mode within 5 s; ``unsure`` delays all reports."""
        if now_s >= self.next_deadline():
            assert self._doubt is not None
            self._held.append(self._doubt)
            self._doubt, self._in_mission = None, False
        if not unsure and not self.restarted:
            self.settle()

    def next_deadline(self) -> float:
        """Return the time at which an unexplained mode counts as a takeover; infinity if there is none."""
        return math.inf if self._doubt is None else self._doubt[0] + _DOUBT_S

    def order(self, ordered: Maneuver | None, obeyed: str = "") -> None:
        """Record the ordered maneuver, if any; ``obeyed`` is not empty if the vehicle already obeys it."""
        self.ordered, self.obeyed = ordered, obeyed

    def on_no_answer(self, ordered: Maneuver | None, now_s: float) -> None:
        """Record an unanswered order, which the vehicle may still obey within `LATE_ORDER_S`."""
        self._late = None if ordered is None else (ordered, now_s + LATE_ORDER_S)

    def settle(self) -> None:
        """Report the delayed mode changes, since no reboot explains them."""
        self.events += self._held
        self._held.clear()

    def on_restart(self, message: m.MAVLink_heartbeat_message | None, now_s: float) -> None:
        """Record a reboot, and report it with the first HEARTBEAT after it (None: no HEARTBEAT yet)."""
        self.restarted = True
        if message is not None:
            self._report_restart(message, now_s)

    def _report_restart(self, message: m.MAVLink_heartbeat_message, now_s: float) -> None:
        """Report a reboot in place of the mode changes that it caused."""
        out = bool(self._held) and self._in_mission is False
        self.restarted = False
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
        known = VehicleModes(message.autopilot, message.type)
        if self._late is not None and self.ordered is None:
            # Only the first mode change may be the order's: after a pilot's mode, the pilot chooses.
            (late, latest_s), self._late = self._late, None
            if now_s < latest_s and self.mode in known.shows(late):
                self.order(late)
        if self.ordered is not None:
            modes = known.shows(self.ordered)
            armed = message.base_mode & m.MAV_MODE_FLAG_SAFETY_ARMED
            if self.obeyed and armed and modes and self.mode not in modes | _HOMEWARD | frozenset(ends_in):
                self._held.append((now_s, f"{_TAKEN}: mode {self.mode}"))
                self.order(None)
                self._in_mission = False
                return
            # An order to resume is obeyed when the mission mode shows, which is handled above.
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
