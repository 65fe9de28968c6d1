"""Commands that packages bring: those that are none say so when they are called, and break no other."""

import importlib
from types import SimpleNamespace

import pytest
import typer

from wbf_mission.cli import command
from wbf_mission.cli.command import Command, add_commands
from wbf_mission.cli.options import TargetError


def registered(monkeypatch, **loads):
    """Return a group with commands of a package, by how each is loaded."""
    entries = [SimpleNamespace(name=name, value="mine:it", load=load) for name, load in loads.items()]
    monkeypatch.setattr(command, "entry_points", lambda group: entries if group == command.GROUP else [])
    app = typer.Typer()
    add_commands(app, {}, {})
    return app


def broken():
    compile("x = (", "mine.py", "exec")


def absent():
    importlib.import_module("no_such_library")


@pytest.mark.parametrize(
    ("load", "words"),
    [
        (broken, "the command bad (mine:it) cannot be loaded: "),
        (absent, "No module named 'no_such_library'"),
        (lambda: "a text", "the command bad (mine:it) is no Command"),
    ],
)
def test_a_command_that_cannot_be_loaded_says_why(monkeypatch, load, words):
    called = []
    good = Command(lambda: called.append(True), "")
    app = registered(monkeypatch, good=lambda: good, bad=load)
    app(args=["good"], standalone_mode=False)
    assert called == [True]
    with pytest.raises(TargetError) as caught:
        app(args=["bad"], standalone_mode=False)
    assert words in str(caught.value)


def test_a_group_without_commands_is_left_out(monkeypatch):
    monkeypatch.setattr(command, "entry_points", lambda group: [])
    app = typer.Typer()
    add_commands(app, {"full": "", "empty": ""}, {"full.it": Command(lambda: None, "")})
    assert [group.name for group in app.registered_groups] == ["full"]
