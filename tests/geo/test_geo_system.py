"""What each operating system does in its own way, here on Linux and where parts of it are hidden."""

import errno
import gc
import multiprocessing
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from geo.atomic import lock_file, made_by_one
from geo.system import (
    allow_open_files,
    free_unused_memory,
    in_parallel,
    process_age_s,
    steady_s,
    use_memory_again,
)


def test_the_steady_clock_runs_during_sleep(monkeypatch: pytest.MonkeyPatch) -> None:
    assert steady_s() == pytest.approx(time.clock_gettime(time.CLOCK_BOOTTIME), abs=1.0)
    monkeypatch.setattr(sys, "platform", "darwin")
    assert steady_s() == pytest.approx(time.clock_gettime(time.CLOCK_MONOTONIC), abs=1.0)
    monkeypatch.setattr(sys, "platform", "win32")
    assert steady_s() == pytest.approx(time.monotonic(), abs=1.0)


# On Linux psutil's start is exact to a second only.
@pytest.mark.parametrize(("platform", "waited_s", "least_s"), [("linux", 0.3, 0.3), ("win32", 1.5, 0.5)])
def test_the_age_of_a_process_counts_from_its_start(platform: str, waited_s: float, least_s: float) -> None:
    unused = "psutil.Process" if platform == "linux" else "pathlib.Path.read_text"
    code = (
        "import pathlib, psutil, sys, time; from geo.system import process_age_s; "
        f"{unused} = None; sys.platform = {platform!r}; time.sleep({waited_s}); print(process_age_s())"
    )
    begin = time.monotonic()
    age_s = float(subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stdout)
    assert least_s < age_s < time.monotonic() - begin + 1.0


def test_the_age_of_a_process_where_its_start_is_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    def hidden(path: Path, **_: object) -> str:
        raise FileNotFoundError(path)

    monkeypatch.setattr(Path, "read_text", hidden)
    assert 0.0 <= process_age_s() < 3600.0


def test_the_limit_of_open_files_is_raised_and_never_lowered(monkeypatch: pytest.MonkeyPatch) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (200, hard))
        allow_open_files(300)
        assert resource.getrlimit(resource.RLIMIT_NOFILE)[0] == 300
        allow_open_files(250)
        assert resource.getrlimit(resource.RLIMIT_NOFILE)[0] == 300
        monkeypatch.setitem(sys.modules, "resource", None)
        allow_open_files(400)
        assert resource.getrlimit(resource.RLIMIT_NOFILE)[0] == 300
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


@pytest.mark.parametrize("platform", ["linux", "darwin"])
def test_memory_is_used_again_where_the_c_library_can(platform: str, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []

    class Library:
        def __init__(self, name: str | None) -> None:
            assert name is None

        def mallopt(self, parameter: int, value: int) -> int:
            calls.append((parameter, value))
            return 1

    monkeypatch.setattr(sys, "platform", platform)
    monkeypatch.setattr("ctypes.CDLL", Library)
    threshold = gc.get_threshold()
    try:
        use_memory_again()
        free_unused_memory()  # A library without malloc_trim
        assert gc.get_threshold()[0] > threshold[0]
    finally:
        gc.set_threshold(*threshold)
    arenas, mapped_bytes, trim_bytes = (-8, 2), (-3, 32 * 2**20), (-1, 2**31 - 1)  # malloc.h
    assert calls == ([arenas, mapped_bytes, trim_bytes] if platform == "linux" else [])


@pytest.mark.skipif(sys.platform != "linux", reason="Linux frees memory on request")
def test_memory_in_use_again_is_freed_on_request() -> None:
    code = """
import resource
from pathlib import Path
from geo.system import free_unused_memory, use_memory_again

def in_use():
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()

use_memory_again()
blocks = [bytearray(16_000_000) for _ in range(8)]
del blocks
kept = in_use()
free_unused_memory()
print(kept - in_use())
"""
    freed = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stdout
    assert int(freed) > 100_000_000


def test_a_forked_process_does_not_keep_the_lock(tmp_path: Path) -> None:
    with made_by_one(tmp_path / "made"):
        child = os.fork()
        if child == 0:
            time.sleep(60.0)
            os._exit(0)
    try:
        with (tmp_path / "made.lock").open("ab") as lock:
            assert lock_file(lock.fileno(), wait=False)
    finally:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)


def test_a_cache_on_a_disk_without_locks_is_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(descriptor: int, operation: int) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr("fcntl.flock", fails)
    with made_by_one(tmp_path / "made"):
        (tmp_path / "made").touch()
    assert (tmp_path / "made").exists()


def test_an_error_in_a_thread_is_raised_when_no_thread_works_any_more():
    begun, done = [], []

    def work(part):
        begun.append(part)
        time.sleep(0.02)
        done.append(part)
        if 3 in part:
            raise ValueError("part of 3")

    with pytest.raises(ValueError, match="part of 3"):
        in_parallel(work, range(64))
    assert begun and sorted(begun, key=min) == sorted(done, key=min)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_forked_process_has_threads_of_its_own():
    def add():
        sums = []
        in_parallel(lambda part: sums.append(sum(part)), range(100))
        sys.exit(0 if sum(sums) == 4950 else 1)

    in_parallel(len, range(100))
    child = multiprocessing.get_context("fork").Process(target=add)
    child.start()
    child.join(30)
    child.kill()
    assert child.exitcode == 0
