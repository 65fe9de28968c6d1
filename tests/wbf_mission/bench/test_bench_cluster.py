"""Benchmarks on a real Dask scheduler with workers in processes of their own."""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import time

import pytest

from wbf_mission.bench.benchmark import benchmark
from wbf_mission.bench.cluster import ClusterError
from wbf_mission.bench.engine import fly_all
from wbf_mission.bench.spec import BenchSpec
from wbf_mission.cli.app import main

pytest.importorskip("distributed")

TEN = ["WBF/Miniberry-10-v1"]
COSTS = ("wall_time_s", "cpu_time_s", "timings_s")


def decided(rows):
    """What the runs alone decide."""
    plain = {one.key: [(name, getattr(one, name)) for name in one.__struct_fields__] for one in rows}
    return {key: [pair for pair in pairs if pair[0] not in COSTS] for key, pairs in plain.items()}


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def start(kind, *arguments):
    common = ["--host", "127.0.0.1", "--no-dashboard"]
    return subprocess.Popen(
        [sys.executable, "-m", f"distributed.cli.dask_{kind}", *arguments, *common],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(one for one in sys.path if one)},
    )


@contextlib.contextmanager
def scheduler():
    port = free_port()
    process = start("scheduler", "--port", str(port))
    try:
        end_s = time.monotonic() + 120.0
        while True:
            with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), 1.0):
                break
            assert process.poll() is None
            assert time.monotonic() < end_s
            time.sleep(0.1)
        yield f"tcp://127.0.0.1:{port}", process
    finally:
        end(process)


def worker(address, threads=1):
    return start("worker", address, "--nthreads", str(threads), "--nworkers", "1")


def end(process):
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


@pytest.mark.slow
def test_two_workers_one_of_them_killed_in_the_middle():
    spec = BenchSpec.of(TEN, planners=["lawnmower", "spiral"], estimators=["point"], seeds=15)
    here = decided(benchmark(spec))
    with scheduler() as (address, _):
        workers = [worker(address), worker(address)]
        try:
            rows = fly_all(list(spec.runs()), dask=address)
            found = [next(rows) for _ in range(4)]
            end(workers[0])
            found += rows
        finally:
            for one in workers:
                end(one)
    assert len(found) == 30
    assert decided(found) == here


@pytest.mark.slow
def test_a_scheduler_that_dies_ends_the_benchmark_which_can_be_gone_on_with(tmp_path):
    spec = BenchSpec.of(TEN, planners=["lawnmower"], estimators=["point"], seeds=200)
    with scheduler() as (address, process):
        one = worker(address)
        killed = []

        def told(_what, done, _total):
            if done == 3:
                end(process)
                killed.append(done)

        try:
            with pytest.raises(ClusterError, match="the scheduler is lost; the same command goes on"):
                benchmark(spec, out=tmp_path, dask=address, progress=told)
        finally:
            end(one)
    assert killed
    short = BenchSpec.of(TEN, planners=["lawnmower"], estimators=["point"], seeds=3)
    flown = []
    benchmark(short, out=tmp_path, progress=lambda *given: flown.append(given))
    assert len(flown) <= 1  # of the first three at most one was still open


@pytest.mark.slow
def test_a_worker_with_several_threads_is_refused():
    with scheduler() as (address, _):
        one = worker(address, threads=2)
        try:
            with pytest.raises(ClusterError, match="has 2 threads; start it with --nthreads 1"):
                next(fly_all(list(BenchSpec.of(TEN, seeds=1).runs()), dask=address))
        finally:
            end(one)


@pytest.mark.slow
def test_a_cluster_of_this_machine_gives_the_same(tmp_path):
    spec = BenchSpec.of(TEN, planners=["lawnmower"], estimators=["point"], seeds=3)
    assert decided(fly_all(list(spec.runs()), jobs=2, dask="local")) == decided(benchmark(spec))


def test_no_scheduler_is_one_line(tmp_path, capsys, monkeypatch):
    import dask

    arguments = [
        "--scenarios",
        TEN[0],
        "--out",
        str(tmp_path / "b"),
        "--dask",
        f"tcp://127.0.0.1:{free_port()}",
    ]
    with dask.config.set({"distributed.comm.timeouts.connect": "0.5s"}):
        assert main(["bench", "run", *arguments]) == 2
    err = capsys.readouterr().err
    assert "no scheduler answers there" in err
    assert err.count("\n") == 1
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert main(["bench", "run", *arguments]) == 2
    assert "pip install 'wbf-mission[dask]'" in capsys.readouterr().err
