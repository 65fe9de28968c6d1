"""Help pages that list options by panel, or only options for beginners, with examples to copy.

The text is plain, because drawing the boxes of rich would take longer than the rest of ``--help``.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import Any, ClassVar

import typer
from typer.core import TyperCommand, TyperGroup

from wbf_mission.cli.options import TargetError
from wbf_mission.exit_codes import ExitCode

_ARGUMENTS, _MAIN, _OPTIONS = "Arguments", "Main options", "Options"
HELP_ALL = "--help-all"


class _Help:
    """Layout of the help pages of commands and groups."""

    def format_options(self: Any, ctx: Any, formatter: Any) -> None:
        """Write the arguments, then the options by panel, in the order of the panels' first options."""
        sections: dict[str, list[tuple[str, str]]] = {_ARGUMENTS: []}
        for panel, parameter in self.shown(ctx):
            record = parameter.get_help_record(ctx)
            if record is not None:
                name, text = record
                sections.setdefault(panel, []).append((name.replace(" range>", ">"), text))
        sections[_OPTIONS] = sections.pop(_OPTIONS, [])  # --help and options without a panel come last
        for title, rows in sections.items():
            if rows:
                with formatter.section(title):
                    formatter.write_dl(rows)

    def shown(self: Any, ctx: Any) -> Iterable[tuple[str, Any]]:
        """Yield the parameters that the help page shows, each with its panel."""
        for parameter in self.get_params(ctx):
            is_argument = parameter.param_type_name == "argument"
            panel = _ARGUMENTS if is_argument else getattr(parameter, "rich_help_panel", None) or _OPTIONS
            yield panel, parameter

    def format_epilog(self: Any, ctx: Any, formatter: Any) -> None:  # noqa: ARG002
        """Write the epilog: first line as a heading, other lines unwrapped so that users can copy them."""
        if self.epilog:
            title, *lines = (line for line in self.epilog.splitlines() if line.strip())
            with formatter.section(title):
                for line in lines:
                    formatter.write(f"  {line}\n")


class HelpCommand(_Help, TyperCommand):
    """A command whose help page lists the options by panel."""

    beginners: ClassVar[tuple[str, ...]] = ()
    """Options that ``--help`` shows, in this order; all if there are none. ``--help-all`` shows all."""

    def __init__(self, *args: Any, **settings: Any) -> None:
        super().__init__(*args, **settings)
        if self.beginners:
            count = sum(parameter.param_type_name == "option" for parameter in self.params)
            self.params.append(_help_all(count))

    @classmethod
    def showing(cls, beginners: tuple[str, ...]) -> type[HelpCommand]:
        """Return a command class whose ``--help`` shows only `beginners`, or all options if it is empty."""
        return type(cls.__name__, (cls,), {"beginners": beginners})

    def shown(self, ctx: Any) -> Iterable[tuple[str, Any]]:
        """Return the parameters that the help page shows, each with its panel."""
        every = list(super().shown(ctx))
        if not self.beginners or ctx.meta.get(HELP_ALL):
            return every
        by_flag = {flag: parameter for _, parameter in every for flag in parameter.opts}
        arguments = [(panel, parameter) for panel, parameter in every if panel == _ARGUMENTS]
        main = [(_MAIN, by_flag[flag]) for flag in self.beginners]
        return [*arguments, *main, (_OPTIONS, by_flag["--help"]), (_OPTIONS, by_flag[HELP_ALL])]

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments; if ``--force`` is unknown, raise an error that suggests ``--overwrite``."""
        try:
            return super().parse_args(ctx, args)
        except typer.TyperException as error:
            wanted = getattr(error, "option_name", None)
            if wanted == "--force" and any("--overwrite" in parameter.opts for parameter in self.params):
                msg = f"{ctx.command_path} has no --force: --overwrite replaces an existing file"
                raise TargetError(msg) from None
            raise


def _help_all(count: int) -> Any:
    def show(ctx: typer.Context, wanted: bool) -> None:
        if wanted and not ctx.resilient_parsing:
            ctx.meta[HELP_ALL] = True
            sys.stdout.write(ctx.get_help() + "\n")
            raise typer.Exit

    text = f"Show all {count} options and exit."
    only = typer.Typer(add_completion=False)

    @only.command()
    def command(_: bool = typer.Option(False, HELP_ALL, help=text, is_eager=True, callback=show)) -> None:
        """Declare the option ``--help-all``; typer creates an option only as a parameter of a command."""

    (option,) = typer.main.get_command(only).params
    option.expose_value = False
    return option


class HelpGroup(_Help, TyperGroup):
    """A group whose help page lists its commands, then its options; without a command, it prints the page."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments; if there are none, print the help and end with exit code 2."""
        if not args and not ctx.resilient_parsing:
            sys.stdout.write(ctx.get_help() + "\n")
            raise typer.Exit(ExitCode.BAD_INPUT)
        return super().parse_args(ctx, args)

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write each command with the first sentence of the command's help, then the group's options."""
        commands = ((name, self.get_command(ctx, name)) for name in self.list_commands(ctx))
        with formatter.section("Commands"):
            formatter.write_dl(
                [(name, found.get_short_help_str(limit=200)) for name, found in commands if found is not None]
            )
        super().format_options(ctx, formatter)
