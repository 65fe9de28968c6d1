"""Commands and browser pages provided by packages: entry points of a group each."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import typer

from geo.imports import entry_points, load_entry, load_named
from wbf_mission.cli.help import HelpCommand, HelpGroup
from wbf_mission.cli.options import TargetError

if TYPE_CHECKING:
    from wbf_mission.events import Event
    from wbf_mission.run.orders import Orders

GROUP = "wbf_mission.commands"
"""Group of entry points, named by command; ``bench.NAME`` becomes ``wbf-mission bench NAME``."""
PAGES = "wbf_mission.pages"
"""Group of entry points, named by page."""


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


class LivePage(Protocol):
    """``live``: context that serves the page of a run, and gives the page's address and its listener."""

    def __call__(
        self, *, host: str, port: int, orders: Orders | None, tiles: Path | None
    ) -> AbstractContextManager[tuple[str, Callable[[Event], None]]]:
        """LinkError if the port is in use; a WbfMissionError if the tiles cannot be used."""


def live_page() -> LivePage:
    """Return the live page; TargetError if no add-on provides one."""
    page: LivePage = provided("live")
    return page


def provided(name: str) -> Any:
    """Return the page of a name; TargetError if no add-on provides it."""
    return load_named(PAGES, name, "brings the page", "the page", TargetError)
