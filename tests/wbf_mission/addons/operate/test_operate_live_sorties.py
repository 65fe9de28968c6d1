"""Missions longer than a battery behind a link: our simulator as the vehicle, over real sockets."""

import time
from dataclasses import replace

import numpy as np
import pytest
from stand_in import LONG_S, heard, scenario, stand_in
from tcp_relay import TcpRelay

from mission.course import Course, Place
from mission.files import read_mission
from mission.ground.modes import Maneuver
from mission.link import FrameReader, FrameWriter
from mission.link.codec.dialect import mavlink as m
from mission.link.tlog import read_tlog
from mission.outcome import Outcome, Phase
from mission.sorties import part_of
from wbf_mission import load_result
from wbf_mission.addons.operate import console as operator_console
from wbf_mission.addons.operate import real_sorties
from wbf_mission.addons.operate.console import TerminalConsole
from wbf_mission.addons.operate.link import LiveLink
from wbf_mission.addons.operate.real_sorties import (
    BatteryWait,
    needed_fraction,
    reached_place,
    risen_fraction,
)
from wbf_mission.addons.operate.watching import WatchedVehicle
from wbf_mission.cli.app import main
from wbf_mission.cli.output import Output
from wbf_mission.events import Noted
from wbf_mission.exit_codes import ExitCode, exit_code_of_flight
from wbf_mission.flight import fly
from wbf_mission.planning.sorties import sorties_of
from wbf_mission.run.plan import plan

FARM = "miniberry-30"
FASTER = 12.0
BUDGETS = {"px4": "120m", "ardupilot": "110m"}
"""Of a mission of two sorties."""


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A vehicle whose battery lasts for two minutes, and gives next to nothing on the ground."""
    file = tmp_path_factory.mktemp("vehicles") / "small.toml"
    file.write_text(
        'base = "quad"\n[battery]\ncapacity_wh = 6.0\ncritical_fraction = 0.195\n'
        "[power]\navionics_w = 0.1\ncamera_w = 0.1\nidle_w = 1.0\n"
    )
    return str(file)


def asked(small, **more):
    """Return a mission of two sorties."""
    return scenario(**{"vehicle": small, "farm": FARM, "budget": "120m", **more})


class Operator:
    """Agrees to each start, and changes the battery when asked."""

    def __init__(self, made, *, change=True, answer=True, act=lambda flight, number: None):
        self.made, self.change, self.answer, self.act = made, change, answer, act
        self.questions, self.flights = [], []
        self.between = lambda: None
        self.began_s = time.monotonic()

    def tend(self, flight):
        assert time.monotonic() < self.began_s + LONG_S, "the flight does not end"
        if flight not in self.flights:
            self.flights.append(flight)
        ground = flight.sorties[0].ground
        if ground.phase is Phase.READY:
            ground.arming_gate.agree()
        if ground.phase is Phase.FLIGHT:
            self.act(flight, len(self.flights))

    def goes_on(self, question):
        assert time.monotonic() < self.began_s + LONG_S, "it waits without end"
        if question in self.questions:
            return None
        self.questions.append(question)
        assert not self.made.vehicle.pilot.armed
        if self.change:
            self.made.vehicle.pilot.change_battery()
            self.made.vehicle.reboot()
        self.between()
        return self.answer


def returns_once(images):
    """Return what an operator does who has the first sortie come back after so many images."""
    done = []

    def act(flight, number):
        if number == 1 and not done and flight.sorties[0].assembler.statistics.images >= images:
            done.append(True)
            flight.maneuver(Maneuver.RETURN)

    return act


def armings(tlog):
    """Return how often the motors were started in a log."""
    beats = [
        bool(one.base_mode & m.MAV_MODE_FLAG_SAFETY_ARMED)
        for _, one in read_tlog(tlog)
        if isinstance(one, m.MAVLink_heartbeat_message) and one.get_srcComponent() == 1
    ]
    return sum(armed and not before for before, armed in zip([False, *beats], beats, strict=False))


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", BUDGETS)
def test_sorties_are_flown_one_after_the_other(small, autopilot, tmp_path):
    (events, told), tlog = heard(Noted), tmp_path / "run.tlog"
    with (
        stand_in(autopilot, vehicle=small, farm=FARM, speed=FASTER) as (behind, made),
        TcpRelay(behind) as relay,
    ):
        operator = Operator(made)
        operator.between = relay.drop
        link = LiveLink(relay.url, operator, tlog=tlog)
        result = fly(asked(small, budget=BUDGETS[autopilot]), by=link, events=events)
    assert (result.outcome, result.stopped, result.rest) == (Outcome.COMPLETED, "", None)
    count = len(result.flights)
    assert count == 2 and f"longer than a battery: {count} sorties" in " ".join(note.text for note in told)
    assert operator.questions == [
        "sortie 2 of 2: change the battery of the vehicle, then press Enter (q ends)"
    ]
    assert [one.flight for one in result.flights] == [1, 2] and len(result.days) == 1
    assert all(one.outcome is Outcome.COMPLETED and one.battery_used < 0.75 for one in result.flights)
    times_s = list(result.history.times_s)
    assert times_s == sorted(times_s) and result.simulated_s > result.flight_time_s
    # One log, one estimate.
    assert armings(tlog) == 2
    seen = result.summary()
    assert seen["coverage"] == pytest.approx(seen["predicted_coverage"], abs=0.03)
    assert result.history.entries and len(result.observations) == sum(
        one.camera.observations for one in result.flights
    )
    # The score's clock goes on over the change.
    assert result.simulated_s > sum(one.flight_time_s for one in result.flights) / FASTER


@pytest.mark.slow
def test_a_sortie_that_the_operator_ends_is_gone_on_with_where_it_was(small, tmp_path):
    with stand_in(vehicle=small, farm=FARM, speed=FASTER) as (url, made):
        operator = Operator(made, act=returns_once(12))
        result = fly(asked(small), by=LiveLink(url, operator))
    first, *others = result.flights
    assert (result.outcome, result.stopped, result.rest) == (Outcome.COMPLETED, "", None)
    assert first.resumed and first.outcome is Outcome.INTERRUPTED and len(others) == 2
    assert 12 <= first.camera.images < 0.6 * images_planned(small)
    assert all(one.outcome is Outcome.COMPLETED and not one.resumed for one in others)
    seen = result.summary()
    assert seen["coverage"] > seen["predicted_coverage"] - 0.03
    # What was flown again is the overlap, not the whole part.
    images = [one.camera.images for one in result.flights]
    assert sum(images[1:]) < images_planned(small) + 25
    result.save(tmp_path / "run", plots=False)
    loaded = load_result(tmp_path / "run")
    assert loaded.flights[0].resumed and loaded.outcome is Outcome.COMPLETED


def images_planned(small):
    whole = plan(asked(small))
    return whole.length_m / whole.farm.cell_size_m


def test_no_more_after_the_first_keeps_what_was_flown_and_the_rest(quick_stand_in, small, tmp_path, capsys):
    with quick_stand_in(vehicle=small, farm=FARM, speed=FASTER) as (url, made):
        operator = Operator(made, answer=False)
        result = fly(asked(small), by=LiveLink(url, operator))
    assert len(result.flights) == 1 and result.flights[0].outcome is Outcome.COMPLETED
    assert (
        result.outcome is Outcome.INTERRUPTED and exit_code_of_flight(result.outcome) is ExitCode.INTERRUPTED
    )
    assert result.reason == "stopped after flight 1 of 2: the operator ended the mission"
    assert result.final_score is not None and len(result.observations) > 20
    folder = tmp_path / "run"
    result.save(folder, plots=False)
    loaded = load_result(folder)
    assert (loaded.outcome, loaded.reason, loaded.rest) == (result.outcome, result.reason, result.rest)
    out = tmp_path / "rest.plan"
    resume = ["plan", "--farm", FARM, "--vehicle", small, "--resume", str(folder), "--out", str(out)]
    assert main(resume) == 0, capsys.readouterr().err
    assert loaded.plan.vehicle == result.plan.vehicle  # Its name, too
    of_run = ["plan", "--resume", str(folder), "--out", str(tmp_path / "again.plan")]
    assert main(of_run) == 0 and read_mission(tmp_path / "again.plan") == read_mission(out)
    whole = plan(asked(small)).mission
    assert read_mission(out).items[-3:] == whole.items[-3:]
    assert len(read_mission(out).items) < len(whole.items)


@pytest.mark.slow
def test_without_an_operator_the_reading_tells(small):
    faults = ["battery-change=5"]
    with stand_in(vehicle=small, farm=FARM, speed=FASTER, system_faults=faults) as (url, made):
        operator = Operator(made, change=False)
        result = fly(asked(small), by=LiveLink(url, operator, agreed=True))
    assert result.outcome is Outcome.COMPLETED and len(result.flights) == 2
    assert operator.questions == []


@pytest.mark.slow
def test_a_sortie_that_the_battery_ends_is_gone_on_with(small):
    faults = ["battery-change=5", "low-battery=0.19,at=airborne,from=25"]
    with stand_in(vehicle=small, farm=FARM, speed=FASTER, system_faults=faults) as (url, made):
        result = fly(asked(small), by=LiveLink(url, Operator(made, change=False), agreed=True))
    outcomes = [one.outcome for one in result.flights]
    assert outcomes[0] is Outcome.BATTERY_LOW and set(outcomes[1:]) == {Outcome.COMPLETED}
    assert result.outcome is Outcome.COMPLETED and result.flights[0].resumed
    seen = result.summary()
    assert seen["coverage"] > seen["predicted_coverage"] - 0.03


def watched(reads, *, armed=False):
    vehicle = WatchedVehicle((1, 1))
    mode = m.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0
    vehicle.receive(m.MAVLink_heartbeat_message(2, 12, mode, 0, 4, 3), 0.0)
    if reads is not None:
        unknown = [65535] * 10
        vehicle.receive(m.MAVLink_battery_status_message(0, 0, 0, 32767, unknown, -1, -1, -1, reads), 0.0)
    return vehicle


@pytest.mark.parametrize(
    ("vehicle", "said", "risen", "settled", "told"),
    [
        (watched(99), True, 0.7, "", ""),
        (watched(99), None, 0.7, None, ""),
        (watched(99), False, 0.7, "the operator ended the mission", ""),
        (watched(60), True, 0.7, None, "reads 60%, the next sortie needs 80%: waiting for a fuller battery"),
        (watched(99, armed=True), True, 0.7, None, "its motors are running"),
        (None, True, 0.7, None, "waiting for the vehicle"),
        (watched(99), "nobody", 0.7, "", ""),
        (watched(85), "nobody", 0.9, None, ""),  # enough, but not changed
        (watched(75), "nobody", 0.7, None, ""),
        (watched(99), "nobody", None, None, ""),
        (watched(99, armed=True), "nobody", 0.7, None, ""),
    ],
)
def test_when_a_vehicle_flies_on(vehicle, said, risen, settled, told):
    notes = []
    asks = None if said == "nobody" else lambda: said
    wait = BatteryWait(0.8, asks, risen, 60.0, notes.append)
    assert wait._settled(vehicle, 1.0) == settled
    assert told in "; ".join(notes) and bool(told) == bool(notes)


@pytest.mark.parametrize(
    ("before", "lowest", "reads", "changed"),
    [
        (1.0, 0.51, 99, True),
        (1.0, 0.51, 80, True),
        (1.0, 0.10, 60, True),
        (1.0, 0.51, 56, False),  # it recovers without a load
        (0.8, 0.60, 95, True),
        (0.8, 0.75, 77, False),  # half of what was taken, though it was little
        (0.8, 0.75, 90, True),  # a battery that never reads full
        (0.8, None, 99, False),
    ],
)
def test_a_battery_is_changed_when_half_of_what_was_taken_is_there_again(before, lowest, reads, changed):
    wait = BatteryWait(0.5, None, risen_fraction(before, lowest), 60.0, [].append)
    assert wait._settled(watched(reads), 1.0) == ("" if changed else None)


def test_a_sortie_needs_its_most_and_the_reserve(small):
    one = plan(asked(small, budget="60m"))
    battery, most_wh = one.vehicle.battery, one.prediction.most_wh
    assert needed_fraction(one) == pytest.approx(most_wh / 6.0 + battery.reserve_fraction)
    assert battery.reserve_fraction == 0.2


def test_a_vehicle_that_tells_no_reading_is_believed_with_a_note():
    notes = []
    wait = BatteryWait(0.8, iter([True, *[None] * 9]).__next__, 0.7, 60.0, notes.append)
    assert wait._settled(watched(None), 1.0) is None, "it may tell yet"
    assert wait._settled(watched(None), 8.0) == ""
    assert notes == ["the vehicle does not report its battery's charge; the battery is assumed to be full"]
    alone = BatteryWait(0.8, None, 0.7, 60.0, notes.append)
    alone._settled(watched(None), 1.0)
    assert "confirm the change" in alone._settled(watched(None), 8.0)


class SilentHost:
    """A link to a vehicle that is silent from 1 to 9 s, while its battery is changed."""

    def __init__(self, components, _urls):
        (self.watch,), self.now_s = components, 0.0

    def __enter__(self):
        return self

    def __exit__(self, *_error):
        pass

    def run(self, limit_s):
        self.now_s += limit_s
        if self.now_s == 1.0 or self.now_s >= 9.0:
            self.hear(m.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3))
        if self.now_s == 1.0 or self.now_s >= 10.0:
            reads = 70 if self.now_s == 1.0 else 99
            unknown = [65535] * 10
            self.hear(m.MAVLink_battery_status_message(0, 0, 0, 32767, unknown, -1, -1, -1, reads))

    def hear(self, message):
        self.watch.receive(FrameReader().feed(FrameWriter(1, 1).encode(message))[0], self.now_s)


def test_the_reading_of_a_vehicle_without_its_battery_does_not_count(monkeypatch):
    """Enter is pressed at 6 s; the charge from before would be enough, too."""
    hosts, notes = [], []
    monkeypatch.setattr(
        real_sorties, "LinkHost", lambda *given: hosts.append(SilentHost(*given)) or hosts[-1]
    )
    wait = BatteryWait(0.5, lambda: True if hosts[-1].now_s == 6.0 else None, None, 60.0, notes.append)
    assert wait.wait("tcp:there:1", 1) == ""
    assert hosts[-1].now_s == 10.0
    assert notes == ["waiting for the vehicle"]


def test_the_operator_is_asked_at_the_terminal(monkeypatch, capsys):
    typed = iter([None, "\n", None, "Q\n", ""])
    monkeypatch.setattr(operator_console, "_line", lambda: next(typed))
    console = TerminalConsole(Output())
    answers = [console.goes_on(question) for question in ("two?", "two?", "three?", "three?", "three?")]
    assert answers == [None, True, None, False, False]
    assert capsys.readouterr().err.count("two?") == 1


def test_how_far_the_whole_is_flown_is_told_by_the_place_on_a_sortie(small):
    one = asked(small, budget="200m")
    cut = sorties_of(plan(one), one, full=0.75)
    assert len(cut.sorties) > 2
    course = cut.course
    for number, sortie in enumerate(cut.sorties):
        assert sortie.plan.prediction.most_wh <= (0.75 - 0.2) * 6.0
        own = Course(sortie.plan.mission)
        begin_m = course.metres(sortie.begin)
        end_m = course.length_m if sortie.end is None else course.metres(sortie.end)
        assert reached_place(cut, number, None) == sortie.end
        before_m = begin_m
        for leg in own.legs:
            for fraction in (0.0, 0.3, 0.7):
                place = Place(leg.item, fraction)
                reached = reached_place(cut, number, place)
                metres = end_m if reached == sortie.end else course.metres(reached)
                assert before_m - 1e-6 <= metres <= end_m + 1e-6
                before_m = metres
                if begin_m < metres < end_m:
                    there = course.frame.from_wgs84(*course.position(reached)[:2])
                    here = course.frame.from_wgs84(*own.position(place)[:2])
                    assert np.hypot(*np.subtract(here, there)) < 0.01
        assert before_m > begin_m + 0.6 * (end_m - begin_m)


@pytest.mark.parametrize(
    ("begin", "end"),
    [(Place(6, 0.4), Place(8, 0.6)), (Place(6, 0.8), Place(6, 0.9)), (Place(4), Place(5, 0.5))],
)
def test_the_same_of_a_sortie_that_begins_and_ends_in_the_midst_of_legs(small, begin, end):
    one = asked(small, budget="200m")
    cut = sorties_of(plan(one), one)
    mission = part_of(cut.course, begin, end, overlap_m=cut.overlap_m, hold_s=2.0)
    sortie = replace(cut.sorties[1], begin=begin, end=end, plan=replace(cut.whole, mission=mission))
    cut, own = replace(cut, sorties=(sortie,)), Course(mission)
    last = own.legs[-1].item
    for back in (0.01, 0.1, 0.2):
        place = reached_place(cut, 0, Place(last, 1.0 - back))
        metres = float(own.lengths_m[-1]) * back
        assert cut.course.metres(place) == pytest.approx(
            max(cut.course.metres(end) - metres, cut.course.metres(begin)), abs=0.02
        )
    assert reached_place(cut, 0, Place(last + 1)) == reached_place(cut, 0, None) == end
    assert reached_place(cut, 0, Place(own.legs[0].item, 0.5)) == begin or begin == cut.course.start
