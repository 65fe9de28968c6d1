"""Foresight of memory: the least of all limits counts, and the error says what would be needed."""

import resource
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import psutil
import pytest

from geo.errors import WbfMissionError
from geo.system import AvailableMemory, NotEnoughMemoryError, available_memory, memory_bounded, require_memory

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
def test_the_machines_free_memory_counts(tmp_path):
    assert available_memory(tmp_path) == AvailableMemory(16 * GB, "memory of the machine")


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
