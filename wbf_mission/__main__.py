"""``python -m wbf_mission`` and the ``wbf-mission`` script."""

import gc
import io
import os
import sys
import warnings
from typing import TextIO

_ALLOCATED = 100_000  # CPython looks for garbage after 700 new objects: 3 % of the CPU time of a flight
_SWITCH_S = 20e-6  # Saves 30 % of Waterberry's wall time and 15 % of its CPU time; 5e-6 would save no more


def main() -> None:
    """Run the command line and end the process with its exit code."""
    gc.set_threshold(_ALLOCATED, 20, 20)
    _open_closed_streams()
    for stream in (sys.stdout, sys.stderr):  # file names may have characters outside the encoding
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    warnings.showwarning = _show_warning
    from wbf_mission.cli import signals

    signals.install()
    try:
        from geo.compiled import compile_notices
        from geo.system import use_memory_again
        from wbf_mission.cli.app import main as run

        use_memory_again()
        # At CPython's switch interval of 5 ms, the threads of flight and estimate mostly wait for each other.
        sys.setswitchinterval(_SWITCH_S)
        with compile_notices(_CompileNotice()):
            code = run()
    except KeyboardInterrupt:
        code = signals.exit_code(130)
    # After Ctrl-C inside an exec (as in dataclasses), only another exec keeps CPython from ending by SIGINT.
    exec("")  # noqa: S102
    gc.freeze()  # At exit, CPython would collect garbage: a second of CPU time after a flight over Waterberry
    sys.exit(code)


def _show_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,  # noqa: ARG001
    lineno: int,  # noqa: ARG001
    file: TextIO | None = None,
    line: str | None = None,  # noqa: ARG001
) -> None:
    """Print warnings meant for users in one line, and drop those meant for developers."""
    if not issubclass(category, DeprecationWarning | PendingDeprecationWarning | ImportWarning):
        (file or sys.stderr).write(f"warning: {' '.join(str(message).split())}\n")


class _CompileNotice:
    """Notice on stderr, printed once, that the first run takes longer because it compiles."""

    def __init__(self) -> None:
        self._said = False

    def __call__(self, name: str) -> None:
        if not self._said:
            self._said = True
            sys.stderr.write(
                f"compiling {name.partition('.')[0]} for this machine (up to two minutes); later runs reuse"
                " the compiled code ('wbf-mission warm-up' compiles ahead)\n"
            )
            sys.stderr.flush()


def _open_closed_streams() -> None:
    """Open descriptors 0, 1 and 2 on the null device if the caller closed them.

    Otherwise a file opened later would get one of these numbers, and terminal output would go into it.
    """
    streams = ("stdin", "stdout", "stderr")
    missing = [number for number, name in enumerate(streams) if getattr(sys, name) is None]
    for number in missing:
        nowhere = os.open(os.devnull, os.O_RDWR)
        if nowhere != number:
            os.dup2(nowhere, number)
            os.close(nowhere)
        setattr(sys, streams[number], open(number, "w" if number else "r", encoding="utf-8"))  # noqa: SIM115, PTH123


if __name__ == "__main__":
    main()
