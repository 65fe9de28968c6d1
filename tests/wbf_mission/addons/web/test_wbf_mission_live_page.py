"""The live page of `fly`: when it is served, what it shows, when it ends."""

import json
import signal
import socket
import subprocess

import pytest
from processes import LONG_S, command, running
from websockets.sync.client import connect

from wbf_mission.cli.app import main

FLY = ("fly", "--farm", "miniberry-10", "--planner", "spiral", "--estimator", "point", "--no-files")


def told_address(process):
    """Return the address that the process prints."""
    for line in process.stderr:
        if line.startswith("live page: "):
            return line.removeprefix("live page: ").strip()
    pytest.fail("no address was printed")


def updates(address):
    """Give the updates that a page gets, to the end of the run."""
    socket_of = address.replace("http", "ws") + "live"
    with connect(socket_of, origin=address.rstrip("/"), open_timeout=LONG_S) as page:
        outcome = "running"
        while outcome == "running":
            update = json.loads(page.recv(timeout=LONG_S))
            outcome = update.get("status", {}).get("outcome", outcome)
            yield update


@pytest.mark.slow
def test_a_page_follows_the_flight_and_stays_until_it_is_ended(tmp_path):
    # Faster, and on a busy machine it has landed before the page is open.
    words = command(*FLY, "--vehicle", "quad", "--budget", "60s", "--speed", "10", "--live", "0", "--json")
    with running(words, tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        seen = list(updates(told_address(process)))
        states = [time_s for one in seen if "states" in one for time_s in one["states"]["1"]["time_s"]]
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=LONG_S)
        assert process.returncode == 0
    summary = json.loads(out)
    assert next(one["run"] for one in seen if "run" in one)["farm"]["name"] == "miniberry-10"
    assert seen[-1]["status"]["outcome"] == summary["outcome"] == "completed"
    scores = [score for one in seen if "scores" in one for score in one["scores"]["score"]]
    assert scores[-1] == summary["final_score"]
    assert states == sorted(states) and states[-1] > summary["flight_time_s"] > states[0]
    # They came while it flew, not at its end.
    assert sum("states" in one for one in seen) > 10
    readings = sum(len(one["readings"]["time_s"]) for one in seen if "readings" in one)
    assert readings == summary["observations"]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--open",), "--open has an effect only with --live PORT"),
        (("--control",), "--control has an effect only with --live PORT"),
        (("--live", "70000"), "out of range"),
        (("--live", "0", "--tiles", "nowhere.mbtiles"), "nowhere.mbtiles"),
    ],
)
def test_wrong_options_are_refused_before_anything_flies(words, told, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main([*FLY, *words]) == 2
    error = capsys.readouterr().err
    assert told in error and "Traceback" not in error
    assert error.count("\n") == 1


def test_a_port_that_is_taken_is_told_in_one_line(capsys):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert main([*FLY, "--live", str(port)]) == 2
    assert f"{port}" in capsys.readouterr().err
