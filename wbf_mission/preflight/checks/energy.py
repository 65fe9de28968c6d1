"""Whether the battery is enough, in the wind, with its reserve."""

from __future__ import annotations

from collections.abc import Iterator

from wbf_mission.preflight.finding import Finding, Measure, Severity
from wbf_mission.preflight.subject import Subject

__all__ = ["check_battery"]

_COMFORT = 0.1
"""Less than this above the reserve deserves a look."""


def check_battery(subject: Subject) -> Iterator[Finding]:
    """What is left of a full battery at the end, against its reserve; and what the flight takes."""
    prediction, battery = subject.prediction, subject.vehicle.battery
    if prediction is None:
        return
    minutes, seconds = divmod(round(prediction.duration_s), 60)
    text = f"predicted: {prediction.path_length_m:.0f} m in {minutes} min {seconds} s"
    if battery is None:
        yield Finding(Severity.NOTE, "flight", text)
        return
    left = 1.0 - prediction.energy_wh / battery.capacity_wh
    reserve = battery.reserve_fraction
    takes = f"{prediction.energy_wh:.1f} of {battery.capacity_wh:g} Wh"
    measure = Measure(100.0 * left, "%", 100.0 * reserve)
    if left >= reserve + _COMFORT:
        yield Finding(Severity.NOTE, "flight", f"{text}, {takes}", measure=measure)
        return
    short = left < reserve
    yield Finding(
        Severity.ERROR if short and not subject.assumed else Severity.WARNING,
        "battery" if short else "battery-close",
        f"{text}, {takes}: less is left than the reserve"
        if short
        else f"{text}, {takes}: hardly more is left than the reserve",
        "fly a shorter mission, or in parts" if short else "begin with a full battery",
        measure=measure,
    )
