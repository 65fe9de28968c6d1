"""A pseudo-terminal for a program, and what a terminal of some width shows of its output."""

import fcntl
import os
import pty
import re
import select
import struct
import subprocess
import sys
import termios
import time

from processes import environment

_PIECE = re.compile(r"\x1b\[(\?)?([\d;]*)([A-Za-z])|[\r\n]|[^\x1b\r\n]")


def screen(written, width):
    """Return the lines that a terminal of a width shows in the end, those that it scrolled away included."""
    lines, row, column = [[]], 0, 0
    for piece in _PIECE.finditer(written):
        text, (private, number, order) = piece.group(), piece.groups()
        if text == "\r":
            column = 0
        elif text == "\n":
            row += 1
        elif order == "A":
            row = max(0, row - int(number or 1))
        elif order == "K" and number == "2":
            lines[row] = []
        elif order is not None:
            assert private or order == "m", f"not known here: {text!r}"
        else:
            if column == width:
                row, column = row + 1, 0
            lines.extend([] for _ in range(row + 1 - len(lines)))
            lines[row][len(lines[row]) :] = [" "] * (column + 1 - len(lines[row]))
            lines[row][column] = text
            column += 1
        lines.extend([] for _ in range(row + 1 - len(lines)))
    return ["".join(line).rstrip() for line in lines]


def on_terminal(arguments, *, width, cwd, columns=None, limit_s=120.0):
    """Run a program of Python on a terminal, which COLUMNS may call wider; return exit code and output."""
    terminal, end = pty.openpty()
    fcntl.ioctl(end, termios.TIOCSWINSZ, struct.pack("HHHH", 24, width, 0, 0))
    process = subprocess.Popen(
        [sys.executable, *arguments],
        cwd=cwd,
        stdin=end,
        stdout=end,
        stderr=end,
        start_new_session=True,
        env=environment(TERM="xterm", COLUMNS=str(columns or ""), LINES=""),
    )
    os.close(end)
    written, until_s = b"", time.monotonic() + limit_s
    try:
        while select.select([terminal], [], [], max(0.0, until_s - time.monotonic()))[0]:
            piece = os.read(terminal, 65536)
            if not piece:
                break
            written += piece
    except OSError:  # the program has closed it
        pass
    finally:
        os.close(terminal)
        code = process.wait(limit_s)
    return code, written.decode()
