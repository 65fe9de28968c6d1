"""Whether the battery is enough, in the wind, with its reserve."""

from __future__ import annotations

import math
from collections.abc import Iterator

from wbf_mission.preflight.finding import Finding, Measure, Severity
from wbf_mission.preflight.subject import Subject

__all__ = ["check_battery"]

_COMFORT = 0.1
"""Less than this above the reserve deserves a look; who plans for the whole battery has nothing above it."""


def check_battery(subject: Subject) -> Iterator[Finding]:
    """What is left of a full battery at the end, against its reserve; and what the flight takes."""
    prediction, battery = subject.prediction, subject.vehicle.battery
    if prediction is None:
        return
    minutes, seconds = divmod(round(prediction.duration_s), 60)
    takes = f"{minutes} min {seconds} s" if minutes else f"{seconds} s"
    until = "" if subject.stopped is None else "until it ends there, "
    wind = subject.wind
    speed_m_s = 0.0 if wind is None else math.hypot(wind.east_m_s, wind.north_m_s)
    gusty = wind is not None and wind.is_gusty
    air = (
        f"a wind of {speed_m_s:.3g} m/s{' and gusts' if gusty else ''}" if speed_m_s or gusty else "calm air"
    )
    over_ground = f"{prediction.ground_length_m:.1f} m over ground"
    text = f"{until}the flight is predicted to take {takes} in {air}: {over_ground}"
    if battery is None or subject.stopped is not None:
        yield Finding(Severity.NOTE, "flight", text)
        return
    left = 1.0 - prediction.energy_wh / battery.capacity_wh
    reserve = battery.reserve_fraction
    text += f", {prediction.energy_wh:.1f} of {battery.capacity_wh:g} Wh"
    measure = Measure.at_least("left in the battery at the end", 100.0 * left, 100.0 * reserve, "%")
    if left >= reserve + _COMFORT:
        yield Finding(Severity.NOTE, "flight", text, measure=measure)
        return
    short = left < reserve
    severity = Severity.NOTE
    if short:
        severity = Severity.WARNING if subject.assumed else Severity.ERROR
    yield Finding(
        severity,
        "battery" if short else "battery-close",
        f"{text}; {prediction.reason if short else 'hardly more is left at the end than the reserve'}",
        "fly a shorter mission, or in parts" if short else "begin with a full battery",
        measure=measure,
    )
