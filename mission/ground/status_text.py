"""Texts that describe a vehicle to the operator: in flight, or after a stop before the flight."""

from __future__ import annotations

from geo.errors import WbfMissionError
from mission.ground.link_state import SILENCE_S
from mission.ground.station import GroundStation
from mission.outcome import Phase

_STOPPED = {
    Phase.CONTACT: "nothing was sent",
    Phase.UPLOAD: "nothing was started; the upload was broken off, so the plans on the vehicle are unknown",
    Phase.WAIT: "nothing was started; the uploaded plans stay in the vehicle",
    Phase.READY: "nothing was started; the uploaded plans stay in the vehicle",
    Phase.MODE: "the mission was not started; the uploaded plans stay in the vehicle",
    Phase.ARM: "the vehicle was ordered to arm, then to disarm: its motors may run; nothing was started",
    Phase.START: "the vehicle is armed and was ordered to start its mission: it may take off",
}


class NotStartedError(WbfMissionError, RuntimeError):
    """The user pressed Ctrl-C before the flight began; the text describes the state of the vehicle."""


_OLD_S = 3.0


def lost_position(ground: GroundStation) -> bool:
    """Return whether the vehicle was heard long after its last position, which is therefore out of date."""
    return ground.link.heard_s - ground.vehicle_state.heard_s > _OLD_S


def doing(ground: GroundStation, now_s: float) -> str:
    """Return mode, item and height of a vehicle in flight as text, and the age of values that are old."""
    state = ground.vehicle_state
    items = state.total or len(ground.mission.items)  # another station may have sent another mission
    parts = [
        ground.pilot.mode or "mode unknown",
        "item -" if state.item is None else f"item {state.item + 1} of {items}",
        f"{state.height_m:.1f} m up",
    ]
    if lost_position(ground):
        parts.append(f"height {now_s - state.heard_s:.0f} s old")
    silent_s = now_s - ground.link.heard_s
    old = f"nothing heard for {silent_s:.0f} s; the last was: " if silent_s > SILENCE_S else ""
    return old + ", ".join(parts)


def not_started(ground: GroundStation) -> str | None:
    """Return the state of the vehicle if the run ended before the flight, or None if the flight began."""
    return None if ground.started_s is not None else _STOPPED.get(ground.phase)
