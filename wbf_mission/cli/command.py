"""Commands and browser pages that packages provide as entry points."""

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
"""Group of entry points for commands. An entry ``bench.NAME`` becomes ``wbf-mission bench NAME``."""
PAGES = "wbf_mission.pages"
"""Group of entry points for browser pages."""


class Command(NamedTuple):
    """A command of the command line.

    Attributes
    ----------
    call : callable
        Function whose parameters `typer` reads and whose docstring is the help.
    examples : str
        A heading line, then a line for each example.
    beginners : tuple of str
        Options that ``--help`` shows if the command has more than twenty; ``--help-all`` shows all options.
    ignore_unknown_options : bool
        Whether an unknown option, such as -5, is taken as an argument.
    """

    call: Callable[..., Any]
    examples: str
    beginners: tuple[str, ...] = ()
    ignore_unknown_options: bool = False

    def add_to(self, app: typer.Typer, name: str) -> None:
        """Add the command to an application or group."""
        kind = HelpCommand.showing(self.beginners)
        settings = {"ignore_unknown_options": self.ignore_unknown_options}
        app.command(name, cls=kind, epilog=self.examples, context_settings=settings)(self.call)


def add_commands(app: typer.Typer, groups: Mapping[str, str], commands: Mapping[str, Command]) -> None:
    """Add `commands` and the commands of packages to an application and its groups.

    `groups` maps names of groups to their help. A command that cannot be loaded is added too, and raises the
    error when it is called. A group without commands is left out.
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
    """The page ``live``: a context manager that serves it, and yields its address and event listener."""

    def __call__(
        self, *, host: str, port: int, orders: Orders | None, tiles: Path | None
    ) -> AbstractContextManager[tuple[str, Callable[[Event], None]]]:
        """Raise LinkError if the port is in use, another WbfMissionError if the tiles are unusable."""


def live_page() -> LivePage:
    """Return the live page; raise TargetError if no add-on provides it."""
    return provided("live")


def provided(name: str) -> Any:
    """Return the page with this name; raise TargetError if no add-on provides it."""
    return load_named(PAGES, name, "brings the page", "the page", TargetError)
