"""Runs the command line ``wbf-mission COMMAND``; other modules of this package define the commands."""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import sys
import warnings
from functools import cache
from typing import Annotated, Any

import typer

from geo.errors import WbfMissionError, told_error, users_line
from geo.texts import printable
from wbf_mission.cli import bench, fly, plan, signals
from wbf_mission.cli.command import Command, add_commands
from wbf_mission.cli.help import HelpGroup
from wbf_mission.cli.output import StdoutError, to_stdout
from wbf_mission.exit_codes import ExitCode, exit_code_of

EXIT_CODES = """
Exit codes
  0 done                        4 the link dropped
  1 the outcome is not good     5 the vehicle refused
  2 bad input                 130 Ctrl-C
  3 no vehicle was heard      143 SIGTERM
"""

app = typer.Typer(
    name="wbf-mission",
    cls=HelpGroup,
    rich_markup_mode=None,
    epilog=EXIT_CODES,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
)
_GROUPS = {
    "bench": "Fly many runs that can be compared.",
    "farm": ("List farms; show a farm, draw it, save it as GeoJSON, or generate its environments."),
    "vehicle": "List vehicles, or show a vehicle and its endurance.",
}
_COMMANDS = {
    "plan": Command(plan.plan_command, plan.EXAMPLES, plan.BEGINNERS),
    "fly": Command(fly.fly_command, fly.EXAMPLES, fly.BEGINNERS),
    "bench.run": Command(bench.run_command, bench.RUN_EXAMPLES),
}
add_commands(app, _GROUPS, _COMMANDS)
_built = cache(typer.main.get_command)  # Cached: typer would build all commands at each call


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        sys.stdout.write(f"wbf-mission {version('wbf-mission')}\n")
        raise typer.Exit


@app.callback()
def _root(
    _version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Plan drone scouting missions, fly them in simulation or upload them, and score the resulting maps."""


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return the exit code; print each error as one line on stderr."""
    warnings.formatwarning = lambda message, *_, **__: (
        f"warning: {' '.join(printable(str(message)).split())}\n"
    )
    logger = logging.getLogger(
        "asyncio"
    )  # Ctrl-C leaves tasks of libraries unfinished; no tracebacks of them
    logger.propagate = False
    if not logger.handlers:
        logger.addHandler(logging.NullHandler())
    try:
        code = _run(sys.argv[1:] if arguments is None else arguments)
        with to_stdout():
            pass
    except StdoutError as error:
        _discard_output()
        if error.reader_gone:
            return ExitCode.OUTPUT_CLOSED
        return _complain(f"stdout cannot be written to: {error}", ExitCode.BAD_INPUT)
    return signals.exit_code(code) if code == ExitCode.INTERRUPTED else code


def _run(arguments: list[str]) -> int:
    try:
        os.getcwd()  # noqa: PTH109
    except FileNotFoundError:
        return _complain("the working folder was removed: change to an existing folder", ExitCode.BAD_INPUT)
    try:
        code = _built(app)(args=arguments, standalone_mode=False, prog_name="wbf-mission", obj=arguments)
    except typer.TyperException as error:
        return _complain(_usage(error), error.exit_code)
    except WbfMissionError as error:
        return _complain(str(error), exit_code_of(error))
    except (KeyboardInterrupt, typer.Abort):
        code = ExitCode.INTERRUPTED
    except StdoutError:
        raise
    except SystemExit as error:
        if users_line(error) is not None:
            return _complain(f"your own code ended the program: {told_error(error)}", ExitCode.BAD_INPUT)
        if isinstance(error.__context__, OSError):  # typer could not write its help
            return ExitCode.OUTPUT_CLOSED
        code = error.code  # Shell completion ends by SystemExit
    except MemoryError:
        return _complain("out of memory: choose a smaller farm or fewer days", ExitCode.BAD_INPUT)
    except OSError as error:
        # An error that names no file comes from stdout
        if error.filename is None and error.errno == errno.ENOSPC:
            raise StdoutError(error) from error
        where = f"{error.filename}: " if error.filename else ""
        return _complain(f"{where}{error.strerror or error}", ExitCode.BAD_INPUT)
    except Exception as error:
        if os.environ.get("WBF_MISSION_DEBUG"):
            raise
        if users_line(error) is not None:
            return _complain(f"{told_error(error)}: this error is in your own code", ExitCode.BAD_INPUT)
        text = (
            f"{type(error).__name__}: {error}; this is a mistake in wbf-mission, not yours: "
            "please report it (WBF_MISSION_DEBUG=1 shows where it happened)"
        )
        return _complain(text, ExitCode.PROGRAM_ERROR)
    if code == ExitCode.INTERRUPTED:
        return _complain("interrupted", ExitCode.INTERRUPTED)
    return code if isinstance(code, int) else ExitCode.GOOD


def _usage(error: typer.TyperException) -> str:
    """Return the message of a usage error without prefixes that libraries add."""
    at: Any = getattr(error, "ctx", None)
    text = error.format_message().replace("Value error, ", "", 1).replace("\n\t", " ")
    return f"{text} (see '{'wbf-mission' if at is None else at.command_path} --help')"


def _complain(text: str, code: int) -> int:
    one_line = " ".join(printable(text).split())
    if one_line:
        with contextlib.suppress(OSError):
            sys.stderr.write(f"error: {one_line}\n")
    return code


def _discard_output() -> None:
    """Redirect stdout to the null device, so that flushing buffered output at the end cannot fail."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    with contextlib.suppress(OSError, ValueError):
        os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)
