"""The simulator command: fleets, faults, speeds, scenario files, bad input."""

import json

import pytest
from bad_files import complaint

from geo.errors import WbfMissionError
from mission.link import read_tlog
from wbf_mission.addons.sim.options import load_sim
from wbf_mission.cli.app import main

QUICK = ["sim", "--no-camera", "--listen", "udpin:127.0.0.1:0", "--speed", "max", "-q", "--json"]


def sim(capsys, *arguments):
    assert main([*QUICK, *arguments]) == 0
    return json.loads(capsys.readouterr().out)


def test_a_fleet_at_full_speed_into_a_log(tmp_path, capsys):
    log = tmp_path / "fleet.tlog"
    values = sim(capsys, "--count", "4", "--duration", "20", "--tlog", str(log))
    assert [vehicle["system"] for vehicle in values["vehicles"]] == [1, 2, 3, 4]
    assert values["simulated_s"] == 20.0
    assert {message.get_srcSystem() for _, message in read_tlog(log)} == {1, 2, 3, 4}
    again = tmp_path / "again.tlog"
    sim(capsys, "--count", "4", "--duration", "20", "--tlog", str(again))
    assert log.read_bytes() == again.read_bytes()


def test_homes_one_for_each(tmp_path, capsys):
    log = tmp_path / "homes.tlog"
    sim(capsys, "--home", "10,20,30", "--home", "11,21,31,90", "--duration", "1.5", "--tlog", str(log))
    places = {
        message.get_srcSystem(): (message.latitude, message.longitude)
        for _, message in read_tlog(log)
        if message.get_type() == "HOME_POSITION"
    }
    assert places == {1: (100000000, 200000000), 2: (110000000, 210000000)}


def test_faults_of_the_command_line_and_of_a_file(tmp_path, capsys):
    scenario = tmp_path / "bad-day.toml"
    scenario.write_text(
        'farm = "miniberry-10"\nseed = 4\nautopilot = "ardupilot"\n'
        '[sim]\ncount = 2\nspeed = "max"\nduration_s = 9.5\ncamera = false\n'
        'listen = ["udpin:127.0.0.1:0"]\n'
        '[[fault]]\nkind = "silence"\nfrom = 3\nvehicle = 2\n'
    )
    log = tmp_path / "faults.tlog"
    arguments = ["sim", "--scenario", str(scenario), "--fault", "drop=HEARTBEAT,vehicle=1,from=5"]
    assert main([*arguments, "--tlog", str(log), "--json", "-q"]) == 0
    assert json.loads(capsys.readouterr().out)["simulated_s"] == 9.5
    beats = {1: 0, 2: 0}
    for _, message in read_tlog(log):
        beats[message.get_srcSystem()] += message.get_type() == "HEARTBEAT"
    assert beats == {1: 5, 2: 3}


@pytest.mark.parametrize(
    ("given", "named"),
    [
        (("--autopilot", "px4,ardupilot"), "autopilot px4, ardupilot"),
        (("--vehicle", "quad,quad"), "vehicle quad"),
    ],
)
def test_one_simulator_has_one_kind_of_vehicle(capsys, given, named):
    assert main([*QUICK, *given, "--count", "2"]) == 2
    assert named in (error := capsys.readouterr().err) and "start one for each kind" in error
    assert main(["sim", "--help"]) == 0
    words = " ".join(capsys.readouterr().out.split())
    assert "Autopilot to simulate: px4 or ardupilot." in words and "fly as a fleet" not in words


def test_the_list_of_faults(capsys):
    assert main(["sim", "--list-faults"]) == 0
    captured = capsys.readouterr()
    assert "no-final-ack" in captured.out
    assert "direction=up|down|both" in captured.err


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--count", "0"], "1 to 250"),
        (["--count", "3", "--home", "1,2", "--home", "3,4"], "a home for each"),
        (["--count", "2", "--spacing", "-1"], "spacing"),
        (["--speed", "fast"], "max"),
        (["--duration", "-3"], "duration"),
        (["--fault", "meteor"], "meteor"),
        (["--scenario", "/no/such/file.toml"], "file.toml"),
        (["--listen", "serial:/dev/none:57600"], "cannot be opened"),
        (["--listen", "udpout:no.such.host.invalid:14550"], "no.such.host"),
        (["--autopilot", "betaflight"], "betaflight"),
        (["--home", "91,0"], "home"),
        (["--count", "1_0"], "'--count': '1_0' is not a whole number"),
        (["--fault", "loss=0.1,from=1_0"], "from '1_0' is not a number"),
        (["--camera-noise", "0.1"], "--camera-noise has no effect without the camera"),
        (["--camera-footprint", "3"], "--camera-footprint has no effect without the camera"),
    ],
)
def test_bad_input_is_one_line_and_code_2(arguments, text, capsys):
    assert main([*QUICK, "--duration", "1", *arguments]) == 2
    error = capsys.readouterr().err.strip()
    assert text in error
    assert len(error.splitlines()) == 1


def test_the_final_table_reads_as_those_of_other_commands(tmp_path, capsys):
    log = tmp_path / "sim.tlog"
    arguments = [one for one in QUICK if one not in ("--json", "--listen", "udpin:127.0.0.1:0")]
    arguments += ["--duration", "75", "--tlog", str(log)]
    for _ in range(9):
        arguments += ["--listen", "udpin:127.0.0.1:0"]
    assert main([*arguments, "--count", "2"]) == 0
    rows = [line.split("│")[1:3] for line in capsys.readouterr().out.splitlines() if "│" in line]
    named = {name.strip(): text.strip() for name, text in rows if name.strip()}
    links = [text.strip() for name, text in rows if text.strip().startswith("udpin:")]
    assert list(named) == ["simulated time", "end", "images", "links", "log", "vehicle 1", "vehicle 2"]
    assert named["simulated time"] == "1 min 15 s"
    assert (named["end"], named["images"], named["log"]) == ("time limit", "0", str(log))
    assert (named["vehicle 1"], named["vehicle 2"]) == ("running", "running")
    assert len(links) == 7
    assert "2 more" in [text.strip() for _, text in rows]


def test_nobody_at_the_other_end_has_a_code_of_its_own(capsys):
    assert main([*QUICK, "--duration", "1", "--connect", "tcp:127.0.0.1:1"]) == 3
    assert "refused" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[sim]\nspede = 1", "unknown key 'spede'"),
        ("[sim]\ncount = 'two'", "count"),
        ("sim = 3", "[sim]"),
        ("[[fault]]\nkind = 'loss'", "fault 1"),
        ("colour = 3", "unknown key 'colour'"),
        ("[sim", "not TOML"),
    ],
)
def test_bad_files(tmp_path, text, message):
    assert message in complaint(load_sim, tmp_path, text, WbfMissionError)


@pytest.mark.parametrize(
    ("options", "carries"),
    [
        (["--autopilot", "ardupilot"], False),
        (["--autopilot", "ardupilot", "--camera"], True),
        (["--autopilot", "ardupilot", "--camera-footprint", "3"], True),
        (["--autopilot", "px4"], True),
        (["--autopilot", "px4", "--no-camera"], False),
    ],
)
def test_an_arducopter_carries_a_camera_only_when_asked(options, carries, tmp_path, capsys):
    log = tmp_path / "sim.tlog"
    words = "sim --farm miniberry-10 --listen udpin:127.0.0.1:0 --speed max --duration 3"
    assert main([*words.split(), *options, "--tlog", str(log), "-q"]) == 0
    heard = {message.get_srcComponent() for _, message in read_tlog(log) if message.get_type() == "HEARTBEAT"}
    assert (100 in heard) is carries
