"""Folders of benchmarks, which vanish however the program is ended."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
PROGRAM = """
import time
from common import scratch_folder
with scratch_folder({folder!r}) as folder:
    (folder / "flight.tlog").write_bytes(b"frames")
    print("written", flush=True)
    {then}
"""


def run(folder: Path, then: str) -> "subprocess.Popen[str]":
    program = PROGRAM.format(folder=str(folder), then=then)
    return subprocess.Popen(
        [sys.executable, "-c", program], cwd=BENCHMARKS, stdout=subprocess.PIPE, text=True
    )


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_a_folder_vanishes_when_the_program_is_ended(tmp_path: Path, number: signal.Signals) -> None:
    with run(tmp_path, "time.sleep(60)") as process:
        assert process.stdout is not None and process.stdout.readline() == "written\n"
        assert len(list(tmp_path.iterdir())) == 1
        process.send_signal(number)
        code = process.wait(30)
    assert code in (128 + number, -number)
    assert not list(tmp_path.iterdir())


def test_a_folder_vanishes_at_the_end_and_after_an_error(tmp_path: Path) -> None:
    for then, code in (("pass", 0), ("raise SystemExit(3)", 3)):
        with run(tmp_path, then) as process:
            assert process.wait(30) == code
        assert not list(tmp_path.iterdir())
