"""Notices that somebody else flies: the pilot, another operator, a safety function, or a restart."""

from __future__ import annotations

from mission.link.codec.dialect import mavlink as m
from wbf_mission.ground.modes import Maneuver, is_in_mission, maneuver_modes, mode_name

__all__ = ["PilotWatch"]

_TAKEN = "taken out of its mission"
_RESTARTED = "its autopilot has started again"
_SHOWS = {Maneuver.HOLD: "holds", Maneuver.RETURN: "returns", Maneuver.LAND: "lands"}


class PilotWatch:
    """Follows the flight mode from the start of a mission.

    Attributes
    ----------
    events : list of (float, str)
        Time in seconds, and what happened.
    mode : str
        Name of the flight mode that was told last.
    ordered : Maneuver or None
        What we ourselves take the vehicle out of its mission for; None again when it is back.
    obeyed : str
        How the vehicle showed that it does that; empty while it does not.
    ended_by_restart : str
        How the vehicle came up after a restart that ended its mission; empty if none did.
    """

    def __init__(self) -> None:
        self.events: list[tuple[float, str]] = []
        self.mode = ""
        self._in_mission: bool | None = None
        self.ordered: Maneuver | None = None
        self.obeyed = self.ended_by_restart = ""
        self._held: list[tuple[float, str]] = []
        self._restarted = False

    @property
    def somebody_else_flies(self) -> bool:
        """Whether the vehicle left its mission without having been told to by us."""
        return self._in_mission is False and self.ordered is None

    @property
    def taken_out(self) -> bool:
        """Whether the vehicle was taken out of its mission, by somebody else or by us."""
        return self._in_mission is False or self.ordered is not None

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
        unsure: bool = False,
    ) -> None:
        """Take a HEARTBEAT of the vehicle in flight.

        Parameters
        ----------
        message : HEARTBEAT
        now_s : float
        expects_change : bool
            The vehicle may be out of its mission now: that is being changed, or it is on the way home.
        unsure : bool
            It was silent, and has not told its clock since: what it does may come from a restart. What
            happened is told by `settle` or `on_restart`.
        """
        self._follow(message, now_s, expects_change=expects_change)
        if self._restarted:
            self._tell_restart(message, now_s)
        elif not unsure:
            self.settle()

    def order(self, ordered: Maneuver | None) -> None:
        """Note what is ordered; None for nothing any more."""
        self.ordered, self.obeyed = ordered, ""

    def settle(self) -> None:
        """Tell what was held back: it came from no restart."""
        self.events += self._held
        self._held.clear()

    def on_restart(self, message: m.MAVLink_heartbeat_message | None, now_s: float) -> None:
        """Note that the autopilot has started again; it is told with the state in which it came up.

        Parameters
        ----------
        message : HEARTBEAT or None
            The one that came since it is heard again; None if none has come yet.
        now_s : float
        """
        self._restarted = True
        if message is not None:
            self._tell_restart(message, now_s)

    def _tell_restart(self, message: m.MAVLink_heartbeat_message, now_s: float) -> None:
        """Tell of a restart in one line, in place of what it changed."""
        out = bool(self._held) and self._in_mission is False
        self._restarted = False
        self._held.clear()
        disarmed = not message.base_mode & m.MAV_MODE_FLAG_SAFETY_ARMED
        text = _RESTARTED + f": mode {self.mode}" * (out or disarmed) + ", motors off" * disarmed
        if out or disarmed:
            self.ended_by_restart = text
        self.events.append((now_s, text))

    def _follow(self, message: m.MAVLink_heartbeat_message, now_s: float, *, expects_change: bool) -> None:
        """Follow the mode."""
        kind = _kind(message)
        before, self.mode = self.mode, mode_name(*kind)
        if is_in_mission(*kind):
            if not message.base_mode & m.MAV_MODE_FLAG_SAFETY_ARMED:
                # PX4 goes back to it when it is disarmed, also if it was taken out before.
                return
            if self.somebody_else_flies:
                self._held.append((now_s, f"back in its mission (mode {self.mode})"))
                self.ended_by_restart = ""
            if self._in_mission is False:
                self.order(None)
            self._in_mission = True
            return
        if self.ordered is not None:
            self._look_for_obedience(self.ordered, kind)
            # On its way home it may be out of its mission without that.
            self._in_mission = bool(self._in_mission) and expects_change and not self.obeyed
            return
        # Before the mission's mode was seen for the first time nobody has left it.
        if expects_change or self._in_mission is None:
            return
        if self._in_mission:
            self._held.append((now_s, f"{_TAKEN}: mode {self.mode}"))
            self._in_mission = False
        elif before != self.mode:
            self._held.append((now_s, f"mode {self.mode}"))

    def _look_for_obedience(self, ordered: Maneuver, kind: tuple[int, int, int, int]) -> None:
        """See in the mode whether the vehicle does what was ordered."""
        modes = maneuver_modes(ordered, *kind[:2])
        if not modes or self.mode in modes:
            self.obeyed = f"{_SHOWS[ordered]} (mode {self.mode})"


def _kind(message: m.MAVLink_heartbeat_message) -> tuple[int, int, int, int]:
    """Return what tells the flight mode."""
    return message.autopilot, message.type, message.base_mode, message.custom_mode
