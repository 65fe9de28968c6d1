"""Processes of our own, and Ctrl-C."""

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures.process import BrokenProcessPool
from types import SimpleNamespace

import processes
import pytest
from processes import environment

from geo.processes import INTERRUPTS, CallsAhead, ignore_interrupts, interrupts_held, interrupts_noted


@pytest.fixture(autouse=True)
def handler():
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def clock(monkeypatch):
    """What time it is for repeated signals: seconds, in a list of one."""
    now_s = [100.0]
    monkeypatch.setattr("geo.processes.time", SimpleNamespace(monotonic=lambda: now_s[0]))
    return now_s


def test_ctrl_c_is_held_back_where_another_thread_gets_it():
    ended = threading.Event()
    thread = threading.Thread(target=ended.wait)
    thread.start()
    done = []
    try:
        with pytest.raises(KeyboardInterrupt), interrupts_held():
            signal.pthread_kill(thread.ident, signal.SIGINT)
            time.sleep(0.05)
            done.append("all of it")
        assert done == ["all of it"]
    finally:
        ended.set()
        thread.join()


def test_what_was_held_back_before_stays_so():
    with interrupts_held():
        with interrupts_held():
            pass
        assert signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ())
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


def test_a_process_that_starts_meanwhile_survives_ctrl_c():
    with interrupts_held():
        child = subprocess.Popen(
            [sys.executable, "-c", "import sys; print('here', flush=True); sys.stdin.read(); print('there')"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
    assert child.stdout.readline() == "here\n"
    child.send_signal(signal.SIGINT)
    assert child.communicate(timeout=60)[0] == "there\n"
    assert child.returncode == 0


def test_a_worker_leaves_all_of_them_to_its_parent():
    before = {number: signal.getsignal(number) for number in INTERRUPTS}
    try:
        ignore_interrupts()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            os.kill(os.getpid(), number)
    finally:
        for number, old in before.items():
            signal.signal(number, old)


def test_an_interrupt_that_would_be_lost_is_raised_where_it_is_asked_for():
    done = []
    with pytest.raises(KeyboardInterrupt), interrupts_noted() as answer:
        answer()
        os.kill(os.getpid(), signal.SIGINT)
        done.append("the slice")
        answer()
        done.append("not this")  # pragma: no cover
    assert done == ["the slice"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_what_nobody_asked_for_is_raised_at_the_end_and_wakes():
    woken = []
    with pytest.raises(KeyboardInterrupt), interrupts_noted(lambda: woken.append(1)):
        os.kill(os.getpid(), signal.SIGINT)
        woken.append("behind it")
    assert woken == [1, "behind it"]


@pytest.mark.parametrize("apart_s", [1.0, 20.0])
def test_the_second_one_is_raised_at_once(clock, apart_s):
    done = []
    with pytest.raises(KeyboardInterrupt), interrupts_noted():
        os.kill(os.getpid(), signal.SIGINT)
        done.append("first")
        clock[0] += apart_s
        os.kill(os.getpid(), signal.SIGINT)
        done.append("second")  # pragma: no cover
    assert done == ["first"]


@pytest.mark.parametrize("at_once", [False, True])
def test_what_comes_within_a_second_repeats_the_first(clock, at_once):
    done = []
    with pytest.raises(KeyboardInterrupt), interrupts_noted(at_once=at_once):
        with contextlib.nullcontext() if not at_once else contextlib.suppress(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
        for _ in range(3):
            clock[0] += 0.3
            os.kill(os.getpid(), signal.SIGINT)
        done.append("all of it")
    assert done == ["all of it"]


def test_the_first_one_can_be_raised_at_once():
    done = []
    with pytest.raises(KeyboardInterrupt), interrupts_noted(at_once=True):
        os.kill(os.getpid(), signal.SIGINT)
        done.append("not this")  # pragma: no cover
    assert done == []


@pytest.mark.parametrize("at_once", [False, True])
def test_what_is_raised_at_once_is_raised_again_where_it_was_lost(clock, at_once):
    done = []
    with pytest.raises(KeyboardInterrupt), interrupts_noted(at_once=at_once) as answer:
        if not at_once:
            os.kill(os.getpid(), signal.SIGINT)  # only noted: the second one is raised
            clock[0] += 2.0
        # As compiled code may do that asks for an attribute.
        with contextlib.suppress(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
        done.append("lost")
        answer()
        done.append("not this")  # pragma: no cover
    assert done == ["lost"]


def test_a_handler_that_raises_nothing_is_asked_and_nothing_else_happens():
    came = []
    signal.signal(signal.SIGINT, lambda number, _frame: came.append(number))
    with interrupts_noted() as answer:
        os.kill(os.getpid(), signal.SIGINT)
        answer()
    assert came == [signal.SIGINT]


def test_another_thread_has_no_signals():
    ended = []

    def work():
        with interrupts_noted() as answer:
            answer()
        ended.append(True)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert ended == [True]


def refuse(number):
    if number == 1:
        msg = f"not {number}"
        raise ValueError(msg)
    return number


def die(number):
    if number == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def test_results_come_in_their_order_may_be_left_out_and_raise_what_the_call_raised():
    calls = CallsAhead(refuse, [(k,) for k in range(40)], 1)
    try:
        assert calls.result(0) == 0
        with pytest.raises(ValueError, match="not 1"):
            calls.result(1)
        assert [calls.result(k) for k in (2, 3, 20, 21, 39)] == [2, 3, 20, 21, 39]
    finally:
        calls.close()


def test_after_a_process_was_killed_nothing_more_comes():
    calls = CallsAhead(die, [(k,) for k in range(30)], 1)
    try:
        for number in (1, 2, 29):
            with pytest.raises(BrokenProcessPool):
                calls.result(number)
    finally:
        calls.close()


def started(folder, script):
    (folder / "script.py").write_text(script)
    own = environment(PYTHONPATH=os.pathsep.join(sys.path))
    return processes.started([sys.executable, "script.py"], cwd=folder, env=own)


SCRIPT = """
import sys, time
from geo.processes import CallsAhead

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


LOCKED = """
from geo.processes import CallsAhead

if __name__ == "__main__":
    calls = CallsAhead(exec, [("import multiprocessing as m; m.kept = m.Lock()",)], 1)
    calls.result(0)
    calls.close()
"""


def test_processes_that_have_finished_their_calls_leave_no_locks_behind(tmp_path):
    process = started(tmp_path, LOCKED)
    assert process.communicate(timeout=120) == ("", "")
    assert process.returncode == 0


STOPPED = """
from geo.processes import CallsAhead

KEEP = "import multiprocessing as m, time; m.kept = m.Lock(); print('kept', flush=True); time.sleep(600)"
if __name__ == "__main__":
    calls = CallsAhead(exec, [(KEEP,)], 1)
    try:
        calls.result(0)
    except KeyboardInterrupt:
        calls.close()
"""


def test_a_process_that_is_stopped_in_its_call_leaves_no_locks_behind(tmp_path):
    process = started(tmp_path, STOPPED)
    assert process.stdout.readline() == "kept\n"
    os.killpg(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=120)
    assert process.returncode == 0 and "leaked semaphore" not in err


KILLED = """
import os, sys, time
from geo.processes import CallsAhead

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
    # All processes hold an end of the pipe: it ends when they have ended, before their calls are over.
    process.communicate(timeout=300)
