"""The command line: ``wbf-mission COMMAND``. What each command does is in the modules beside this one."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from geo.errors import WbfMissionError
from wbf_mission.cli import benchmark, check, farm, fly, plan, sim, transfer, vehicle

EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130

app = typer.Typer(
    name="wbf-mission",
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
)
app.command("plan", epilog=plan.EXAMPLES)(plan.plan_command)
app.command("fly", epilog=fly.EXAMPLES)(fly.fly_command)
app.command("sim", epilog=sim.EXAMPLES)(sim.sim_command)
app.command("check", epilog=check.EXAMPLES)(check.check_command)
app.command("upload", epilog=transfer.UPLOAD_EXAMPLES)(transfer.upload_command)
app.command("download", epilog=transfer.DOWNLOAD_EXAMPLES)(transfer.download_command)
app.add_typer(farm.app, name="farm")
app.add_typer(vehicle.app, name="vehicle")
app.command("benchmark", epilog=benchmark.EXAMPLES)(benchmark.benchmark_command)


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
    """Plan drone scouting missions, fly them in simulation or upload them, and score the map they give."""


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit code; errors are one line on stderr.

    Exit codes: 0 done, 1 the run ended badly (the result says how), 2 bad input, 130 Ctrl-C.
    """
    try:
        code = app(args=arguments, standalone_mode=False, prog_name="wbf-mission")
        sys.stdout.flush()
    except typer.TyperException as error:
        text = error.format_message()
        if not text:  # a command without its subcommand: its help says what there is
            app(args=[*(sys.argv[1:] if arguments is None else arguments), "--help"], standalone_mode=False)
            return EXIT_BAD_INPUT
        return _complain(f"{text} (see 'wbf-mission --help')", error.exit_code)
    except WbfMissionError as error:
        return _complain(str(error), EXIT_BAD_INPUT)
    except (KeyboardInterrupt, typer.Abort):
        return _complain("interrupted", EXIT_INTERRUPTED)
    except BrokenPipeError:
        # The reader of our output has gone; nothing is left to say, and flushing at exit must not complain.
        sys.stdout = None
        return EXIT_INTERRUPTED
    except MemoryError:
        return _complain("out of memory: choose a smaller farm or fewer days", EXIT_BAD_INPUT)
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        return _complain(f"{where}{error.strerror or error}", EXIT_BAD_INPUT)
    if code == EXIT_INTERRUPTED:
        return _complain("interrupted", EXIT_INTERRUPTED)
    return code if isinstance(code, int) else 0


def _complain(text: str, code: int) -> int:
    one_line = " ".join(text.split())
    if one_line:
        sys.stderr.write(f"error: {one_line}\n")
    return code
