"""Sorties of a real vehicle: their progress, and the battery changes between them."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from mission.course import Course, MissionProgress, Place
from mission.errors import LinkError, MissionError
from mission.model import DEGREES_E7, Mission
from mission.outcome import in_words
from mission.sorties import resumed_at
from wbf_mission.addons.base.links import LinkHost
from wbf_mission.addons.operate.watching import FleetWatch, WatchedVehicle
from wbf_mission.planning import PlanResult
from wbf_mission.planning.fleet import Vehicle
from wbf_mission.planning.sorties import SortiePlan, UncutError, cut_plan, rest_of
from wbf_mission.run.record import FlightRecord

_MOST_IN_VAIN = 2
"""Number of sorties in a row without progress after which the run stops."""


class RealSorties:
    """Tracks a real vehicle's progress through its sorties; replans them after a sortie that ended early.

    `change_battery` waits until the vehicle has a charged battery. It returns the reason if the change fails,
    otherwise an empty text. Its arguments are the vehicle, the plan of the next sortie, the record of the
    previous sortie as ``last``, and the name of the next sortie as ``which``.
    """

    def __init__(
        self, cut: SortiePlan, vehicle: Vehicle, footprint: int, change_battery: Callable[..., str]
    ) -> None:
        self.cut = cut  # The flown sorties, shortened to their flown part, and the planned sorties
        self.stopped = ""  # Reason why the mission was stopped; empty if it was not
        self.changed_s = 0.0  # Duration of the last battery change
        self._vehicle, self._footprint, self._change_battery = vehicle, footprint, change_battery
        self._reached: Place | None = cut.course.start  # Place reached in the whole mission; None at its end
        self._progress: MissionProgress | None = None
        self._in_vain = 0

    def follow(self, flight: int) -> MissionProgress:
        """Return the progress tracker of flight number `flight`, from 1."""
        self._progress = MissionProgress(Course(self.cut.plans[flight - 1].mission))
        return self._progress

    def note(self, flight: int, record: FlightRecord) -> None:
        """After a flight, update the place that the vehicle has reached in the mission."""
        sortie = self.cut.sorties[flight - 1]
        reached = sortie.end
        if not record.outcome.is_good and self._progress is not None:
            try:
                reached = reached_place(self.cut, flight - 1, self._progress.place())
            except MissionError:  # The vehicle never began the mission.
                reached = sortie.begin
        self._in_vain = self._in_vain + 1 if reached == sortie.begin else 0
        self._reached = reached

    def go_on(self, flight: int, record: FlightRecord) -> bool:
        """Change the battery after a flight; return whether another sortie follows."""
        if self._reached is None:
            return False
        good, early = record.outcome.is_good, f"stopped after flight {flight}: "
        if not good:
            lost = record.outcome.loses_vehicle or not record.flight_time_s
            if lost or self._in_vain == _MOST_IN_VAIN:
                self.stopped = early + (record.reason or in_words(record.outcome))
                return False
            try:
                self._cut_again(flight, self._reached)
            except UncutError as error:
                self.stopped = early + f"the rest of the mission cannot be flown: {error}"
                return False
        count = len(self.cut.sorties)
        self.stopped = f"stopped after flight {flight} of {count}"
        begun_s = time.monotonic()
        why = self._change_battery(
            self._vehicle, self.cut.plans[flight], last=record, which=f"sortie {flight + 1} of {count}"
        )
        self.changed_s = time.monotonic() - begun_s
        self.stopped = f"{self.stopped}: {why}" if why else ""
        record.resumed = not (self.stopped or good)
        return not self.stopped

    @property
    def rest(self) -> Mission | None:
        """A mission with the part that is not flown yet; None if the whole mission is complete."""
        if self._reached is None:
            return None
        return rest_of(self.cut, self._vehicle.task.builder, self._reached)

    def _cut_again(self, flight: int, reached: Place) -> None:
        """Divide the rest of the mission into new sorties after an early end, or raise UncutError."""
        cut = self.cut
        ended = cut.sorties[flight - 1]
        if reached == ended.end:
            return
        again = cut_plan(
            cut.whole,
            self._vehicle.task.builder,
            footprint=self._footprint,
            begin=reached,
            overlap_m=cut.overlap_m,
            change_s=cut.change_s,
            full=cut.full,
        )
        flown = (*cut.sorties[: flight - 1], replace(ended, end=reached))
        self.cut = replace(cut, sorties=(*flown, *again.sorties))


def reached_place(cut: SortiePlan, number: int, place: Place | None) -> Place | None:
    """Convert a place in the mission of sortie `number` (from 0) to the same place in the whole mission.

    A `place` of None is the end of the sortie's mission, and a result of None is the end of the whole
    mission.
    """
    sortie, course = cut.sorties[number], cut.course
    begin = resumed_at(course, sortie.begin, cut.overlap_m)
    if place is None or begin is None:
        return sortie.end
    own = Course(sortie.plan.mission)
    leg, led, first = own.leg_of(place), 0, 0
    if sortie.begin > course.start and begin > course.start:
        # The legs to the resume point are not part of the whole mission.
        there, first = course.position(begin)[:2], course.leg_of(begin)
        led = 1 + next(k for k, other in enumerate(own.legs) if _is_at(other.end[:2], there))
    if leg < led:
        return sortie.begin
    number = first + leg - led
    end_m = course.length_m if sortie.end is None else course.metres(sortie.end)
    if leg == len(own.legs) or number >= len(course.legs):
        return sortie.end
    to_end_m = (1.0 - place.fraction) * float(own.lengths_m[leg])
    metres = min(float(course.ends_m[number]), end_m) - to_end_m
    last = len(course.legs) if sortie.end is None else course.leg_of(sortie.end)
    if number > last or metres >= end_m:
        return sortie.end
    found = course.place(max(metres, 0.0))
    return sortie.end if found is None else max(sortie.begin, found)


def _is_at(one: tuple[float, float], other: tuple[float, float]) -> bool:
    """Return whether two positions (degrees) are equal up to the rounding of mission items."""
    return max(abs(a - b) for a, b in zip(one, other, strict=True)) <= 1.0 / DEGREES_E7


REAL_FULL = 0.95
"""Lowest reading of a charged battery; it is below 1 because batteries age, and autopilots estimate charge by
voltage."""
_LOOK_S = 0.5
# Time (s) without a battery message after which the vehicle is assumed to send no battery messages.
_TELLS_S = 6.0
_BACK = 0.5
"""Without an operator, a rise by this fraction of the used charge shows that the battery was changed."""


def needed_fraction(plan: PlanResult) -> float | None:
    """Return the battery fraction that a sortie needs, with the reserve; None for an endless battery."""
    battery = plan.vehicle.battery
    if battery is None:
        return None
    return plan.prediction.most_wh / battery.capacity_wh + battery.reserve_fraction


def risen_fraction(before: float | None, lowest: float | None) -> float | None:
    """Return the battery fraction that proves a battery change: `lowest` plus half the used charge.

    `before` is the battery fraction before the last sortie; `lowest` is the lowest fraction during this
    sortie. The result is None if either is unknown.

    >>> risen_fraction(0.75, 0.25), risen_fraction(None, 0.5)
    (0.5, None)
    """
    return None if before is None or lowest is None else lowest + _BACK * (before - lowest)


@dataclass(slots=True)
class BatteryWait:
    """Waits for a vehicle's battery change before its next sortie."""

    needs: float | None  # Least battery reading for the next sortie; None for an endless battery
    # Called every half second; returns True once the operator has changed the battery, False to end the
    # mission, None before an answer. None if there is no operator: then the battery reading decides.
    asks: Callable[[], bool | None] | None
    risen: float | None  # Without an operator, a reading of at least this shows a change; None if unknown
    limit_s: float  # Timeout without an operator
    note: Callable[[str], None]  # Receives lines for the operator
    _said: bool = False  # Whether the operator has confirmed the change
    _noted: str = ""
    _heard_s: float = 0.0

    def wait(self, url: str, system_id: int) -> str:
        """Return why the vehicle cannot fly the next sortie ("" if it can); KeyboardInterrupt at Ctrl-C."""
        began_s = time.monotonic()
        while True:
            try:
                with LinkHost([watch := FleetWatch()], [url]) as host:
                    why = None
                    while why is None:
                        host.run(limit_s=_LOOK_S)
                        vehicle = watch.vehicles.get(system_id)
                        if vehicle is not None and vehicle.is_silent(host.now_s):
                            # It reported the charge of a battery that may be out by now.
                            del watch.vehicles[system_id]
                        why = self._settled(watch.vehicles.get(system_id), time.monotonic() - began_s)
                return why
            except LinkError as error:
                # The battery may power the radio, so the link can vanish during the change.
                self._note_once(f"{error}; trying again")
                time.sleep(_LOOK_S)
                if (ended := self._settled(None, time.monotonic() - began_s)) is not None:
                    return ended

    def _settled(self, vehicle: WatchedVehicle | None, waited_s: float) -> str | None:
        """Return why the vehicle cannot fly the next sortie ("" if it can); None while undecided."""
        if self.asks is not None:
            said = self.asks()
            if said is False:
                return "the operator ended the mission"
            if said:
                self._said, self._noted = True, ""
        reads = None if vehicle is None else vehicle.monitor.battery.remaining
        self._heard_s = 0.0 if vehicle is None else self._heard_s or waited_s or _LOOK_S
        if self.asks is None and waited_s > self.limit_s:
            reading = "reports no charge" if reads is None else f"reads {reads:.0%}"
            return f"the battery was not changed within {self.limit_s:g} s (the vehicle {reading})"
        if vehicle is None or vehicle.monitor.state.armed:
            if self._said:
                self._note_once("waiting for the vehicle" if vehicle is None else "its motors are running")
            return None
        if reads is None:
            return self._without_reading(waited_s)
        if self.asks is None:
            changed = self.risen is not None and reads >= self.risen
            return "" if changed and reads >= (self.needs or 0.0) else None
        if self._said and self.needs is not None and reads < self.needs:
            self._note_once(
                f"the battery reads {reads:.0%}, the next sortie needs {self.needs:.0%}:"
                " waiting for a fuller battery (q ends)"
            )
            return None
        return "" if self._said else None

    def _without_reading(self, waited_s: float) -> str | None:
        """Leave the decision to the operator alone, because the vehicle sends no battery messages."""
        if waited_s - self._heard_s < _TELLS_S:
            return None
        if self.asks is None:
            return "the vehicle does not report its battery's charge: confirm the change (leave out --yes)"
        if self._said:
            self.note("the vehicle does not report its battery's charge; the battery is assumed to be full")
            return ""
        return None

    def _note_once(self, text: str) -> None:
        """Send a line to the operator, unless it repeats the last line."""
        if text != self._noted:
            self._noted = text
            self.note(text)
