"""Notices that somebody else flies: the pilot, another operator, or a safety function of the vehicle."""

from __future__ import annotations

from mission.link.codec.dialect import mavlink as m
from wbf_mission.ground.modes import Maneuver, is_in_mission, mode_name

__all__ = ["PilotWatch"]

_TAKEN = "taken out of its mission"


class PilotWatch:
    """Follows the flight mode from the start of a mission.

    Attributes
    ----------
    events : list of (float, str)
        Time in seconds, and what happened.
    mode : str
        Name of the flight mode that was told last.
    ordered : Maneuver or None
        What we ourselves took the vehicle out of its mission for; None again when it is back.
    """

    def __init__(self) -> None:
        self.events: list[tuple[float, str]] = []
        self.mode = ""
        self._in_mission: bool | None = None
        self.ordered: Maneuver | None = None

    @property
    def somebody_else_flies(self) -> bool:
        """Whether the vehicle left its mission without having been told to by us."""
        return self._in_mission is False and self.ordered is None

    @property
    def taken_out(self) -> bool:
        """Whether the vehicle was taken out of its mission, by somebody else or by us."""
        return self._in_mission is False or self.ordered is not None

    @property
    def reason(self) -> str:
        """How somebody else took the vehicle over last; empty if nobody did."""
        return next((text for _, text in reversed(self.events) if text.startswith(_TAKEN)), "")

    def on_heartbeat(
        self, message: m.MAVLink_heartbeat_message, now_s: float, *, expects_change: bool
    ) -> None:
        """Take a HEARTBEAT of the vehicle in flight.

        Parameters
        ----------
        message : HEARTBEAT
        now_s : float
        expects_change : bool
            The vehicle may be out of its mission now: that is being changed, or it is on the way home.
        """
        kind = (message.autopilot, message.type, message.base_mode, message.custom_mode)
        before, self.mode = self.mode, mode_name(*kind)
        if is_in_mission(*kind):
            if self.somebody_else_flies:
                self.events.append((now_s, f"back in its mission (mode {self.mode})"))
            if self._in_mission is False:
                self.ordered = None
            self._in_mission = True
            return
        # Before the mission's mode was seen for the first time nobody has left it.
        if self.ordered is not None:
            self._in_mission = False
            return
        if expects_change or self._in_mission is None:
            return
        if self._in_mission:
            self.events.append((now_s, f"{_TAKEN}: mode {self.mode}"))
            self._in_mission = False
        elif before != self.mode:
            self.events.append((now_s, f"mode {self.mode}"))
