"""``wbf-mission monitor`` and ``wbf-mission command``, against our simulator over real sockets."""

import json
import math
import signal
from subprocess import PIPE

import processes
import pytest
from lockstep import sharing
from stand_in import stand_in

from mission.ground.command import OperatorCommand, OrderError
from mission.ground.link import upload
from mission.link.codec.dialect import mavlink as m
from mission.outcome import Outcome
from sim_vehicle.host.server import Server
from tests.support.peer import running
from wbf_mission.cli.app import main
from wbf_mission.run.plan import plan
from wbf_mission.scenario import Scenario

FAST = 8.0


def command(capsys, url, *words, code=0):
    assert main(["command", url, *words, "--json", "-q"]) == code
    out, err = capsys.readouterr()
    return json.loads(out) if code == 0 else err.strip()


def watched(capsys, url, *options, until):
    """What monitor prints, watched for longer until it shows what is waited for."""
    for seconds in (1, 3, 10, 60):
        assert main(["monitor", url, "--duration", str(seconds), *options]) in (0, 3)
        lines = capsys.readouterr().out.splitlines()
        if lines and until(lines):
            return lines
    pytest.fail(f"not shown: {lines}")


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_orders_are_confirmed_by_what_the_vehicle_shows(quick_stand_in, autopilot, capsys):
    rows = Scenario(farm="miniberry-10", planner="lawnmower", budget="60s", autopilot=autopilot)
    guided = {"px4": "HOLD", "ardupilot": "GUIDED"}[autopilot]
    shown = {"px4": ("LOITER", "MISSION", "LOITER"), "ardupilot": ("GUIDED", "AUTO", "BRAKE")}[autopilot]
    mission = plan(rows).mission
    count = len(mission.items)
    # A vehicle that is armed and does not take off disarms after ten seconds of its own.
    with quick_stand_in(autopilot, speed=2.0, camera=True) as (url, made):
        assert (
            command(capsys, url, "takeoff", "8", code=5)
            == "error: system 1: takeoff 8: the motors stand still; arm first (order arm)"
        )
        text = command(capsys, url, "set-item", "3", code=5)
        assert text == "error: system 1: set-item 3: it holds no mission; upload a mission"
        upload(mission, url)
        assert command(capsys, url, "mode", guided)["mode"] == shown[0]
        assert not made.vehicle.pilot.armed
        command(capsys, url, "arm")
        assert made.vehicle.pilot.armed
        command(capsys, url, "takeoff", "8")
        text = command(capsys, url, "takeoff", "20", code=5)
        assert text.startswith("error: system 1: takeoff 20: it flies already, ")
        assert made.vehicle.pilot.state.position_m[2] < 9.0, "it was not sent higher"
        assert command(capsys, url, "mission")["mode"] == shown[1]
        command(capsys, url, "set-item", "3")
        text = command(capsys, url, "set-item", "300", code=5)
        assert text == f"error: system 1: set-item 300: its mission has {count} items; give 1 to {count}"
        text = command(capsys, url, "disarm", code=5)
        said = "Disarming denied: not landed" if autopilot == "px4" else "failed; it gives no reason"
        assert text == f"error: system 1 refused disarm: {said}"
        assert command(capsys, url, "hold")["mode"] == shown[2]
        assert command(capsys, url, "resume")["mode"] == shown[1]
        assert command(capsys, url, "return")["mode"] == "RTL"
        assert command(capsys, url, "land")["mode"] == "LAND"


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("jump",), "unknown order 'jump': choose arm, disarm"),
        (("takeoff", "nan"), "takeoff nan: give a height above home of 1 to 1000 metres"),
        (("takeoff", "100000"), "takeoff 100000: give a height above home"),
        (("set-item", "0"), "set-item 0: give the number of an item, counted from 1"),
        (("arm", "now"), "arm now: arm takes nothing more; leave 'now' out"),
    ],
)
def test_orders_that_are_none_open_no_link(capsys, words, text):
    assert text in command(capsys, "tcp:127.0.0.1:1", *words, code=2)
    with pytest.raises(OrderError):
        OperatorCommand(*words)


def test_a_mode_that_the_vehicle_does_not_have(quick_stand_in, capsys):
    with quick_stand_in() as (url, _):
        text = command(capsys, url, "mode", "HOVER", code=2)
        assert text.startswith("error: this vehicle: unknown mode 'HOVER': choose ACRO, ")


@pytest.mark.parametrize(("autopilot", "seq"), [("px4", 2), ("ardupilot", 3)])
def test_monitor_counts_items_from_1_and_tells_the_number_of_the_protocol(
    quick_stand_in, autopilot, seq, capsys
):
    rows = Scenario(farm="miniberry-10", planner="lawnmower", budget="60s", autopilot=autopilot)
    mission = plan(rows).mission
    with quick_stand_in(autopilot, speed=FAST) as (url, _):
        upload(mission, url)
        command(capsys, url, "set-item", "3")
        told = (3, seq, len(mission.items))

        def is_told(lines):
            last = json.loads(lines[-1])
            return tuple(last.get(name) for name in ("item", "seq", "items")) == told

        watched(capsys, url, "--json", "--interval", "0.5", until=is_told)
        watched(capsys, url, until=lambda lines: f" 3 of {len(mission.items)} " in lines[-1])


def test_monitor_shows_one_header_and_a_line_for_each_vehicle(quick_stand_in, capsys):
    with quick_stand_in(speed=FAST, count=2) as (url, _):
        header, *lines = watched(
            capsys,
            url,
            "--interval",
            "0.5",
            until=lambda lines: len(lines) > 6 and " ms" in lines[-1] and " 2 " in lines[-1],
        )
    assert header.split() == [
        *("time", "vehicle", "autopilot", "mode", "armed", "item", "height", "speed", "battery", "GPS"),
        "link",
    ]
    assert len(lines) >= 6
    for line in lines:
        assert line[header.index("autopilot") :].startswith("PX4 ")
        assert line[header.index("mode") :].startswith("LOITER ")
        assert line[header.index("item") :].startswith("- "), "there is no item 1 of 0"
        assert line[header.index("link") :].startswith("100%")
        assert line.split()[2] in ("1", "2")
    assert " ms" in lines[-1]


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 0), (signal.SIGTERM, 143)], ids=str)
def test_ctrl_c_is_how_monitor_is_ended(number, code, tmp_path):
    """At any moment, also while a line is printed; what was printed is whole."""
    with stand_in(speed=FAST) as (url, _):
        words = processes.command("monitor", url, "--json", "--interval", "0.05")
        with processes.running(words, tmp_path, stdout=PIPE, stderr=PIPE) as process:
            first = process.stdout.readline()
            process.send_signal(number)
            out, err = process.communicate(timeout=processes.LONG_S)
    assert process.returncode == code
    assert err == f"listening on {url}; Ctrl-C ends it\n"
    assert all(json.loads(line)["system_id"] == 1 for line in (first, *out.splitlines()))


def test_monitor_hears_nobody(capsys):
    assert main(["monitor", "udpin:127.0.0.1:0", "--duration", "0.3"]) == 3
    assert capsys.readouterr().out == ""


def test_an_empty_mission_is_not_started(quick_stand_in, capsys):
    with quick_stand_in() as (url, made):
        assert "the motors stand still" in command(capsys, url, "mission", code=2)
        text = command(capsys, url, "mission", "--arm", code=5)
        assert "refused mission" in text
        assert made.vehicle.outcome is Outcome.RUNNING


class Liar:
    """A vehicle that tells what cannot be, and says the same thing again and again."""

    system_id, component_id, wanted = 1, 1, frozenset()

    def __init__(self):
        self.due_s, self.beats = 0.0, 0

    def receive(self, message, now_s):
        return []

    def poll(self, now_s):
        self.due_s, self.beats = now_s + 0.1, self.beats + 1
        return [
            m.MAVLink_heartbeat_message(2, 12, 81, 50593792, 3, 3),
            m.MAVLink_global_position_int_message(
                100 * self.beats, 951234567, -1900000000, 0, 5000, 0, 0, 0, 0
            ),
            m.MAVLink_sys_status_message(0, 0, 0, 0, 0, 0, 120, 0, 0, 0, 0, 0, 0),
            m.MAVLink_attitude_message(0, math.nan, 0.0, math.inf, 0.0, 0.0, 0.0),
            m.MAVLink_statustext_message(4, b"compass bad"),
        ]

    def next_deadline(self):
        return self.due_s


def said(lines):
    """How often texts came."""
    return sum(json.loads(line).get("times", 0) for line in lines)


def test_monitor_marks_what_cannot_be_and_folds_texts(clock, capsys):
    with running(sharing(Server, clock)([Liar()], ["tcpin:127.0.0.1:0"])) as server:
        url = server.urls[0].replace("tcpin", "tcp")
        lines = watched(capsys, url, "--json", "--interval", "0.3", until=lambda lines: said(lines) > 5)
        lines = [json.loads(line) for line in lines]
        assert main(["monitor", url, "--duration", "2", "--interval", "0.5"]) == 0
        out, err = capsys.readouterr()
    states = [line for line in lines if "impossible" in line]
    assert states[-1]["impossible"] == {
        "latitude_deg": pytest.approx(95.1234567),
        "longitude_deg": pytest.approx(-190.0),
        "battery": 1.2,
        "ATTITUDE.roll": "nan",
        "ATTITUDE.yaw": "inf",
    }
    texts = [line for line in lines if "text" in line]
    assert len(texts) <= 2, "the first one, and at the end how often it came"
    assert "120%!" in out
    assert "5.0 m!" not in out
    told = [line for line in err.splitlines() if "impossible values" in line]
    assert len(told) == 1, "once"
    assert "latitude_deg 95.12" in told[0]
    assert "ATTITUDE.roll nan" in told[0]
    assert err.count("compass bad") <= 2
    assert " times)" in err
