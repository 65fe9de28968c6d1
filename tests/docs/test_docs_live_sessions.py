"""What the page shows of a flight in two terminals is what is printed, but for its numbers."""

import contextlib
import os
import pty
import re
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from processes import LONG_S, command, running, wait_until

DOCS = Path(__file__).parents[2] / "docs"
_ADDRESS = "127.0.0.1:5760"
_QUESTION = "[y/N]"


def commands_of(page):
    """The commands of the page's console blocks, each with the lines that it shows of their output."""
    text = (DOCS / page).read_text(encoding="utf-8")
    blocks = re.findall(r"^```console\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)
    lines = "".join(blocks).split("$ wbf-mission ")[1:]
    return [(first.split(), shown) for first, *shown in (one.splitlines() for one in lines)]


def plain(line):
    """A line without frames of tables, escape sequences and numbers."""
    line = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", line).replace("│", " ")
    return " ".join(re.sub(r"\d+(\.\d+)?", "#", line).split())


def answered(words, cwd):
    """Run a command at a terminal, say yes to its question, and return what it printed."""
    ours, theirs = pty.openpty()
    printed = bytearray()

    def read():
        asked = False
        with contextlib.suppress(OSError):  # the terminal of a process that ended
            while part := os.read(ours, 65536):
                printed.extend(part)
                if not asked and _QUESTION.encode() in printed:
                    asked = True
                    os.write(ours, b"y\n")

    reader = threading.Thread(target=read, daemon=True)
    with running(words, cwd, stdin=theirs, stdout=theirs, stderr=theirs) as process:
        os.close(theirs)
        reader.start()
        code = process.wait(LONG_S)
        reader.join(10.0)
    os.close(ours)
    return code, printed.decode()


@pytest.mark.skipif(sys.platform == "win32", reason="needs a pseudo-terminal")
def test_the_page_shows_what_two_terminals_print(tmp_path):
    (sim, _), (fly, shown) = commands_of("first-live-flight.md")[:2]
    assert (sim[0], fly[0]) == ("sim", "fly")
    ready = tmp_path / "ready"
    words = [word.replace(_ADDRESS, "127.0.0.1:0") for word in sim]
    with running(
        command(*words, "--speed", 5, "--ready-file", ready), tmp_path, stdout=subprocess.DEVNULL
    ) as process:
        wait_until(lambda: ready.exists() or process.poll() is not None, "the simulator does not start")
        (port,) = set(re.findall(r"127\.0\.0\.1:(\d+)", ready.read_text()))
        words = [word.replace(_ADDRESS, f"127.0.0.1:{port}") for word in fly]
        code, printed = answered(command(*words, "--no-plots"), tmp_path)
    assert code == 0, printed
    lines = [plain(line) for line in re.split(r"[\r\n]+", printed)]
    at = 0
    for line in shown:
        if line == "...":
            continue
        wanted = plain(line.removesuffix(" y"))
        found = next((k for k, one in enumerate(lines[at:], start=at) if one.startswith(wanted)), None)
        assert found is not None, f"{line!r} is not printed after {lines[max(at - 5, 0) : at]}"
        at = found + 1
