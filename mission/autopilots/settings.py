"""Which parameters of an autopilot change what a plan assumes, under their names of several versions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum

__all__ = ["Meaning", "Question", "VehicleSettings", "answer_to", "question"]


class Meaning(Enum):
    """What a parameter decides."""

    CRUISE_SPEED = "the speed of a mission that sets none"
    FASTEST = "the greatest speed"
    ACCEPTANCE_RADIUS = "the acceptance radius of waypoints"
    RETURN_HEIGHT = "the height of the return"
    LOW_BATTERY = "what a low battery does"
    LINK_LOST = "what a lost link does"
    LINK_LOST_OPTIONS = "whether a mission goes on without a link"
    TAKEOFF_AND_LANDING = "whether a mission needs a take-off and a landing"
    FENCE_ON = "whether the fence counts"
    FENCE_ACTION = "what a broken fence does"
    FENCE_TYPES = "what belongs to the fence"
    FENCE_CEILING = "the ceiling"
    FENCE_RADIUS = "how far from home"
    LANDS_AS_MISSION = "whether a return flies the landing of the mission"
    MISSION_CARD = "the room for a mission on an SD card"
    ACCELEROMETER = "the accelerometer's calibration"
    GYROSCOPE = "the gyroscope's calibration"
    COMPASS = "the compass's calibration"


@dataclass(frozen=True, slots=True)
class Question:
    """A parameter that is asked for."""

    meaning: Meaning
    names: tuple[tuple[str, float], ...]
    """Its names, that of the newest version first, and SI units in a unit of each."""


def question(meaning: Meaning, *names: str | tuple[str, float]) -> Question:
    """Return what is asked for a meaning; a name alone is in SI units."""
    return Question(meaning, tuple((one, 1.0) if isinstance(one, str) else one for one in names))


@dataclass(frozen=True, slots=True)
class VehicleSettings:
    """The parameters of an autopilot that a plan depends on, and what some of their values mean."""

    questions: Mapping[int | None, tuple[Question, ...]] = field(default_factory=dict)
    """What is asked, by MAV_TYPE; None for any other."""
    link_goes_on: frozenset[float] = frozenset({0.0})
    """Values of `Meaning.LINK_LOST` with which a mission is flown on."""
    fence_off: frozenset[float] = frozenset()
    """Values of `Meaning.FENCE_ACTION` with which a fence does nothing."""
    fence_tells: frozenset[float] = frozenset({0.0})
    """Those with which a broken fence is only told."""

    def asked_of(self, vehicle_type: int) -> tuple[Question, ...]:
        """Return what is asked of a vehicle (MAV_TYPE)."""
        return self.questions.get(vehicle_type, self.questions.get(None, ()))


def answer_to(
    meaning: Meaning, questions: Sequence[Question], parameters: Mapping[str, float]
) -> tuple[str, float] | None:
    """Return the name of a parameter and its value in SI units; None if it was not read.

    Examples
    --------
    >>> height = question(Meaning.RETURN_HEIGHT, "RTL_ALT_M", ("RTL_ALT", 0.01))
    >>> answer_to(Meaning.RETURN_HEIGHT, [height], {"RTL_ALT": 1500.0})
    ('RTL_ALT', 15.0)
    """
    for question in questions:
        if question.meaning is meaning:
            for name, unit in question.names:
                if name in parameters:
                    return name, parameters[name] * unit
    return None
