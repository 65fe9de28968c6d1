"""What each operating system does in its own way, here on Linux and where parts of it are hidden."""

import errno
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from geo.atomic import lock_file, made_by_one
from geo.system import allow_open_files, process_age_s, steady_s


def test_the_steady_clock_runs_during_sleep(monkeypatch: pytest.MonkeyPatch) -> None:
    assert steady_s() == pytest.approx(time.clock_gettime(time.CLOCK_BOOTTIME), abs=1.0)
    monkeypatch.setattr(sys, "platform", "darwin")
    assert steady_s() == pytest.approx(time.clock_gettime(time.CLOCK_MONOTONIC), abs=1.0)
    monkeypatch.setattr(sys, "platform", "win32")
    assert steady_s() == pytest.approx(time.monotonic(), abs=1.0)


@pytest.mark.parametrize("platform", ["linux", "win32"])
def test_the_age_of_a_process_counts_from_its_start(platform: str) -> None:
    unused = "psutil.Process" if platform == "linux" else "pathlib.Path.read_text"
    code = (
        "import pathlib, psutil, sys, time; from geo.system import process_age_s; "
        f"{unused} = None; sys.platform = {platform!r}; time.sleep(1.5); print(process_age_s())"
    )
    begin = time.monotonic()
    age_s = float(subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stdout)
    # On Linux psutil's start is exact to a second only.
    assert (1.5 if platform == "linux" else 0.5) < age_s < time.monotonic() - begin + 1.0


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


_ARRAYS_IN_THREADS = """
import gc, resource, sys, threading
from geo.system import free_unused_memory, use_memory_again

if sys.argv[1] == "again":
    use_memory_again()

def work():
    for _ in range(20):
        bytearray(16_000_000)

for _ in range(4):
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
free_unused_memory()
kib = next(line.split()[1] for line in open("/proc/self/status") if line.startswith("RssAnon"))
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt, kib, gc.get_threshold()[0])
"""


def test_memory_is_used_again_and_can_still_be_freed() -> None:
    found = {}
    for way in ("anew", "again"):
        call = [sys.executable, "-c", _ARRAYS_IN_THREADS, way]
        found[way] = list(map(int, subprocess.run(call, capture_output=True, check=True).stdout.split()))
    array_pages = 16_000_000 // os.sysconf("SC_PAGE_SIZE")
    assert found["again"][0] < found["anew"][0] - array_pages / 2  # Page faults
    assert found["again"][1] < found["anew"][1] + 4_000  # KiB left
    assert found["again"][2] > found["anew"][2]


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
