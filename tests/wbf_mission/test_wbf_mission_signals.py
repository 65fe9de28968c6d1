"""Ctrl-C, SIGTERM and SIGHUP, sent to real processes."""

import json
import shlex
import signal
import socket
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from processes import command, free_port, started
from sweeps import slow

from mission.link.codec.dialect import mavlink as m
from mission.link.tlog import TlogWriter, read_tlog
from mission.outcome import Outcome
from wbf_mission import flight
from wbf_mission.cli import signals
from wbf_mission.cli.app import main
from wbf_mission.results.result import load_result
from wbf_mission.results.writing import ResultFolder
from wbf_mission.run.joint_flight import JointFlight

LONG_S = 120.0  # a limit against hanging, not a measure
SMALL_RUN = ["fly", "--farm", "miniberry-10", "--planner", "lawnmower", "--estimator", "point", "-q"]


def start(*arguments, cwd, before=(), **options):
    """Start the command line."""
    return started([*before, *command(*arguments)], cwd=cwd, **options)


def wait_for(condition, process):
    end_s = time.monotonic() + LONG_S
    while not condition():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end_s, "it never came"
        time.sleep(0.05)


def end(process):
    out, err = process.communicate(timeout=LONG_S)
    assert "Traceback" not in err
    return out, err


def start_sim(folder, *more, **options):
    listen = f"tcpin:127.0.0.1:{free_port()}"
    words = f"sim --no-camera --listen {listen} --ready-file ready --tlog sim.tlog".split()
    process = start(*words, *more, cwd=folder, **options)
    wait_for((folder / "ready").exists, process)
    assert (folder / "ready").read_text() == f"{listen}\n"
    return process, listen


def test_a_simulator_ends_in_order(tmp_path):
    process, listen = start_sim(tmp_path, "--json")
    _, host, port = listen.split(":")
    with socket.create_connection((host, int(port))) as client:
        client.settimeout(LONG_S)
        heard = client.recv(4096)
        process.send_signal(signal.SIGINT)
        while piece := client.recv(65536):
            heard += piece
    out, _ = end(process)
    assert process.returncode == 0
    assert json.loads(out)["stopped"] == "stopped"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["sim.tlog"], "the ready file is gone"
    logged = [message for _, message in read_tlog(tmp_path / "sim.tlog")]
    states = [message.system_status for message in logged if message.get_type() == "HEARTBEAT"]
    assert states[-1] == m.MAV_STATE_POWEROFF
    assert m.MAV_STATE_POWEROFF not in states[:-1]
    messages = m.MAVLink(None).parse_buffer(heard)
    beats = [message for message in messages if message.get_type() == "HEARTBEAT"]
    assert beats[-1].system_status == m.MAV_STATE_POWEROFF, "the client hears it, too"


def test_a_simulator_in_the_background_of_a_script_ends_by_sigterm(tmp_path):
    """There the shell ignores SIGINT."""
    ignore = (
        sys.executable,
        "-c",
        "import os,signal,sys; signal.signal(2, signal.SIG_IGN); os.execv(sys.argv[1], sys.argv[1:])",
    )
    process, _ = start_sim(tmp_path, before=ignore)
    process.send_signal(signal.SIGINT)
    time.sleep(0.5)
    assert process.poll() is None
    process.send_signal(signal.SIGTERM)
    end(process)
    assert process.returncode == 143


def test_a_simulator_that_cannot_start_leaves_the_ready_file_of_another(tmp_path):
    ready = tmp_path / "ready"
    ready.write_text("mine\n")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        url = f"tcpin:127.0.0.1:{taken.getsockname()[1]}"
        code = main(["sim", "--no-camera", "--listen", url, "--ready-file", str(ready)])
    assert code == 2
    assert ready.read_text() == "mine\n"


def test_an_interrupted_wait_for_a_vehicle_is_one_line(tmp_path):
    process = start(
        "download", "--connect", "udpin:127.0.0.1:0", "--wait", "600", "--out", "x.plan", cwd=tmp_path
    )
    assert "waiting for a vehicle" in process.stderr.readline()
    process.send_signal(signal.SIGINT)
    _, err = end(process)
    assert (process.returncode, err) == (130, "error: interrupted\n")
    assert not list(tmp_path.iterdir())


@pytest.fixture
def installed(monkeypatch):
    now_s = [100.0]
    monkeypatch.setattr("geo.processes.time", SimpleNamespace(monotonic=lambda: now_s[0]))
    signals.install()
    yield now_s
    signals.restore()


def test_the_first_signal_counts_and_the_third_is_the_systems(installed):
    assert signals.exit_code(0) == 0
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGTERM)
    assert signals.exit_code(0) == 143
    installed[0] += 0.9
    signal.raise_signal(signal.SIGINT)  # repeats the first
    assert signal.getsignal(signal.SIGINT) not in (signal.SIG_DFL, signal.SIG_IGN)
    installed[0] += 0.1
    assert signal.getsignal(signal.SIGINT) not in (signal.SIG_DFL, signal.SIG_IGN)
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    assert signals.exit_code(0) == 143
    assert signal.getsignal(signal.SIGINT) is signal.SIG_DFL


@pytest.mark.usefixtures("installed")
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGHUP, 129)], ids=str)
def test_the_exit_code_tells_the_signal(number, code):
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(number)
    assert signals.exit_code(0) == code


def test_what_is_ignored_stays_ignored_and_all_is_put_back():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        term = signal.getsignal(signal.SIGTERM)
        signals.install()
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
        signals.restore()
        assert signal.getsignal(signal.SIGTERM) == term
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_deferred_signal_that_repeats_is_still_deferred(installed):
    signals.defer(True)
    signal.raise_signal(signal.SIGTERM)
    installed[0] += 0.01
    signal.raise_signal(signal.SIGTERM)
    assert signals.came()
    installed[0] += 5.0
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGTERM)


def test_an_announcement_is_said_at_once_and_once(capfd, installed):
    with signals.announcing("saving the run"):
        for _ in range(2):
            installed[0] += 2.0
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)
    assert capfd.readouterr().err == "saving the run\n"


@pytest.mark.usefixtures("installed")
def test_what_is_not_true_yet_is_not_announced(capfd):
    with signals.announcing("saving the run", when=lambda: False), pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    assert capfd.readouterr().err == ""


def test_ctrl_c_while_planning_does_not_promise_a_result(tmp_path, monkeypatch, capfd):
    """Nothing was flown yet, so nothing is saved."""
    planning = "wbf_mission.run.campaign.Campaign.plan"
    monkeypatch.setattr(planning, lambda *_, **__: signal.raise_signal(signal.SIGINT))
    assert main(["fly", "--farm", "miniberry-10", "--out", str(tmp_path / "run")]) == 130
    assert capfd.readouterr().err == "error: interrupted\n"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("apart_s", "saved"), [(0.01, True), (0.9, True), (1.0, False)])
def test_a_signal_that_is_sent_twice_at_once_saves_the_flight_as_promised(
    tmp_path, monkeypatch, installed, capfd, apart_s, saved
):
    """GNU `timeout` sends SIGTERM to the process and to its group; the second one comes wherever it wants."""
    learn, gather = JointFlight.learn, flight._result
    sent = []

    def first(self):
        if self.now_s > 10.0 and not sent:
            sent.append(signal.raise_signal(signal.SIGTERM))
        learn(self)

    def second(campaign):
        installed[0] += apart_s
        signal.raise_signal(signal.SIGTERM)
        return gather(campaign)

    monkeypatch.setattr(JointFlight, "learn", first)
    monkeypatch.setattr(flight, "_result", second)
    arguments = ["--farm", "miniberry-10", "--estimator", "point", "--vehicle", "quad", "--no-plots"]
    code = main(["fly", *arguments, "--speed", "1e6", "--json", "--out", str(tmp_path / "run")])
    assert "saved in" in capfd.readouterr().err
    assert code == 143
    assert (tmp_path / "run" / "summary.json").is_file() is saved


def last_bytes(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.parametrize(("number", "after_s"), [(signal.SIGKILL, 1.2), slow(signal.SIGINT, 0.4)])
def test_a_run_that_is_ended_at_any_time_leaves_a_whole_result(tmp_path, number, after_s):
    """The older one with its pictures or the newer one with its own; what lacks pictures goes beside."""
    run, beside = tmp_path / "run", tmp_path / "run.interrupted"
    assert main([*SMALL_RUN, "--seed", "1", "--out", str(run)]) == 0
    older = last_bytes(run)
    process = start(*SMALL_RUN, "--seed", "2", "--out", "run", "--overwrite", cwd=tmp_path)
    # Writing begins with the tables.
    wait_for(lambda: any(tmp_path.glob(".run.partial/*.parquet")), process)
    time.sleep(after_s)
    process.send_signal(number)
    end(process)
    loaded = load_result(run)
    assert last_bytes(run).keys() == older.keys()
    assert loaded.scenario.seed == 2 or last_bytes(run) == older
    if number == signal.SIGINT:  # what is flown is not lost
        assert 2 in (loaded.scenario.seed, beside.exists() and load_result(beside).scenario.seed)
    assert main([*SMALL_RUN, "--seed", "2", "--out", str(run), "--overwrite"]) == 0
    assert load_result(run).scenario.seed == 2
    assert {path.name for path in tmp_path.iterdir()} <= {"run", "run.interrupted", "run.killed.tlog"}


def test_the_log_of_a_killed_flight_is_kept_beside_and_is_made_a_map_of(tmp_path, capfd):
    run, log = tmp_path / "my run", tmp_path / ".my run.partial" / "flight.tlog"
    kept = [tmp_path / "my run.killed.tlog", tmp_path / "my run.killed-2.tlog"]
    kept[0].write_bytes(b"of an earlier one")
    arguments = [*SMALL_RUN, "--vehicle", "quad", "--no-plots", "--out", "my run"]
    process = start(*arguments, "--speed", "20", cwd=tmp_path)
    wait_for(lambda: log.exists() and log.stat().st_size > 60_000, process)
    process.kill()
    end(process)
    logs = [b"of an earlier one", log.read_bytes()]
    capfd.readouterr()
    with ResultFolder(run, scenario={"farm": "miniberry-10"}, warn=(told := []).append):
        pass
    assert [path.read_bytes() for path in kept] == logs, "the first one is not overwritten"
    assert "my run.killed-2.tlog" in told[0]
    command = shlex.split(told[0].partition("'")[2].rpartition("'")[0])
    assert command[0] == "wbf-mission"
    assert main(command[1:]) == 0
    assert list(Path(command[-1]).glob("*.html"))


def flown(log):
    with TlogWriter(log) as file:
        beat = m.MAVLink_heartbeat_message(2, 12, m.MAV_MODE_FLAG_SAFETY_ARMED, 0, 4, 3)
        file.write(beat.pack(m.MAVLink(None)), 1.0)


def test_the_log_of_a_killed_flight_into_the_working_folder_is_kept(tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    (tmp_path / ".here.partial").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    flown(tmp_path / ".here.partial" / "flight.tlog")
    with ResultFolder(Path(), warn=(told := []).append):
        pass
    assert (tmp_path / "here.killed.tlog").is_file()
    assert str(tmp_path / "here.killed.tlog") in told[0]


@pytest.mark.parametrize(("real", "kept"), [(True, True), (False, False)])
def test_the_log_of_a_real_flight_outlives_an_error(tmp_path, real, kept):
    """A simulated one is flown again by its seed."""
    with pytest.raises(OSError, match="full"), ResultFolder(tmp_path / "run", real=real) as folder:
        flown(folder.tlog)
        raise OSError("full")
    assert (tmp_path / "run.killed.tlog").is_file() is kept


@pytest.mark.parametrize(
    "data", [b"", m.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3).pack(m.MAVLink(None)), None]
)
def test_a_log_in_which_nothing_flew_is_not_kept(tmp_path, data):
    left = tmp_path / ".run.partial"
    left.mkdir()
    if data is not None:
        (left / "flight.tlog").write_bytes(bytes(8) + data)
    with ResultFolder(tmp_path / "run", warn=(told := []).append):
        pass
    assert not told
    assert list(tmp_path.iterdir()) == []


def test_the_second_run_into_a_folder_fails_at_once(tmp_path, monkeypatch, capfd):
    slow = [*SMALL_RUN, "--vehicle", "quad", "--speed", "5", "--no-plots", "--out", "run"]
    process = start(*slow, cwd=tmp_path)
    log = tmp_path / ".run.partial" / "flight.tlog"
    wait_for(lambda: log.exists() and log.stat().st_size > 5_000, process)
    monkeypatch.chdir(tmp_path)
    assert main([*SMALL_RUN, "--out", "run", "--overwrite"]) == 2
    told = "run: another run writes into this folder; wait for it, or give another folder"
    assert capfd.readouterr().err == f"error: {told}\n"
    process.send_signal(signal.SIGTERM)
    end(process)
    assert process.returncode == 143
    assert load_result(tmp_path / "run").outcome is Outcome.INTERRUPTED
    assert [path.name for path in tmp_path.iterdir()] == ["run"]
