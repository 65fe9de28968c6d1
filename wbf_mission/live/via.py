"""Who talks to the vehicle at the other end of a link, by its name."""

from __future__ import annotations

from wbf_mission.live.hosting import Via

__all__ = ["via_named"]


def via_named(name: str) -> Via:
    """Return a way by its name, ``own`` or ``mavsdk``; MAVSDK is loaded only when it is asked for."""
    if name == "mavsdk":
        from wbf_mission.live.via_mavsdk.adapter import MavsdkVia

        return MavsdkVia()
    return Via()
