"""What each operating system does in its own way, here on Linux and where parts of it are hidden."""

import errno
import multiprocessing
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import psutil
import pytest

from geo.atomic import lock_file, made_by_one
from geo.errors import WbfMissionError
from geo.system import (
    AvailableMemory,
    NotEnoughMemoryError,
    allow_open_files,
    available_memory,
    free_unused_memory,
    in_parallel,
    memory_bounded,
    process_age_s,
    require_memory,
    steady_s,
    use_memory_again,
)


def test_the_steady_clock_runs_during_sleep(monkeypatch):
    assert steady_s() == pytest.approx(time.clock_gettime(time.CLOCK_BOOTTIME), abs=1.0)
    monkeypatch.setattr(sys, "platform", "darwin")
    assert steady_s() == pytest.approx(time.clock_gettime(time.CLOCK_MONOTONIC), abs=1.0)
    monkeypatch.setattr(sys, "platform", "win32")
    assert steady_s() == pytest.approx(time.monotonic(), abs=1.0)


def test_the_age_of_a_process_counts_from_its_start():
    code = (
        "import time; from geo.system import process_age_s; time.sleep(0.3); own = process_age_s(); "
        "import sys; sys.platform = 'win32'; print(own, process_age_s())"
    )
    begin = time.monotonic()
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stdout
    age_s, rounded_s = map(float, told.split())
    assert 0.3 < age_s < time.monotonic() - begin + 1.0
    # Outside of Linux it is psutil's start, which is exact to a second only.
    assert abs(rounded_s - age_s) < 2.0


def test_the_age_of_a_process_where_its_start_is_hidden(monkeypatch):
    monkeypatch.delattr(Path, "read_text")
    assert 0.0 <= process_age_s() < 3600.0


def test_the_limit_of_open_files_is_raised_and_never_lowered(monkeypatch):
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
def test_memory_is_used_again_where_the_c_library_can(platform, monkeypatch):
    calls = []

    class Library:
        def __init__(self, name):
            assert name is None

        def mallopt(self, parameter, value):
            calls.append((parameter, value))
            return 1

    monkeypatch.setattr(sys, "platform", platform)
    monkeypatch.setattr("ctypes.CDLL", Library)
    use_memory_again()
    free_unused_memory()  # A library without malloc_trim
    arenas, mapped_bytes, trim_bytes = (-8, 2), (-3, 32 * 2**20), (-1, 2**31 - 1)  # malloc.h
    assert calls == ([arenas, mapped_bytes, trim_bytes] if platform == "linux" else [])


@pytest.mark.skipif(sys.platform != "linux", reason="Linux frees memory on request")
def test_memory_in_use_again_is_freed_on_request():
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


def test_a_forked_process_does_not_keep_the_lock(tmp_path):
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


def test_a_cache_on_a_disk_without_locks_is_made(tmp_path, monkeypatch):
    def fails(descriptor, operation):
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


# Foresight of memory: the least of all limits counts, and the error says what would be needed

GB = 10**9


@pytest.fixture
def machine(monkeypatch):
    """A machine with 16 GB free."""
    monkeypatch.setattr(psutil, "virtual_memory", lambda: SimpleNamespace(available=16 * GB))


def system(root, *, groups="", files=None):
    """Write the files of control groups as a Linux kernel does."""
    for name, text in {"proc/self/cgroup": groups, **(files or {})}.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(str(text))
    return root


@pytest.mark.usefixtures("machine")
@pytest.mark.parametrize("at", ["sys/fs/cgroup/a/b", "sys/fs/cgroup/a", "sys/fs/cgroup"])
def test_the_limit_of_any_unified_group_above_counts(tmp_path, at):
    files = {
        f"{at}/memory.max": 4 * GB,
        f"{at}/memory.current": 3 * GB,
        f"{at}/memory.stat": f"anon {2 * GB}\ninactive_file {GB}\n",
        "sys/fs/cgroup/a/b/c/memory.max": "max",
        "sys/fs/cgroup/a/b/c/memory.current": 5,
    }
    found = available_memory(system(tmp_path, groups="0::/a/b/c\n", files=files))
    assert found == AvailableMemory(2 * GB, "control group limit 4.0 GB")


@pytest.mark.usefixtures("machine")
def test_the_older_groups_count_and_no_limit_is_none(tmp_path):
    group = "sys/fs/cgroup/memory/x"
    files = {
        f"{group}/memory.limit_in_bytes": 2 * GB,
        f"{group}/memory.usage_in_bytes": 3 * GB,
        "sys/fs/cgroup/memory/memory.limit_in_bytes": 9223372036854771712,
        "sys/fs/cgroup/memory/memory.usage_in_bytes": 1,
    }
    groups = "5:cpu,cpuacct:/x\n4:memory:/x\n0::/\n"
    found = available_memory(system(tmp_path, groups=groups, files=files))
    assert found == AvailableMemory(0, "control group limit 2.0 GB")


def test_a_system_that_tells_nothing_forbids_nothing(tmp_path, monkeypatch):
    def unreadable():
        raise FileNotFoundError("/proc/meminfo")

    monkeypatch.setattr(psutil, "virtual_memory", unreadable)
    monkeypatch.setattr(psutil, "Process", lambda: unreadable())
    assert available_memory(tmp_path) is None
    monkeypatch.setattr("geo.system.available_memory", lambda: None)
    require_memory("a run", {"b": 10**30})
    with memory_bounded(1):
        assert len(bytes(2**28)) == 2**28


def test_the_error_is_one_line_with_sum_parts_and_limit():
    little = AvailableMemory(GB, "control group limit 2.0 GB")
    with pytest.raises(NotEnoughMemoryError) as caught:
        require_memory("a run", {"small": 10**6, "b": 2 * GB, "c": 9 * GB}, available=little)
    assert str(caught.value) == (
        "a run needs 11.0 GB of memory (c 9.0 GB, b 2.0 GB), but 1.0 GB are free (control group limit 2.0 GB)"
    )
    assert isinstance(caught.value, WbfMissionError)
    assert isinstance(caught.value, MemoryError)
    require_memory("a run", {"b": GB}, available=little)


def test_the_limit_of_the_address_space_counts():
    code = (
        "import resource; resource.setrlimit(resource.RLIMIT_AS, (10**9, 10**9)); "
        "from geo.system import available_memory as a; print(a().limited_by, a().bytes < 10**9)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout == "address space limit 1.0 GB True\n"


def test_memory_is_bounded_for_a_while():
    before = resource.getrlimit(resource.RLIMIT_AS)
    with memory_bounded(2**28):
        assert np.ones(2**20).sum() == 2**20
        # A wider bound inside it changes nothing.
        with memory_bounded(2**40), pytest.raises(MemoryError):
            np.ones(2**27)
    assert resource.getrlimit(resource.RLIMIT_AS) == before
    assert np.empty(2**27).nbytes == 2**30
