"""Parameters of the failsafe that returns a vehicle if the link is lost during a change in guided mode."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

from mission.autopilots.profile import NeededParameter
from mission.ground.contact import Contact
from mission.ground.orders import retry_s_over, tries_over
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m

__all__ = ["FailsafeGuard"]


class FailsafeGuard:
    """Reader and setter of the failsafe parameters, sans-IO; one object for each flight.

    The parameters are set in order, because the link may be lost after each of them. The last parameter
    enables a failsafe that depends on the others.
    """

    def __init__(self, needed: Sequence[NeededParameter], contact: Contact, was_set: list[str]) -> None:
        self.refused = ""  # reason of a failure, empty if none
        self.due_s = math.inf
        self._was_set = was_set  # log of the parameters set, with old and new value
        self._before: dict[str, int] = {}
        self._vehicle, self._round_trip = contact.vehicle, contact.round_trip
        self._open = {parameter.name: parameter for parameter in needed}
        self._set: dict[str, tuple[int, int]] = {}
        self._sent: set[str] = set()
        self._asked: Counter[str] = Counter()
        self._tries = 0

    @property
    def ready(self) -> bool:
        """Whether all parameters have the required values."""
        return not self._open

    def begin(self, now_s: float) -> list[Message]:
        """Begin, or retry after a failure."""
        self.refused, self._tries = "", 0
        return self.poll(now_s)

    def poll(self, now_s: float) -> list[Message]:
        """Request unknown parameters, and set an unconfirmed parameter again."""
        if self.ready:
            return []
        if self._tries >= tries_over(self._round_trip):
            self._refuse(f"{', '.join(sorted(self._open))} could not be read or set")
            return []
        self._tries += 1
        self.due_s = now_s + retry_s_over(self._round_trip, self._tries - 1)
        return [self._question(name) for name in self._open if name not in self._set] + self._next_setting(
            again=True
        )

    def receive(self, message: m.MAVLink_param_value_message) -> list[Message]:
        """Handle the value of a parameter."""
        name = str(message.param_id)
        needed = self._open.get(name)
        if needed is None or not math.isfinite(message.param_value):
            return []
        value = round(message.param_value)
        wanted = needed.wanted(value)
        if wanted == value:
            if name in self._before:
                self._was_set.append(f"{name} was {self._before[name]}, is set to {value} and stays so")
            del self._open[name]
            self._tries = 0
            self.due_s = math.inf if self.ready else self.due_s
            return self._next_setting()
        # An answer to a repeated request may be older than the setting.
        self._asked[name] -= 1
        if name in self._sent and self._asked[name] < 0:
            self._refuse(f"{name} stays {value}, {wanted} is needed")
            return []
        self._set[name] = wanted, message.param_type
        self._before.setdefault(name, value)
        return self._next_setting()

    def _next_setting(self, *, again: bool = False) -> list[Message]:
        """Return the message that sets the next parameter, nothing if its value is unknown."""
        name = next(iter(self._open), None)
        if name is None or name not in self._set or (name in self._sent and not again):
            return []
        self._sent.add(name)
        return [self._setting(name)]

    def _refuse(self, why: str) -> None:
        self.refused = f"a vehicle without its ground station would not come home: {why}"
        self.due_s = math.inf
        self._set.clear()
        self._sent.clear()
        self._asked.clear()

    def _question(self, name: str) -> Message:
        self._asked[name] += 1
        return m.MAVLink_param_request_read_message(*self._vehicle, name.encode(), -1)

    def _setting(self, name: str) -> Message:
        value, kind = self._set[name]
        return m.MAVLink_param_set_message(*self._vehicle, name.encode(), float(value), kind)
