"""Battery change between two sorties, confirmed by the operator or by the vehicle's battery reading."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from mission.errors import LinkError
from wbf_mission.addons.base.links import LinkHost
from wbf_mission.addons.operate.watching import FleetWatch, WatchedVehicle
from wbf_mission.planning import PlanResult

__all__ = ["REAL_FULL", "BatteryWait", "needed_fraction", "risen_fraction"]

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
    """Return the lowest battery fraction that shows a battery change: `lowest` plus half the used charge.

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
    risen: float | None  # Without an operator, a reading from this counts as a change; None if unknown
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
        """Let the operator alone decide, because the vehicle sends no battery messages."""
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
