"""Commands provided by packages: entry points of one group, each a `Command`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import typer

from geo.imports import entry_points, load_entry
from wbf_mission.cli.help import HelpCommand, HelpGroup
from wbf_mission.cli.options import TargetError

GROUP = "wbf_mission.commands"
"""Group of entry points, named by command; ``bench.NAME`` becomes ``wbf-mission bench NAME``."""


class Command(NamedTuple):
    """A command of the command line.

    Attributes
    ----------
    call : callable
        Function with parameters for `typer`; its docstring is the help.
    examples : str
        A heading, and a line for each example.
    beginners : tuple of str
        Options in ``--help``, for a command with more than twenty; ``--help-all`` shows all.
    ignore_unknown_options : bool
        Whether an unknown option is an argument, such as -5.
    """

    call: Callable[..., Any]
    examples: str
    beginners: tuple[str, ...] = ()
    ignore_unknown_options: bool = False

    def add_to(self, app: typer.Typer, name: str) -> None:
        """Add the command to a group."""
        kind = HelpCommand.showing(self.beginners)
        settings = {"ignore_unknown_options": self.ignore_unknown_options}
        app.command(name, cls=kind, epilog=self.examples, context_settings=settings)(self.call)


def add_commands(app: typer.Typer, groups: Mapping[str, str], commands: Mapping[str, Command]) -> None:
    """Add `commands`, and those of packages, to an application and its groups (names with their help).

    A command that cannot be loaded is added too, and raises the error when it is called. A group without
    commands is left out.
    """
    apps = {"": app, **{name: typer.Typer(cls=HelpGroup, help=text) for name, text in groups.items()}}
    found = dict(commands)
    for entry in sorted(entry_points(GROUP), key=lambda entry: entry.name):
        try:
            command = load_entry(entry, f"the command {entry.name}", TargetError)
            if not isinstance(command, Command):
                raise TargetError(f"the command {entry.name} ({entry.value}) is no {Command.__qualname__}")
        except TargetError as error:
            command = _broken(error)
        found[entry.name] = command
    for name, command in found.items():
        group, _, last = name.rpartition(".")
        if group in apps:
            command.add_to(apps[group], last)
    for name in groups:
        if apps[name].registered_commands:
            app.add_typer(apps[name], name=name)


def _broken(error: TargetError) -> Command:
    def call() -> None:
        raise error

    call.__doc__ = "(cannot be loaded)"
    return Command(call, "")
