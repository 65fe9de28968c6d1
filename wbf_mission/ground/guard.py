"""What has to be set on a vehicle before its mission is changed aside: a failsafe that brings it home."""

from __future__ import annotations

import math
from collections.abc import Sequence

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.transfer import RoundTrip
from mission.transfer.profile import NeededParameter
from wbf_mission.ground.orders import retry_s_over, tries_over

__all__ = ["FailsafeGuard"]


class FailsafeGuard:
    """Reads parameters and sets those that are not as needed, sans-IO; once for each flight.

    Parameters
    ----------
    needed : sequence of NeededParameter
    vehicle : tuple of int
        System and component ids.
    round_trip : RoundTrip, optional
        Of the link.

    Attributes
    ----------
    refused : str
        Why it cannot be; empty while it may.
    due_s : float
        When `poll` has something to do; infinity for never.
    """

    def __init__(
        self,
        needed: Sequence[NeededParameter],
        vehicle: tuple[int, int],
        round_trip: RoundTrip | None = None,
    ) -> None:
        self.refused = ""
        self.due_s = math.inf
        self._vehicle = vehicle
        self._open = {one.name: one for one in needed}
        self._set: dict[str, tuple[int, int]] = {}
        self._tries = 0
        self._round_trip = round_trip

    @property
    def ready(self) -> bool:
        """Whether everything is as needed."""
        return not self._open

    def begin(self, now_s: float) -> list[Message]:
        """Begin, or begin again after it was refused."""
        self.refused, self._tries = "", 0
        return self.poll(now_s)

    def poll(self, now_s: float) -> list[Message]:
        """Ask for what is not told, and set what is not confirmed."""
        if self.ready:
            return []
        if self._tries >= tries_over(self._round_trip):
            self._refuse(f"{', '.join(sorted(self._open))} could not be read or set")
            return []
        self._tries += 1
        self.due_s = now_s + retry_s_over(self._round_trip)
        return [self._setting(name) if name in self._set else self._question(name) for name in self._open]

    def receive(self, message: m.MAVLink_param_value_message) -> list[Message]:
        """Take the value of a parameter."""
        name = str(message.param_id)
        needed = self._open.get(name)
        if needed is None or not math.isfinite(message.param_value):
            return []
        value = round(message.param_value)
        wanted = needed.wanted(value)
        if wanted == value:
            del self._open[name]
            self.due_s = math.inf if self.ready else self.due_s
            return []
        if name in self._set:
            self._refuse(f"{name} stays {value}, {wanted} is needed")
            return []
        self._set[name] = wanted, message.param_type
        return [self._setting(name)]

    def _refuse(self, why: str) -> None:
        self.refused = f"a vehicle without its ground station would not come home: {why}"
        self.due_s = math.inf
        self._set.clear()

    def _question(self, name: str) -> Message:
        return m.MAVLink_param_request_read_message(*self._vehicle, name.encode(), -1)

    def _setting(self, name: str) -> Message:
        value, kind = self._set[name]
        return m.MAVLink_param_set_message(*self._vehicle, name.encode(), float(value), kind)
