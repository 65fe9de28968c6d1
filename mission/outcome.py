"""Outcomes of a flight, and phases of a ground station during a flight."""

from __future__ import annotations

from enum import Enum

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
"""Texts for outcomes whose names do not explain themselves."""


def in_words(outcome: Outcome | str, reason: str = "") -> str:
    """Return the text of an outcome, followed by its reason unless the reason says the same.

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
    """Outcome of a flight.

    Vehicles have the outcomes `COMPLETED` to `FLIGHT_ABORTED`; a ground station has all outcomes.
    """

    RUNNING = "running"
    """The flight is in progress, or the vehicle has not armed."""
    COMPLETED = "completed"
    """The mission was flown to its end and the vehicle is on the ground, disarmed."""
    ARMING_REFUSED = "arming_refused"
    """The last request to arm was refused, and the vehicle never flew."""
    MISSION_REJECTED = "mission_rejected"
    """The vehicle rejected the mission at upload or at the start."""
    CANNOT_FLY_ITEM = "cannot_fly_item"
    """The vehicle stopped the mission in flight at an item that it cannot fly."""
    BATTERY_LOW = "battery_low"
    """The battery failsafe ended the mission; the vehicle returned or landed in time."""
    BATTERY_DEPLETED = "battery_depleted"
    """The battery was empty in the air; the vehicle came down where it was."""
    FENCE_BREACHED = "fence_breached"
    """The vehicle left the geofence, and the fence action ended the mission."""
    LINK_LOST = "link_lost"
    """The vehicle lost the link to the ground station, and the failsafe ended the mission."""
    POSITION_LOST = "position_lost"
    """The vehicle lost its position estimate and landed where it was."""
    CRASHED = "crashed"
    """The vehicle lost its thrust in the air."""
    FLIGHT_ABORTED = "flight_aborted"
    """The vehicle came down and disarmed before its mission was complete."""
    NO_CONTACT = "no_contact"
    """No message of a vehicle arrived."""
    UPLOAD_FAILED = "upload_failed"
    """The upload of the mission failed."""
    NO_ANSWER = "no_answer"
    """The messages of the vehicle stopped; the state of the vehicle is unknown."""
    TIME_LIMIT = "time_limit"
    """The flight exceeded its time limit."""
    NOT_STARTED = "not_started"
    """The operator refused the start."""
    PILOT_TOOK_OVER = "pilot_took_over"
    """A pilot or another ground station took the vehicle out of its mission, and the vehicle landed."""
    AUTOPILOT_RESTARTED = "autopilot_restarted"
    """The autopilot restarted in flight, which ended the mission."""
    INTERRUPTED = "interrupted"
    """The user stopped the run (Ctrl-C)."""

    @property
    def is_over(self) -> bool:
        """Whether the flight has ended."""
        return self is not Outcome.RUNNING

    @property
    def loses_vehicle(self) -> bool:
        """Whether the vehicle cannot fly again: it crashed, or its state is unknown."""
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
    """Phase of a ground station during a flight."""

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
