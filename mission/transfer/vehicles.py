"""Vehicles on a link, identified by their heartbeats, and the search for one vehicle."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field

from mission.autopilots import profile_for
from mission.autopilots.profile import Profile
from mission.link.codec.dialect import Message, mavlink
from mission.link.codec.typed import is_a
from mission.transfer.events import NoVehicleError

_NO_VEHICLES = (mavlink.MAV_TYPE_GCS, mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_TYPE_ANTENNA_TRACKER)


@dataclass(frozen=True, slots=True)
class Vehicle:
    """Vehicle identified by a heartbeat: ids of its autopilot, MAV_AUTOPILOT, MAV_TYPE and armed state."""

    system_id: int
    component_id: int
    autopilot: int
    vehicle_type: int
    armed: bool = field(default=False, compare=False)

    @property
    def profile(self) -> Profile:
        """Profile of the autopilot."""
        return profile_for(self.autopilot)

    def __str__(self) -> str:
        return f"system {self.system_id} ({self.profile.name})"


def vehicle_of(message: Message) -> Vehicle | None:
    """Return the vehicle of an autopilot's heartbeat, or None for any other message."""
    if (
        not is_a(message, mavlink.MAVLink_heartbeat_message)
        or message.autopilot == mavlink.MAV_AUTOPILOT_INVALID
    ):
        return None
    if message.type in _NO_VEHICLES or message.get_srcSystem() == 0:
        return None
    armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
    return Vehicle(
        message.get_srcSystem(), message.get_srcComponent(), message.autopilot, message.type, armed
    )


class VehicleSearch:
    """Search for the vehicle ``system_id`` (None: the first vehicle that is not in ``besides``)."""

    def __init__(self, system_id: int | None = None, besides: Collection[int] = ()) -> None:
        self.found: Vehicle | None = None
        self.others: dict[int, Vehicle] = {}  # other vehicles that were heard, by system id
        self._wanted, self._besides = system_id, besides

    def take(self, message: Message) -> Vehicle | None:
        """Handle a message; return the vehicle that is searched for if this is its first heartbeat."""
        heard = None if self.found is not None else vehicle_of(message)
        if heard is None:
            return None
        if self._wanted == heard.system_id or (self._wanted is None and heard.system_id not in self._besides):
            self.found = heard
            return heard
        self.others[heard.system_id] = heard
        return None

    def failure(self, link: str, wait_s: float) -> NoVehicleError:
        """Return the error for a timeout, with the vehicles that were heard.

        >>> search = VehicleSearch(9)
        >>> search.others[1] = Vehicle(1, 1, 12, 2)
        >>> print(search.failure("udpin:127.0.0.1:14550", 10.0))
        udpin:127.0.0.1:14550: no vehicle with system id 9 was heard in 10 s, only system 1 (PX4); \
give the system id of a vehicle that was heard
        >>> print(VehicleSearch().failure("udpin:127.0.0.1:14550", 10.0))
        udpin:127.0.0.1:14550: no vehicle was heard in 10 s; start the vehicle, or check the address
        """
        who = "no vehicle" if self._wanted is None else f"no vehicle with system id {self._wanted}"
        if self._wanted is None and self._besides:
            who = f"no vehicle besides system {', '.join(map(str, sorted(self._besides)))}"
            return NoVehicleError(f"{link}: {who} was heard in {wait_s:g} s; start it, or use fewer vehicles")
        text, advice = f"{link}: {who} was heard in {wait_s:g} s", "start the vehicle, or check the address"
        if self.others:
            text += ", only " + ", ".join(str(vehicle) for _, vehicle in sorted(self.others.items()))
            advice = "give the system id of a vehicle that was heard"
        return NoVehicleError(f"{text}; {advice}")
