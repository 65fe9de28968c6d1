"""Flights that are flown in other processes: the same as one after the other, also if a process dies."""

import itertools
import os
import signal
import threading

import joblib
import numpy as np
import pytest

import wbf_mission.run.reuse
from mission.outcome import Outcome
from wbf_mission.events import EventStream, Progressed
from wbf_mission.flight import Simulated, fly
from wbf_mission.run.hosting import VirtualHosting
from wbf_mission.run.resolve import resolve
from wbf_mission.run.reuse import FlightsAhead, can_fly_ahead
from wbf_mission.scenario import Scenario

SHORT = Scenario(
    farm="miniberry-10",
    vehicle="quad",
    budget="60m",
    planner="random-waypoint",
    estimator="point",
    seed=3,
    days=2,
    flights_per_day=2,
)


@pytest.fixture
def worth(monkeypatch):
    """Make every run worth other processes, on a machine of two cores."""
    monkeypatch.setattr(wbf_mission.run.reuse, "WORTH_S", 0.0)
    monkeypatch.setattr(joblib, "cpu_count", lambda: 2)


def assert_alike(one, other):
    assert one.history == other.history
    assert one.outcome == other.outcome and one.reason == other.reason
    assert one.simulated_s == other.simulated_s and one.frames == other.frames
    np.testing.assert_array_equal(one.observations.values, other.observations.values)
    np.testing.assert_array_equal(one.observations.time_s, other.observations.time_s)
    assert one.model is not None and other.model is not None
    np.testing.assert_array_equal(one.model.value, other.model.value)
    assert [record.summary() for record in one.flights] == [record.summary() for record in other.flights]
    assert [record.seen_before for record in one.flights] == [record.seen_before for record in other.flights]
    assert timeless(one) == timeless(other)


def timeless(run):
    return [{**record.summary(), "compute_s": 0.0} for record in run.decisions]


def counted(monkeypatch):
    """Note what the flights flown ahead gave."""
    taken = []
    take = FlightsAhead.take

    def noted(self, day, flight):
        taken.append(take(self, day, flight))
        return taken[-1]

    monkeypatch.setattr(FlightsAhead, "take", noted)
    return taken


def test_flights_ahead_are_those_one_after_the_other(request, monkeypatch, tmp_path):
    taken = counted(monkeypatch)
    alone = fly(SHORT, by=Simulated(tlog=tmp_path / "alone.tlog"))
    assert not taken, "a short run needs no other processes"
    request.getfixturevalue("worth")
    # A terminal's progress bar has a lock, which cannot be sent to another process.
    events, lock, done = EventStream(), threading.RLock(), list[str]()

    def hear(event):
        with lock:
            done.append(event.what)

    events.listen(hear, Progressed)
    ahead = fly(SHORT, by=Simulated(tlog=tmp_path / "ahead.tlog"), events=events)
    assert len(taken) == 4 and None not in taken and done.count("flying") >= 4
    assert_alike(ahead, alone)
    assert (tmp_path / "ahead.tlog").read_bytes() == (tmp_path / "alone.tlog").read_bytes()
    assert [one.observations for one in ahead.decisions] == [one.seen_before for one in ahead.flights]


@pytest.mark.usefixtures("worth")
@pytest.mark.parametrize("finished", [0, 2])
def test_ctrl_c_keeps_the_flights_that_are_over(monkeypatch, tmp_path, finished):
    take, count = FlightsAhead.take, itertools.count()

    def interrupted(self, day, flight):
        if next(count) == finished:
            raise KeyboardInterrupt
        return take(self, day, flight)

    monkeypatch.setattr(FlightsAhead, "take", interrupted)
    log = tmp_path / "flight.tlog"
    if not finished:
        with pytest.raises(KeyboardInterrupt):
            fly(SHORT, by=Simulated(tlog=log))
        assert not log.exists()
        return
    result = fly(SHORT, by=Simulated(tlog=log))
    assert len(result.flights) == 2 and result.outcome is Outcome.INTERRUPTED
    assert log.stat().st_size > 0


@pytest.mark.usefixtures("worth")
def test_a_fleet_that_loses_a_vehicle_is_flown_one_after_the_other(monkeypatch):
    faults = ["motor-failure,vehicle=2,at=airborne,from=10"]
    fleet = Scenario(**{**SHORT.to_dict(), "days": 1, "vehicles": 2})
    taken = counted(monkeypatch)
    ahead = fly(fleet, by=Simulated(faults=faults))
    assert len(taken) == 1, "what is lost in the first flight is missing in all others"
    monkeypatch.setattr(wbf_mission.run.reuse, "WORTH_S", np.inf)
    assert_alike(ahead, fly(fleet, by=Simulated(faults=faults)))
    assert ahead.outcome is Outcome.CRASHED


@pytest.mark.usefixtures("worth")
@pytest.mark.parametrize(
    ("options", "hosting"),
    [
        ({"planner": None, "policy": "greedy"}, VirtualHosting()),
        ({}, VirtualHosting(pace=10.0)),
        ({"farm": "waterberry"}, VirtualHosting()),
    ],
)
def test_some_runs_are_not_flown_ahead(options, hosting):
    assert can_fly_ahead(resolve(SHORT), VirtualHosting(), 1.0)
    given = {key: value for key, value in {**SHORT.to_dict(), **options}.items() if value is not None}
    assert not can_fly_ahead(resolve(Scenario(**given)), hosting, 1e9)


def _dies(day, flight):
    """Fly nothing; the process of one flight is killed, as by a lack of memory."""
    if (day, flight) == (6, 2):
        os.kill(os.getpid(), signal.SIGKILL)
    return day + flight


def test_what_a_killed_process_should_have_flown_is_flown_here():
    killed = _dies
    ahead = FlightsAhead(killed, [(6, 2), (7, 1)])
    try:
        assert ahead.take(6, 2) is None
        assert ahead.take(9, 9) is None
    finally:
        ahead.close()
