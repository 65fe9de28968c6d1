"""Calls in processes of their own."""

import os
import signal
import subprocess
import sys
import time
from concurrent.futures.process import BrokenProcessPool

import pytest
from processes import environment

from geo.workers import CallsAhead


def square(number):
    return number * number


def slow(number, seconds):
    time.sleep(seconds)
    return number


def refuse(number):
    if number == 1:
        msg = f"not {number}"
        raise ValueError(msg)
    return number


def die(number):
    if number == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def test_results_come_in_their_order_and_may_be_left_out():
    calls = CallsAhead(square, [(k,) for k in range(40)])
    try:
        assert [calls.result(k) for k in range(10)] == [k * k for k in range(10)]
        assert [calls.result(k) for k in (20, 21, 39)] == [400, 441, 1521]
    finally:
        calls.close()


def test_what_a_call_raises_is_raised_where_its_result_is_asked_for():
    calls = CallsAhead(refuse, [(0,), (1,), (2,)])
    try:
        assert calls.result(0) == 0
        with pytest.raises(ValueError, match="not 1"):
            calls.result(1)
        assert calls.result(2) == 2
    finally:
        calls.close()


def test_after_a_process_was_killed_nothing_more_comes():
    calls = CallsAhead(die, [(k,) for k in range(30)])
    try:
        for number in (1, 2, 29):
            with pytest.raises(BrokenProcessPool):
                calls.result(number)
    finally:
        calls.close()


@pytest.mark.filterwarnings("error::pytest.PytestUnhandledThreadExceptionWarning")
def test_it_is_given_up_while_calls_run_and_others_wait():
    calls = CallsAhead(slow, [(k, 0.0 if k == 0 else 600.0) for k in range(50)])
    assert calls.result(0) == 0
    calls.close()


def started(folder, script):
    (folder / "script.py").write_text(script)
    return subprocess.Popen(
        [sys.executable, "script.py"],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env=environment(PYTHONPATH=os.pathsep.join(sys.path)),
    )


SCRIPT = """
import sys, time
from geo.workers import CallsAhead

if __name__ == "__main__":
    calls = CallsAhead(time.sleep, [(600.0,)] * 50)
    try:
        print("begun", flush=True)
        calls.result(0)
    except KeyboardInterrupt:
        calls.close()
        sys.exit(7)
"""


def test_ctrl_c_ends_it_at_once_without_a_traceback(tmp_path):
    process = started(tmp_path, SCRIPT)
    assert process.stdout.readline() == "begun\n"
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=120)
    assert (process.returncode, out) == (7, "")
    # Seldom loky warns of a semaphore that it cleans up itself.
    assert "Traceback" not in err
    assert "Error" not in err.replace("FileNotFoundError", "")


KILLED = """
import os, sys, time
from geo.workers import CallsAhead

def tell(seconds):
    print(os.getpid(), flush=True)
    time.sleep(seconds)

if __name__ == "__main__":
    calls = CallsAhead(tell, [(600.0,)] * 4)
    calls.result(0)
"""


def test_processes_end_soon_after_one_that_was_killed(tmp_path):
    process = started(tmp_path, KILLED)
    worker = int(process.stdout.readline())
    os.kill(worker, 0)
    process.kill()
    # All processes hold an end of the pipe: it ends when they have ended.
    process.communicate(timeout=60)
