"""Flights of a vehicle behind a link: our simulator as the stand-in for the real thing, over real sockets."""

import contextlib
import io
import json
import os
import pty
import re
import select
import signal
import subprocess
import sys
from collections import Counter

import pytest
from processes import environment
from stand_in import LONG_S, Watcher, scenario, stand_in
from sweeps import slow

from geo.errors import WbfMissionError
from geo.farms import get_farm
from mission.ground.modes import Maneuver, VehicleModes
from mission.link import MavlinkEndpoint, open_link
from mission.link.codec.dialect import mavlink as m
from mission.model import GeoPoint
from mission.outcome import Outcome, Phase, in_words
from sim_vehicle.autopilot.behaviour import Mode
from wbf_mission.addons.base.links import LiveFlightError
from wbf_mission.addons.operate.link import LiveLink
from wbf_mission.cli import signals
from wbf_mission.cli.app import main
from wbf_mission.exit_codes import ExitCode, exit_code_of_flight
from wbf_mission.flight import fly
from wbf_mission.run import joint_flight

AUTOPILOTS = {"px4": m.MAV_AUTOPILOT_PX4, "ardupilot": m.MAV_AUTOPILOT_ARDUPILOTMEGA}


def order(url, vehicle, command, *params):
    """Send a command from a second ground station, as a pilot's stick or another operator would."""
    endpoint = MavlinkEndpoint(open_link(url), 254, 190)
    endpoint.send(m.MAVLink_command_long_message(vehicle, 1, command, 0, *params, *[0.0] * (7 - len(params))))
    return endpoint


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_the_whole_job_with_a_vehicle_behind_a_link(quick_stand_in, autopilot, tmp_path):
    watcher = Watcher()
    with quick_stand_in(autopilot) as (url, made):
        tlog = tmp_path / "run.tlog"
        result = fly(scenario(), by=LiveLink(url, watcher, tlog=tlog))
    assert result.outcome is Outcome.COMPLETED
    assert result.scenario.vehicle.autopilot == autopilot
    assert watcher.phases == [*sorted(watcher.phases, key=list(Phase).index)]
    assert Phase.READY in watcher.phases
    assert result.flights[0].transfers[-1].verified
    assert 0.5 < result.flights[0].flight_time_s / result.plan.prediction.duration_s < 2.0
    assert len(result.observations) > 20
    truth = result.truth[:, result.observations.x, result.observations.y]
    assert (result.observations.values == truth.T).all()
    assert result.final_score is not None
    assert tlog.stat().st_size > 10_000
    assert not made.vehicle.pilot.armed


def standing(east_m):
    """A stand-in's home so far east of the farm's, and where the flight is planned from."""
    farm = get_farm("miniberry-10")
    x, y = farm.home_m
    latitude, longitude = farm.frame.to_wgs84(x + east_m, y)
    return ((GeoPoint(float(latitude), float(longitude), farm.frame.altitude_m), 0.0),)


@pytest.mark.parametrize(
    ("more", "spent"),
    [
        ({"budget": "150s"}, lambda flight: flight.flight_time_s / 150.0),
        slow({"budget": "500m"}, lambda flight: flight.track.length_m / 500.0),
        ({"budget": "150s", "policy": "greedy"}, lambda flight: flight.flight_time_s / 150.0),
    ],
)
def test_the_way_from_where_the_vehicle_stands_is_in_the_budget(quick_stand_in, more, spent):
    with quick_stand_in(homes=standing(221.0), speed=12.0) as (url, made):
        result = fly(scenario(**more), by=LiveLink(url, Watcher(images=10**9)))
        assert max(map(abs, made.vehicle.true_position_m[:2])) < 3.0, "it is back where it started"
    (flight,) = result.flights
    assert flight.outcome is Outcome.COMPLETED
    assert flight.track.length_m > 2 * 215.0, "it was there"
    assert len(result.observations) > 5
    # Gusts, errors and a link at twelve times real time cost a little; without the ways it was a fifth more.
    assert 0.6 < spent(flight) < 1.06, spent(flight)


def test_a_vehicle_that_stands_a_few_metres_away_flies_the_plan_of_the_farm(quick_stand_in):
    paths = []
    for east_m in (0.0, 3.0):
        with quick_stand_in(homes=standing(east_m)) as (url, _):
            link = LiveLink(url, Watcher(agrees=False))
            paths.append(fly(scenario(), by=link).plan.path_m.tolist())
    assert paths[0] == paths[1]


def test_a_budget_that_does_not_reach_the_farm_from_there_is_refused():
    with stand_in(homes=standing(290.0)) as (url, made):
        with pytest.raises(WbfMissionError, match="budget"):
            fly(scenario(budget="30s"), by=LiveLink(url, Watcher()))
        assert not made.vehicle.pilot.armed


def test_a_camera_on_board_is_used_and_ours_stays_silent(quick_stand_in):
    with quick_stand_in(camera=True) as (url, made):
        result = fly(scenario(), by=LiveLink(url, Watcher()))
        assert result.outcome is Outcome.COMPLETED
        assert result.flights[0].camera.images == made.images > 30


def test_a_policy_changes_the_mission_of_the_vehicle_behind_the_link(quick_stand_in):
    with quick_stand_in() as (url, _):
        result = fly(scenario(policy="greedy"), by=LiveLink(url, Watcher()))
    assert result.outcome is Outcome.COMPLETED
    changes = [one for record in result.decisions for one in record.changes if one.outcome == "flown"]
    assert changes


def test_the_operator_ends_the_mission(quick_stand_in):
    watcher = Watcher(act=lambda flight: flight.maneuver(Maneuver.LAND))
    # Far enough that it is not on its way home when the order arrives.
    with quick_stand_in() as (url, _):
        result = fly(scenario(budget="150s"), by=LiveLink(url, watcher))
    assert watcher.acted
    assert result.outcome is Outcome.INTERRUPTED
    assert result.reason == "the operator ordered the vehicle to land"
    assert 0 < len(result.observations) < 90


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_a_pilot_who_takes_over_is_noticed_and_not_fought(quick_stand_in, autopilot):
    land = VehicleModes(AUTOPILOTS[autopilot], m.MAV_TYPE_QUADROTOR).numbers("LAND")
    endpoints = []

    def take_over(_flight):
        endpoints.append(order(url, 1, m.MAV_CMD_DO_SET_MODE, *land))

    watcher = Watcher(act=take_over)
    with quick_stand_in(autopilot) as (url, made):
        result = fly(scenario(policy="greedy", budget="150s"), by=LiveLink(url, watcher))
        heard = [one for endpoint in endpoints for one in endpoint.receive()]
        assert not made.vehicle.pilot.armed
    assert any(one.get_type() == "COMMAND_ACK" for one in heard)
    assert result.outcome is Outcome.PILOT_TOOK_OVER
    assert "LAND" in result.reason


def test_a_vehicle_of_another_kind_is_refused():
    with (
        stand_in(vehicle="rover") as (url, _),
        pytest.raises(LiveFlightError, match="quad is a multirotor, but a rover is heard"),
    ):
        fly(scenario(vehicle="quad"), by=LiveLink(url, Watcher()))


@pytest.mark.parametrize(
    ("more", "text"),
    [({"days": 2}, "one flight"), ({"vehicle": "ideal", "budget": "100 steps"}, "not a real vehicle")],
)
def test_what_one_vehicle_cannot_do_is_refused_before_the_link_is_opened(more, text):
    with pytest.raises(LiveFlightError, match=text):
        fly(scenario(**more), by=LiveLink("tcp:127.0.0.1:1", Watcher()))


def talk(url, answers, cwd, term="dumb", more=()):
    """Run the command at a terminal; give each answer once its question was asked (again)."""
    terminal, end = pty.openpty()
    arguments = ["fly", "--farm", "miniberry-10", "--planner", "lawnmower", "--budget", "60s"]
    arguments += ["--estimator", "point", "--connect", url, "--no-plots", "--out", "run", "--json", *more]
    process = subprocess.Popen(
        [sys.executable, "-m", "wbf_mission", *arguments],
        cwd=cwd,
        stdin=end,
        stdout=subprocess.PIPE,
        stderr=end,
        text=True,
        start_new_session=True,
        env=environment(TERM=term),
    )
    os.close(end)
    shown, asked = b"", Counter()
    for question, answer in answers:
        asked[question] += 1
        while shown.count(question) < asked[question]:
            assert select.select([terminal], [], [], LONG_S)[0], shown
            shown += os.read(terminal, 65536)
        answer(process) if callable(answer) else os.write(terminal, answer)
    with contextlib.suppress(OSError):
        while piece := os.read(terminal, 65536):
            shown += piece
    out, _ = process.communicate(timeout=LONG_S)
    os.close(terminal)
    return process.returncode, json.loads(out) if out else None, shown.decode()


def interrupt(process):
    os.killpg(process.pid, 2)


def test_ctrl_c_at_the_start_question_ends_in_one_line(tmp_path):
    with stand_in() as (url, made):
        code, summary, shown = talk(url, [(b"start the motors? [y/N]", interrupt)], tmp_path)
        assert not made.vehicle.pilot.armed
        assert made.vehicle.pilot.mission.items
    assert (code, summary) == (130, None)
    after = shown.split("start the motors? [y/N]")[1].split("\n")
    told = [one.strip() for one in after if one.strip() and "^C" not in one]
    assert told == ["error: interrupted: nothing was started; the uploaded plans stay in the vehicle"]
    assert not (tmp_path / "run" / "summary.json").exists()


class Answering(io.StringIO):
    """What a command writes for its operator, who answers each question when it is there."""

    def __init__(self, answers):
        super().__init__()
        self.answers, self.seen = list(answers), 0

    def write(self, text):
        super().write(text)
        if self.answers and (found := self.getvalue().find(self.answers[0][0], self.seen)) >= 0:
            question, answer = self.answers.pop(0)
            self.seen = found + len(question)
            answer()
        return len(text)


def test_at_the_terminal_all_are_asked_for_and_one_comes_back(quick_stand_in, tmp_path, monkeypatch, capsys):
    ours, theirs = os.openpty()

    def types(text):
        return lambda: os.write(ours, text)

    shown = Answering(
        (
            ("start the motors of vehicles 1, 2? [y/N]", types(b"y\n")),
            ("vehicle 2: MISSION, item", lambda: signal.raise_signal(signal.SIGINT)),
            ("such as r2?", types(b"r9\n")),
            ("such as r2?", types(b"r2\n")),
        )
    )
    given = [
        *("--farm", "miniberry-10", "--planner", "lawnmower", "--budget", "150s", "--estimator", "point")
    ]
    given += ["--no-plots", "--json", "--out", str(tmp_path / "run")]
    signals.install()
    with (
        quick_stand_in() as (one, _),
        quick_stand_in(first_system=2) as (two, made),
        os.fdopen(theirs, "r") as stdin,
    ):
        monkeypatch.setattr(sys, "stdin", stdin)
        monkeypatch.setattr(sys, "stderr", shown)
        try:
            code = main(["fly", *given, "--connect", one, "--connect", two])
        finally:
            signals.restore()
            os.close(ours)
        assert not made.vehicle.pilot.armed
    summary, shown = json.loads(capsys.readouterr().out), shown.getvalue()
    flights = {one["vehicle"]: one for one in summary["flights"]}
    assert flights[1]["outcome"] == "completed"
    assert (flights[2]["outcome"], flights[2]["reason"]) == (
        "interrupted",
        "the operator ordered the vehicle to return",
    )
    assert (code, summary["outcome"]) == (130, "interrupted")
    assert "vehicle 2 returns (mode RTL)" in shown
    assert "vehicle 1: ready: " in shown
    # Both were set down at home.
    assert re.search(r"vehicle 2: it stands 0\.\d m from vehicle 1; its plan starts at \d+\.\d+, -\d+", shown)


START = (b"start the motors? [y/N]", b"y\n")
FLIES, ASKED = b"MISSION, item", b"[h]old, [r]eturn"


@pytest.mark.slow
@pytest.mark.parametrize("again", [b"l\n", interrupt], ids=["leave", "ctrl-c"])
def test_ctrl_c_leaves_the_vehicle_flying(again, tmp_path):
    # It has to be in the air still when the results are written.
    with stand_in(speed=1.0) as (url, made):
        code, summary, _ = talk(url, [START, (FLIES, interrupt), (ASKED, again)], tmp_path)
        assert made.vehicle.pilot.armed, "it flies its mission on"
    assert (code, summary["outcome"]) == (130, "interrupted")
    assert re.fullmatch(
        r"left as it flew after \d+ s: MISSION, item \d+ of \d+, -?[\d.]+ m up", summary["reason"]
    )
    assert (tmp_path / "run" / "summary.json").is_file(), "what was seen is saved"


@pytest.mark.slow
def test_a_vehicle_that_is_never_heard_again_is_not_waited_for_for_ever(monkeypatch):
    monkeypatch.setattr(joint_flight, "SILENT_FOR_GOOD_S", 4.0)
    monkeypatch.setattr(joint_flight, "SILENT_FACTOR", 0.1)
    faults = ["link-loss,at=airborne,from=25"]
    with stand_in(system_faults=faults) as (url, made):
        result = fly(scenario(), by=LiveLink(url, Watcher(agrees=True)))
        assert made.vehicle.pilot.armed or made.vehicle.outcome is Outcome.COMPLETED
    assert result.outcome is Outcome.NO_ANSWER
    assert result.reason.startswith("nothing was heard of the vehicle for")
    assert len(result.observations) > 5
    assert exit_code_of_flight(result.outcome) is ExitCode.LINK_LOST


@pytest.mark.slow
def test_ctrl_c_and_then_go_on(tmp_path):
    with stand_in(speed=4.0) as (url, _):
        # What is no answer is asked again.
        answers = [START, (FLIES, interrupt), (ASKED, b"banana\n"), (ASKED, b"c\n")]
        code, summary, _ = talk(url, answers, tmp_path)
    assert (code, summary["outcome"]) == (0, "completed")


@pytest.mark.slow
def test_ctrl_c_and_the_vehicle_holds_until_it_is_left(tmp_path):
    answers = [START, (FLIES, interrupt), (ASKED, b"h\n"), (b"LOITER, item", interrupt), (ASKED, b"l\n")]
    with stand_in(speed=1.5) as (url, made):
        code, summary, shown = talk(url, answers, tmp_path)
        assert made.vehicle.pilot.armed
        assert made.vehicle.pilot.mode is Mode.HOLD
    assert (code, summary["outcome"]) == (130, "interrupted")
    assert in_words(Outcome.PILOT_TOOK_OVER) not in shown


def test_without_a_terminal_the_start_has_to_be_agreed_to_beforehand(monkeypatch, capsys):
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    assert main(["fly", "--connect", "tcp:127.0.0.1:1", "--no-files"]) == 2
    assert "give --yes" in capsys.readouterr().err
