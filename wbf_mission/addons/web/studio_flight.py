"""Flight of the studio in the simulator: start, stop and outcome."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import msgspec

from geo.errors import WbfMissionError
from mission.outcome import in_words
from wbf_mission.addons.web.view import View
from wbf_mission.addons.web.words import worded
from wbf_mission.events import Event, EventStream, Progressed, RunBegun, RunEnded, VehicleMoved
from wbf_mission.flight import Simulated, fly
from wbf_mission.scenario import Scenario


class FlightState(msgspec.Struct, frozen=True):
    """State of the latest flight: "none", "preparing", "flying" or an outcome; `words` explains it."""

    outcome: str = "none"
    words: str = ""


class StudioFlight:
    """Runs one flight in the simulator; a new flight stops the previous one."""

    def __init__(self) -> None:
        self.show: Callable[[View], None] = lambda _view: None
        self._thread: threading.Thread | None = None
        self._flown = Flown(View())
        self._lock = threading.Lock()

    def start(self, scenario: Scenario, pace: float | None, decider: str) -> None:
        """Start a flight of a planned scenario, in place of the current flight."""
        with self._lock:
            self._flown.stopping.set()
            view = View()
            self._flown = Flown(view, "preparing", decider)
            self.show(view)
            work = partial(self._flown.fly, scenario, pace)
            self._thread = threading.Thread(target=work, name="studio flight", daemon=True)
            self._thread.start()

    @property
    def state(self) -> FlightState:
        """State of the latest flight."""
        return self._flown.state

    def stop(self, wait_s: float = 0.0) -> bool:
        """Stop the flight and wait for its end; return whether a flight was running."""
        with self._lock:
            self._flown.stopping.set()
            flies = self._thread is not None and self._thread.is_alive()
            if self._thread is not None:
                self._thread.join(wait_s)
            return flies


class Flown:
    """One flight that a view shows and that can be stopped."""

    def __init__(self, view: View, outcome: str = "none", decider: str = "") -> None:
        self._view, self.state, self._decider = view, FlightState(outcome), decider
        self.stopping = threading.Event()

    def fly(self, scenario: Scenario, pace: float | None) -> None:
        """Fly until the end or a stop; after a stop, the readings are evaluated as after Ctrl-C."""
        events = EventStream()
        events.listen(self._take)
        events.listen(self._stop_if_asked, VehicleMoved, Progressed)
        try:
            fly(scenario, by=Simulated(pace=pace), events=events)
        except WbfMissionError as error:
            self._take(RunEnded(0.0, "failed", worded(error)))
        except KeyboardInterrupt:
            begun = self.state.outcome == "flying"
            why = "stopped while its readings were evaluated" if begun else "stopped before the start"
            self._take(RunEnded(0.0, "interrupted", why))

    def _take(self, event: Event) -> None:
        if isinstance(event, RunBegun) and event.farm is not None:
            # The mission's file has an internal name: show the planner's or policy's name instead.
            title = f"{event.farm.name}, {self._decider}"
            event = replace(event, title=title, planner=self._decider)
        self._view.take(event)
        if isinstance(event, RunEnded):
            self.state = FlightState(event.outcome, in_words(event.outcome, event.reason))
        elif isinstance(event, VehicleMoved) and self.state.outcome == "preparing":
            self.state = FlightState("flying")

    def _stop_if_asked(self, _event: object) -> None:
        if self.stopping.is_set():
            self.stopping.clear()  # Stop only once: the readings must still be evaluated
            raise KeyboardInterrupt
