"""The operator's console in the process of the test: what it says and asks while a vehicle flies."""

import os

import pytest
from stand_in import scenario, stand_in

from mission.outcome import Outcome
from wbf_mission.cli import operator_console, signals
from wbf_mission.cli.operator_console import TerminalConsole
from wbf_mission.cli.output import Output
from wbf_mission.flight import fly
from wbf_mission.live.link import LiveLink


@pytest.fixture
def typed(monkeypatch):
    """Type at a terminal."""
    ours, theirs = os.openpty()
    with os.fdopen(theirs, "r") as stdin:
        monkeypatch.setattr(operator_console.sys, "stdin", stdin)
        yield lambda text: os.write(ours, text.encode())
    os.close(ours)
    signals.defer(False)


def test_a_flight_is_told_from_the_question_to_the_ground(typed, capsys):
    typed("y\n")
    with stand_in() as (url, _):
        result = fly(scenario(), connect=LiveLink(url, TerminalConsole(Output())))
    assert result.outcome is Outcome.COMPLETED
    told = capsys.readouterr().err
    for text in ("waiting until", "start the motors? [y/N]", "flying", "images, link", "vehicle: Disarmed"):
        assert text in told, told
    assert told.index("start the motors") < told.index("images, link")


def test_no_starts_nothing(typed, capsys):
    typed("no\n")
    with stand_in() as (url, made):
        result = fly(scenario(), connect=LiveLink(url, TerminalConsole(Output())))
        assert not made.vehicle.pilot.armed
    assert result.outcome is not Outcome.COMPLETED and not len(result.observations)
    assert "start the motors? [y/N]" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "goes_on"), [("\n", True), ("y\n", True), ("q\n", False), ("Quit\n", False)]
)
def test_between_sorties_one_question_and_its_answer(typed, capsys, text, goes_on):
    console = TerminalConsole(Output())
    assert console.goes_on("sortie 2 of 3?") is None
    typed(text)
    assert console.goes_on("sortie 2 of 3?") is goes_on
    assert capsys.readouterr().err.count("sortie 2 of 3?") == 1
