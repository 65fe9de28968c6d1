"""Benchmarks on a real Dask scheduler with workers in processes of their own."""

import contextlib
import importlib.util
import os
import signal
import socket
import subprocess
import sys
import time

import pytest
from bench_rows import decided
from processes import free_port

from wbf_mission.bench import engine
from wbf_mission.bench.benchmark import benchmark
from wbf_mission.bench.engine import ClusterError, fly_all
from wbf_mission.bench.provenance import program, unlike
from wbf_mission.bench.spec import BenchSpec
from wbf_mission.cli.app import main
from wbf_mission.own_code import own_choice

pytestmark = pytest.mark.skipif(importlib.util.find_spec("distributed") is None, reason="needs distributed")

TEN = ["WBF/Miniberry-10-v1"]


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


OWN = """
from dataclasses import dataclass
from mission.planners import make_planner
from mission.policies.decision import NO_CHANGE, Decision
from mission.policies.policy import Triggers
from sensors.estimators.point import PointEstimator

@dataclass
class Mine:
    share: float = 0.5
    triggers = Triggers(period_s=5.0)

    def start(self):
        pass

    def decide(self, observation):
        if observation.event.value == "start":
            return Decision({1: make_planner("spiral")(observation.vehicles[0].request).points_m})
        return NO_CHANGE

class Guess(PointEstimator):
    pass

def rows(request, *, direction=0.0):
    return make_planner("lawnmower", direction=direction)(request)
"""
SCRIPT = """
import sys
OWN
if __name__ == "__main__":
    from wbf_mission import BenchSpec, benchmark

    spec = BenchSpec.of(["WBF/Miniberry-10-v1"], [Mine(0.3), rows], [Guess()], seeds=2)
    flown = benchmark(spec, dask=sys.argv[1], jobs=2)
    assert [one.error for one in flown] == [None] * 4, flown
    print(len(flown))
"""


@pytest.mark.slow
def test_own_code_goes_to_workers_of_which_one_is_killed_and_one_comes_late(tmp_path):
    (tmp_path / "far_away.py").write_text(OWN)
    planners = [
        own_choice(f"{tmp_path / 'far_away.py'}:{one}", "planner") for one in ("rows", "Mine:share=0.2")
    ]
    guess = own_choice(f"{tmp_path / 'far_away.py'}:Guess", "estimator")
    spec = BenchSpec.of(TEN, planners, [guess], seeds=10)
    here = decided(benchmark(spec))
    assert {one["error"] for one in here} == {None}
    with scheduler() as (address, _):
        workers = [worker(address)]
        try:
            flying = fly_all(list(spec.runs()), dask=address)
            found = [next(flying) for _ in range(3)]
            workers.append(worker(address))
            found += [next(flying) for _ in range(3)]
            end(workers[0])
            found += flying
        finally:
            for one in workers:
                end(one)
    assert decided(found) == here


@pytest.mark.slow
@pytest.mark.parametrize("how", ["script", "stdin"])
def test_what_a_script_or_a_notebook_defines_goes_to_workers(tmp_path, how):
    text = SCRIPT.replace("OWN", OWN)
    (tmp_path / "script.py").write_text(text)
    with scheduler() as (address, _):
        one = worker(address)
        try:
            done = subprocess.run(
                [sys.executable, "script.py" if how == "script" else "-", address],
                input=text,
                capture_output=True,
                text=True,
                cwd=tmp_path,
                timeout=240.0,
                env={**os.environ, "PYTHONPATH": os.pathsep.join(one for one in sys.path if one)},
            )
        finally:
            end(one)
    assert (done.stdout.strip(), done.returncode) == ("4", 0), done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("what", ["code of wbf-mission", "C library"])
def test_a_worker_with_another_program_is_refused(what, monkeypatch):
    monkeypatch.setattr(engine, "program", lambda: {**program(), what: "another"})
    runs = list(BenchSpec.of(TEN, planners=["spiral"], estimators=["point"], seeds=1).runs())
    with pytest.raises(
        ClusterError, match=f"a worker cannot fly: it has {what} .* in place of another; inst"
    ):
        list(fly_all(runs, jobs=1, dask="local"))


def test_what_differs_between_programs_is_told():
    assert not unlike(program())
    other = {**program(), "numpy": "1.0", "code of wbf-mission": "0"}
    assert unlike(other).count("in place of") == 2
    assert unlike({**other, "wbf-mission": "0.0"}).count("in place of") == 2  # The sources follow the version
    assert "in place of 0" in unlike({**program(), "code of wbf-mission": "0"})
    assert "numba" in unlike({key: one for key, one in program().items() if key != "numba"})


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
            with pytest.raises(
                ClusterError, match="the scheduler is lost; repeat the command to fly the missing runs"
            ):
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
    assert "no scheduler answers at this address" in err
    assert err.count("\n") == 1
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert main(["bench", "run", *arguments]) == 2
    assert 'pip install "wbf-mission[dask]"' in capsys.readouterr().err
