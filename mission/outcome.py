"""How far a flight is, and how it ended: as the vehicle knows it, and as the ground station learns it."""

from __future__ import annotations

from enum import Enum

__all__ = ["Outcome", "Phase", "in_words"]

_WORDS = {
    "cannot_fly_item": "an item cannot be flown",
    "battery_depleted": "battery empty in the air",
    "fence_breached": "geofence left",
    "flight_aborted": "landed before the mission's end",
    "no_contact": "no vehicle heard",
    "time_limit": "time limit passed",
    "pilot_took_over": "a pilot took over",
    "autopilot_restarted": "autopilot restarted in flight",
}
"""Of outcomes that their name with spaces does not describe to everybody."""


def in_words(outcome: Outcome | str, reason: str = "") -> str:
    """Return an outcome, by its value, as people read it, with its reason unless that says no more.

    Examples
    --------
    >>> in_words(Outcome.BATTERY_DEPLETED), in_words("arming_refused", "denied")
    ('battery empty in the air', 'arming refused: denied')
    >>> in_words("position_lost", "position lost")
    'position lost'
    """
    value = outcome.value if isinstance(outcome, Outcome) else outcome
    name = value.replace("_", " ")
    words = _WORDS.get(value, name)
    return f"{words}: {reason}" if reason not in ("", name, words) else words


class Outcome(Enum):
    """How a flight ended, or that it has not.

    A vehicle knows those from `COMPLETED` to `FLIGHT_ABORTED`; the others are of a ground station only.
    """

    RUNNING = "running"
    """Not over yet (also: never armed)."""
    COMPLETED = "completed"
    """The mission was flown to its end and the vehicle is on the ground, disarmed."""
    ARMING_REFUSED = "arming_refused"
    """The last request to arm was refused, and the vehicle never flew."""
    MISSION_REJECTED = "mission_rejected"
    """The mission, as uploaded or at its start, is none that this vehicle can fly."""
    CANNOT_FLY_ITEM = "cannot_fly_item"
    """An item stopped the mission in flight."""
    BATTERY_LOW = "battery_low"
    """The battery failsafe ended the mission; the vehicle returned or landed in time."""
    BATTERY_DEPLETED = "battery_depleted"
    """The battery was empty in the air; the vehicle came down where it was."""
    FENCE_BREACHED = "fence_breached"
    """The vehicle left the geofence, and its action ended the mission."""
    LINK_LOST = "link_lost"
    """The ground station was lost, and the failsafe ended the mission."""
    POSITION_LOST = "position_lost"
    """There was no position any more; the vehicle landed where it was."""
    CRASHED = "crashed"
    """The vehicle lost its thrust in the air."""
    FLIGHT_ABORTED = "flight_aborted"
    """The vehicle came down and disarmed before its mission was complete."""
    NO_CONTACT = "no_contact"
    """No vehicle was heard."""
    UPLOAD_FAILED = "upload_failed"
    """The vehicle did not take the mission."""
    NO_ANSWER = "no_answer"
    """The vehicle was heard, but then it was silent; what became of it is not known."""
    TIME_LIMIT = "time_limit"
    """The flight took much longer than it should."""
    NOT_STARTED = "not_started"
    """The operator did not let it start."""
    PILOT_TOOK_OVER = "pilot_took_over"
    """Somebody else took the vehicle out of its mission, and it came down so."""
    AUTOPILOT_RESTARTED = "autopilot_restarted"
    """The autopilot started again in flight, and that ended the mission."""
    INTERRUPTED = "interrupted"
    """Somebody stopped the run (Ctrl-C)."""

    @property
    def is_over(self) -> bool:
        """Whether the flight has ended."""
        return self is not Outcome.RUNNING

    @property
    def loses_vehicle(self) -> bool:
        """Whether there is no vehicle to fly again: it fell, or nobody knows where it is."""
        return self in (
            Outcome.CRASHED,
            Outcome.BATTERY_DEPLETED,
            Outcome.NO_CONTACT,
            Outcome.NO_ANSWER,
            Outcome.TIME_LIMIT,
        )

    @property
    def is_good(self) -> bool:
        """Whether the whole mission was flown."""
        return self is Outcome.COMPLETED


class Phase(Enum):
    """What the ground station is at."""

    CONTACT = "waiting for the vehicle"
    UPLOAD = "uploading"
    WAIT = "waiting for its turn to start"
    MODE = "choosing the mode to arm in"
    READY = "waiting until the vehicle can arm"
    ARM = "arming"
    START = "starting the mission"
    FLIGHT = "flying"
    FETCH = "fetching lost images"
    DONE = "done"
