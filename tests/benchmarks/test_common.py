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
    time.sleep(60)
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_folder_vanishes_when_the_program_is_ended(tmp_path: Path, number: signal.Signals) -> None:
    program = [sys.executable, "-c", PROGRAM.format(folder=str(tmp_path))]
    with subprocess.Popen(program, cwd=BENCHMARKS, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stdout.readline() == "written\n"
        assert len(list(tmp_path.iterdir())) == 1
        process.send_signal(number)
        code = process.wait(30)
    assert code in (128 + number, -number)
    assert not list(tmp_path.iterdir())
