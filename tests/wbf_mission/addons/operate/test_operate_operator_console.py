"""The operator's console in the process of the test: what it says and asks while a vehicle flies."""

import io
import os
import signal
import threading
from types import SimpleNamespace

import numpy as np
import pytest
from stand_in import scenario

from mission.ground.command import MotorsStandError
from mission.ground.modes import Maneuver
from mission.ground.texts import TextLog
from mission.ground.vehicle_state import VehicleState
from mission.outcome import Outcome, Phase
from mission.policies.decision import Decision
from mission.policies.observation import Event
from mission.policies.policy import Triggers
from wbf_mission.addons.operate import command as operate_command
from wbf_mission.addons.operate import console as operator_console
from wbf_mission.addons.operate.console import TerminalConsole
from wbf_mission.addons.operate.link import LiveLink
from wbf_mission.cli import signals
from wbf_mission.cli.app import main
from wbf_mission.cli.output import Output
from wbf_mission.events import Asked, Orderable, VehicleMoved
from wbf_mission.flight import fly
from wbf_mission.run.orders import Orders
from wbf_mission.scenario import scenario_with


@pytest.fixture
def typed(monkeypatch):
    """Type at a terminal."""
    ours, theirs = os.openpty()
    with os.fdopen(theirs, "r") as stdin:
        monkeypatch.setattr(operator_console.sys, "stdin", stdin)
        yield lambda text: os.write(ours, text.encode())
    os.close(ours)
    signals.defer(False)


def answered(output, typed, text):
    """Type an answer when the question of the start is there."""
    output.events.listen(lambda event: event.question.endswith("start the motors?") and typed(text), Asked)
    return output


def test_ctrl_c_asks_and_the_vehicle_returns(quick_stand_in, typed, capsys):
    output, done_s = Output(), []

    def interrupt_and_answer(event):
        if not done_s and flies(event):
            done_s.append(event.time_s)
            signal.raise_signal(signal.SIGINT)
        elif len(done_s) == 1 and event.time_s > done_s[0] + 2.0:
            done_s.append(event.time_s)
            typed("r\n")

    answered(output, typed, "y\n").events.listen(interrupt_and_answer, VehicleMoved)
    signals.install()
    try:
        with quick_stand_in() as (url, made):
            link = LiveLink(url, TerminalConsole(output))
            result = fly(scenario(budget="150s"), by=link, events=output.events)
            assert not made.vehicle.pilot.armed
    finally:
        signals.restore()
    told = capsys.readouterr().err
    assert result.outcome is Outcome.INTERRUPTED
    assert "[h]old, [r]eturn" in told and "the vehicle returns (mode RTL)" in told, told


def test_after_a_refusal_to_arm_the_operator_is_asked_again(quick_stand_in, typed, capsys, monkeypatch):
    output, asked = Output(), []

    def answer(event):
        if event.question.endswith("start the motors?"):
            asked.append(event.question)
            monkeypatch.setattr(made.vehicle.pilot.arming, "why_not", lambda *_: next(reasons))
            typed("n\n" if len(asked) > 1 else "y\n")

    reasons = iter(["the pilot holds the stick", *[None] * 1000])
    output.events.listen(answer, Asked)
    with quick_stand_in() as (url, made):
        result = fly(scenario(), by=LiveLink(url, TerminalConsole(output)), events=output.events)
        assert not made.vehicle.pilot.armed
    assert (result.outcome, len(asked)) == (Outcome.NOT_STARTED, 2)
    assert capsys.readouterr().err.count("start the motors? [y/N]") == 2


def test_no_starts_nothing(quick_stand_in, typed, capsys):
    output = answered(Output(), typed, "no\n")
    with quick_stand_in() as (url, made):
        result = fly(scenario(), by=LiveLink(url, TerminalConsole(output)), events=output.events)
        assert not made.vehicle.pilot.armed
    assert result.outcome is not Outcome.COMPLETED and not len(result.observations)
    assert "start the motors? [y/N]" in capsys.readouterr().err


def test_what_was_typed_before_the_question_does_not_start_the_motors(quick_stand_in, typed, capsys):
    """Who typed y twice when asked for the battery has not read the question of the start."""
    output = Output()
    console = TerminalConsole(output)
    assert console.goes_on("sortie 2 of 3?") is None
    typed("y\ny\ny")
    assert console.goes_on("sortie 2 of 3?") is True
    answered(output, typed, "\n")
    with quick_stand_in() as (url, made):
        result = fly(scenario(), by=LiveLink(url, console), events=output.events)
        assert not made.vehicle.pilot.armed
    assert result.outcome is Outcome.NOT_STARTED
    assert "start the motors? [y/N]" in capsys.readouterr().err


@pytest.mark.parametrize(("answer", "given"), [("\n", [(False, None)]), ("y\n", [(False, None), (True, 7)])])
def test_a_command_starts_the_motors_of_the_named_vehicle_after_an_answer_to_its_question(
    typed, monkeypatch, answer, given
):
    """What was typed before does not count, and another vehicle may be heard first the second time."""
    asked, orders = [], []

    def give(wanted, _url, system_id, _wait):
        orders.append((wanted.arms, system_id))
        error = None if wanted.arms else MotorsStandError("the motors stand still")
        return SimpleNamespace(vehicle=(system_id or 7, 1), error=error, texts=[], mode="MISSION")

    def note(_output, text, **_options):
        asked.append(text)
        typed(answer)

    monkeypatch.setattr(operate_command, "_give", give)
    monkeypatch.setattr(Output, "note", note)
    typed("y\n")
    assert main(["command", "tcp:127.0.0.1:1", "mission"]) == (0 if len(given) > 1 else 2)
    assert orders == given
    assert asked[0].startswith("system 7: ") and asked[0].endswith("start the motors? [y/N]")


@pytest.mark.parametrize(
    ("text", "goes_on"), [("\n", True), ("y\n", True), ("q\n", False), ("Quit\n", False)]
)
def test_between_sorties_one_question_and_its_answer(typed, capsys, text, goes_on):
    console = TerminalConsole(Output())
    assert console.goes_on("sortie 2 of 3?") is None
    typed(text)
    assert console.goes_on("sortie 2 of 3?") is goes_on
    assert capsys.readouterr().err.count("sortie 2 of 3?") == 1


@pytest.mark.parametrize(
    ("beat_s", "now_s", "told"),
    [
        (2.9, 2.9, "AUTO, item 2 of 4, 30.0 m up, 5.0 m/s"),
        (120.0, 120.0, "AUTO, item 2 of 4, 30.0 m up, height 120 s old, speed -"),
        (1.0, 120.0, "nothing heard for 119 s; the last was: AUTO, item 2 of 4, 30.0 m up, 5.0 m/s"),
    ],
)
def test_an_old_position_is_told_as_old_although_the_vehicle_is_heard(beat_s, now_s, told):
    """PX4 sends no position when it has lost its own; its heartbeats go on."""
    ground = SimpleNamespace(
        vehicle_state=VehicleState(heard_s=0.0, height_m=30.0, velocity_m_s=(3.0, 4.0, 0.0), item=1),
        mission=SimpleNamespace(items=range(4)),
        pilot=SimpleNamespace(mode="AUTO"),
        link=SimpleNamespace(heard_s=beat_s, brief=lambda: "link 90%"),
    )
    sortie = SimpleNamespace(ground=ground, assembler=SimpleNamespace(statistics=SimpleNamespace(images=3)))
    line = operator_console.status_line(sortie, now_s)
    assert line == f"{told}, battery -, 3 images, link 90%"


def heard_vehicle(heard_s, *, phase=Phase.FLIGHT, taken_out=False):
    """A vehicle on the console that was last heard at a time."""
    ground = SimpleNamespace(
        phase=phase,
        vehicle_state=VehicleState(heard_s=heard_s, item=1),
        mission=SimpleNamespace(items=range(4)),
        pilot=SimpleNamespace(mode="AUTO", ordered=None, obeyed="", taken_out=taken_out),
        link=SimpleNamespace(heard_s=heard_s),
    )
    return operator_console._Vehicle(SimpleNamespace(ground=ground, done=False), Output(), alone=True)


@pytest.mark.parametrize(
    ("heard_s", "told"), [(9.0, "the vehicle flies on: "), (2.0, "the vehicle may fly on: ")]
)
def test_a_silent_vehicle_is_not_said_to_fly_on(heard_s, told, capsys):
    """Its answer to an order may be lost, although it obeys."""
    vehicle = heard_vehicle(heard_s)
    vehicle._ordered, vehicle._ordered_s = Maneuver.HOLD, 3.0
    vehicle._report_silence(10.0)
    vehicle._report_obedience(10.0)
    assert told in capsys.readouterr().err


@pytest.mark.parametrize(
    ("given", "continues"),
    [({}, True), ({"phase": Phase.READY}, False), ({"taken_out": True}, False)],
    ids=["in its mission", "on the ground", "taken out"],
)
def test_only_a_silent_vehicle_in_its_mission_is_said_to_continue_it(given, continues, capsys):
    heard_vehicle(2.0, **given)._report_silence(10.0)
    told = capsys.readouterr().err
    assert "nothing is heard of the vehicle" in told and ("continues" in told) is continues


def test_texts_that_a_vehicle_repeats_are_shown_once_with_their_number(capsys):
    vehicle = heard_vehicle(10.0)
    ground = vehicle.sortie.ground
    ground.arming_gate, ground.parameters_set, ground.pilot.events = None, [], []
    ground.pilot.somebody_else_flies = False
    ground.text_log = TextLog()
    for text in ("Mission: 6 WP", "restarted command") * 3 + ("Land",):
        ground.text_log.note(text, 9.0)
    vehicle._status_s = 9.0
    vehicle.report(10.0)
    vehicle.report(10.5)
    assert capsys.readouterr().err.splitlines() == [
        "flying",
        "vehicle: Mission: 6 WP (3 times)",
        "vehicle: restarted command (3 times)",
        "vehicle: Land",
    ]


class Page:
    """Who watches a flight: orders one thing after the other, each when what it waits for has happened."""

    def __init__(self, *steps):
        self.output = Output()
        self.orders = Orders(self.output.events)
        self.asked, self._steps, self._may = [], list(steps), ()
        for kind in (Orderable, VehicleMoved, Asked):
            self.output.events.listen(self._look, kind)

    def _look(self, event):
        if isinstance(event, Asked):
            self.asked.append(event)
        if isinstance(event, Orderable):
            self._may = event.orders
        # A page's buttons are off until an order can be given.
        if self._steps and self._steps[0][0](event) and self._steps[0][1] in self._may:
            _, *given = self._steps.pop(0)
            assert self.orders.take([1], *given) == ""

    def fly(self, url, policy=None, **options):
        link = LiveLink(url, TerminalConsole(self.output, self.orders), orders=self.orders)
        chosen = scenario_with(scenario(**options), {"policy": policy})
        return fly(chosen, by=link, events=self.output.events)


def may(order):
    return lambda event: isinstance(event, Orderable) and order in event.orders


def shows(*modes):
    """It has shown one of these modes for some seconds."""
    times = []

    def shown(event):
        if isinstance(event, VehicleMoved) and event.mode in modes:
            times.append(event.time_s)
        return bool(times) and times[-1] > times[0] + 4.0

    return shown


def flies(event):
    return isinstance(event, VehicleMoved) and event.armed and event.height_m > 5.0 and bool(event.item)


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_page_starts_holds_and_lets_go_on(quick_stand_in, autopilot, monkeypatch, capsys):
    """Nobody is at the terminal: its input is at its end."""
    monkeypatch.setattr(operator_console.sys, "stdin", io.StringIO())
    page = Page((may("start"), "start", "", True), (flies, "hold"), (shows("LOITER", "BRAKE"), "resume"))
    with quick_stand_in(autopilot) as (url, _):
        result = page.fly(url, autopilot=autopilot)
    told = capsys.readouterr().err
    assert result.outcome is Outcome.COMPLETED, told
    assert page.asked[0].question.startswith("ready: ") and page.asked[0].answers == ("do not start",)
    assert page.asked[-1].question == ""
    hold = {"px4": "LOITER", "ardupilot": "BRAKE"}[autopilot]
    order = [
        "start the motors? [y/N]",
        "ordered by the page: start",
        "ordered by the page: hold",
        f"the vehicle holds (mode {hold})",
        "ordered by the page: resume",
        "the vehicle continues its mission",
    ]
    places = [told.find(text) for text in order]
    assert -1 not in places and places == sorted(places), told
    assert not [one for one in result.warnings if "by hand" in one], "no seed gives a real flight again"


def test_a_page_does_not_start_what_it_was_asked_about(quick_stand_in, typed, capsys):
    page = Page()
    refused = []

    def look(event):
        if event.answers:
            refused.append(page.orders.take([1], "start"))
            refused.append(page.orders.answer("y", event.number))
            assert page.orders.answer("do not start", event.number) == ""

    page.output.events.listen(look, Asked)
    with quick_stand_in() as (url, made):
        result = page.fly(url)
        assert not made.vehicle.pilot.armed
    assert result.outcome is Outcome.NOT_STARTED
    assert refused[1] == "'y' is not a valid answer: give do not start"
    assert "answered by the page: do not start" in capsys.readouterr().err


def test_a_page_says_that_the_battery_is_changed(typed):
    page = Page()
    console = TerminalConsole(page.output, page.orders)
    assert console.goes_on("sortie 2 of 3?") is None
    assert page.asked == [Asked("sortie 2 of 3?", ("battery changed", "no more"))]
    assert page.orders.answer("battery changed", page.asked[-1].number) == ""
    assert console.goes_on("sortie 2 of 3?") is True
    assert console.goes_on("sortie 3 of 3?") is None
    page.orders.answer("no more", page.asked[-1].number)
    assert console.goes_on("sortie 3 of 3?") is False


class Thoughtful:
    """A policy that turns over its first answer in flight until `go_on`, and never changes its mind after."""

    def __init__(self):
        self.triggers = Triggers(period_s=1.0)
        self.go_on = threading.Event()

    def start(self):
        self.asked, self.came, self.kept = 0, False, False

    def decide(self, observation):
        left, low, right, high = observation.vehicles[0].request.area.bounds
        x, y = np.linspace(left, right, 7)[1:-1], np.linspace(low, high, 7)[1:-1]
        path = [(x[0], y[0]), (x[0], y[-1]), (x[2], y[-1]), (x[2], y[0]), (x[-1], y[0]), (x[-1], y[-1])]
        if observation.event is Event.START:
            return Decision({1: path})
        self.asked += 1
        if self.asked > 1:
            return Decision({})
        before = observation.model.value.copy()
        self.came = self.go_on.wait(30.0)  # A limit against hanging, not a measure
        self.kept = np.array_equal(before, observation.model.value)
        return Decision({1: path[::-1]})


def test_orders_are_obeyed_while_a_policy_decides_and_its_answer_is_dropped(
    quick_stand_in, monkeypatch, capsys
):
    monkeypatch.setattr(operator_console.sys, "stdin", io.StringIO())
    policy = Thoughtful()
    held = shows("LOITER")

    def let_go_on(event):
        if held(event):
            policy.go_on.set()
        return policy.go_on.is_set() and may("resume")(Orderable(("resume",)))

    page = Page(
        (may("start"), "start", "", True),
        (lambda event: policy.asked > 0 and flies(event), "hold"),
        (let_go_on, "resume"),
    )
    with quick_stand_in("px4") as (url, _):
        result = page.fly(url, policy=policy, autopilot="px4")
    told = capsys.readouterr().err
    assert policy.came, "the vehicle was heard, and held, before the policy had decided"
    assert policy.kept, "what it was told stays as it was"
    assert result.outcome is Outcome.COMPLETED, told
    assert "the vehicle holds (mode LOITER)" in told and "too late" not in told
    (first, *_) = [one for one in result.decisions if one.event != "start"]
    outcomes = [change.outcome for change in first.changes]
    assert outcomes == ["not sent: the vehicle was given an order while the policy decided"]
