"""The simulator in a process of its own as the stand-in for a real vehicle, and what goes wrong in flight.

Real sockets and serial lines, real time times five, both autopilots; each ground program is a process, too.
"""

import contextlib
import json
from types import SimpleNamespace

import pytest
from processes import flown, flying, run_forked, simulator
from shaped_line import ShapedLine
from sweeps import slow

AUTOPILOTS = ("px4", "ardupilot")


def sim_faults(*faults):
    return [word for fault in faults for word in ("--fault", fault)]


def run(*words, cwd):
    """Run a command to its end; what it printed."""
    out, err = cwd / "run.out", cwd / "run.err"
    code = run_forked(words, cwd, out, err)
    done = SimpleNamespace(returncode=code, stdout=out.read_text(), stderr=err.read_text())
    assert "Traceback" not in done.stderr, done.stderr
    return done


def watched(url, cwd):
    """What monitor tells last, watched for longer until an answer has come over the line."""
    for seconds in (4, 20, 60):
        told = run("monitor", url, "--json", "--duration", seconds, "--interval", "1", cwd=cwd)
        lines = [json.loads(one) for one in told.stdout.splitlines() if "link_quality" in one]
        if lines and lines[-1]["round_trip_s"] is not None and (lines[-1]["link_quality"] or 1.0) < 1.0:
            return lines[-1]
    pytest.fail(told.stdout + told.stderr)


LINK_LOSS = "the link is dead for a while"
# Autopilot, fault, exit code and outcome, and what is told.
CASES = {
    LINK_LOSS: (
        "px4",
        "link-loss,at=airborne,from=10,for=32",
        (0, "completed"),
        "the vehicle is heard again",
    ),
    "it starts again": (
        "ardupilot",
        "reboot,at=airborne,from=15",
        (0, "completed"),
        "its autopilot has started again",
    ),
    "a low battery": (
        "px4",
        "low-battery=0.08,at=airborne,from=12",
        (1, "battery_low"),
        "battery low: battery",
    ),
    "it does not arm": ("px4", "refuse=400", (5, "arming_refused"), "arming refused: denied"),
    "it never answers": ("ardupilot", "drop=COMMAND_ACK,direction=down", (4, "no_answer"), "no answer while"),
    # A PX4 shows by its telemetry that it is armed and flies the mission, so no answer is needed.
    "it only shows": ("px4", "drop=COMMAND_ACK,direction=down", (0, "completed"), "Disarmed by landing"),
}


@pytest.mark.parametrize("case", [case if case == "it does not arm" else slow(case) for case in CASES])
def test_what_goes_wrong_in_flight(case, tmp_path):
    autopilot, fault, ended, words = CASES[case]
    with simulator(tmp_path, *sim_faults(fault), autopilot=autopilot) as (url,):
        ground = flown(tmp_path, url)
    assert ground.ended == ended, ground.told
    assert words in ground.told
    flight = ground.summary["flights"][0]
    assert flight["link"]["frames"] > 10
    if ended[0] in (0, 1):
        assert ground.summary["observations"] > 5, "what was seen is kept"
        assert (tmp_path / "run" / "result.json").is_file()
        saved = json.loads((tmp_path / "run" / "summary.json").read_text())
        assert saved["outcome"] == ended[1]
    if case == LINK_LOSS:
        assert flight["link"]["worst_silence_s"] > 2.0
        assert flight["missing_images"] > 0
        assert "images are missing for good; nothing was heard of the vehicle for" in ground.told
    if case == "it starts again":
        assert 30.0 < flight["flight_time_s"] < 120.0, "its clock goes on"
        assert flight["missing_images"] < 10


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_a_pilot_takes_over_from_another_process(autopilot, tmp_path):
    links = ("tcpin:127.0.0.1:0", "udpin:127.0.0.1:0")
    with (
        # Slowly enough that it is not on its way home when his process has started.
        simulator(tmp_path, autopilot=autopilot, listen=links, speed=2) as (mine, his),
        flying(tmp_path, mine, "--budget", "5min") as ground,
    ):
        ground.wait_for(", item")
        assert run("command", his, "land", cwd=tmp_path).returncode == 0
        ended = ground.end()
    assert ended.ended == (1, "pilot_took_over"), ended.told
    assert "taken out of its mission: mode LAND" in ended.told


@pytest.mark.slow
def test_an_autopilot_that_starts_again_on_the_ground(tmp_path):
    """The simulator is ended in mid-flight, and another one takes its place."""
    with contextlib.ExitStack() as stack:
        with simulator(tmp_path, autopilot="px4") as (url,):
            ground = stack.enter_context(flying(tmp_path, url, "--budget", "5min"))
            ground.wait_for(", item")
        ground.wait_for("nothing is heard of the vehicle")
        ground.wait_for("nothing heard for ")
        listen = (url.replace("tcp:", "tcpin:"),)
        stack.enter_context(simulator(tmp_path, autopilot="px4", listen=listen))
        ended = ground.end()
    assert ended.ended == (1, "autopilot_restarted"), ended.told
    assert "motors off" in ended.summary["reason"]
    told = ended.told
    assert told.count("its autopilot has started again") == 2, "when it happens, and at the end"
    assert told.index("the vehicle is heard again") < told.index("its autopilot has started again")
    assert "taken out of its mission" not in told


@pytest.mark.slow
def test_everything_over_a_serial_line_of_57600_baud(tmp_path):
    """Upload, download, monitor, command and a flight, with loss and delay; the line is never flooded."""
    plan = tmp_path / "rows.plan"
    rows = run("plan", "--farm", "miniberry-10", "--planner", "lawnmower", "--out", plan, cwd=tmp_path)
    assert rows.returncode == 0, rows.stderr
    with ShapedLine(tmp_path, delay_s=0.1, loss=0.1) as line:
        vehicle, device = line.devices
        listen = (f"serial:{vehicle}:57600",)
        # What an ArduPilot streams at five times real time is more than this line holds.
        with simulator(tmp_path, autopilot="ardupilot", listen=listen, speed=2):
            url = f"serial:{device}:57600"
            up = run("upload", plan, "--connect", url, "--json", cwd=tmp_path)
            assert up.returncode == 0, up.stderr
            down = run("download", "--out", tmp_path / "back.plan", "--connect", url, cwd=tmp_path)
            assert down.returncode == 0, down.stderr
            last = watched(url, tmp_path)
            assert 0.5 < last["link_quality"] < 1.0
            assert last["round_trip_s"] > 0.15
            assert run("command", url, "mode", "GUIDED", cwd=tmp_path).returncode == 0
            ground = flown(tmp_path, url)
    assert ground.ended == (0, "completed"), ground.told
    assert 0.02 < ground.summary["flights"][0]["link"]["loss"] < 0.6
    assert line.up.overrun == 0
    assert line.up.offered < 0.2 * line.down.offered


@pytest.mark.slow
def test_a_radio_that_is_unplugged_in_flight(tmp_path):
    """The device disappears and comes back as another one of the same name."""
    with ShapedLine(tmp_path, baud=460800) as line:
        vehicle, device = line.devices
        with (
            simulator(tmp_path, listen=(f"serial:{vehicle}:460800",)),
            flying(tmp_path, f"serial:{device}:460800", "--budget", "3min") as ground,
        ):
            ground.wait_for("MISSION, item")
            line.unplug_ground()
            ground.wait_for("nothing is heard of the vehicle")
            line.plug_ground()
            ended = ground.end()
    assert ended.ended == (0, "completed"), ended.told
    assert "the vehicle is heard again" in ended.told
