"""Many runs: kept, gone on with, the same by any number of processes."""

import json
import os
import signal
import sys
import threading
import time

import msgspec
import processes
import pytest
from bench_rows import decided
from processes import command

from mission.planners import planner_names
from sensors.estimators.point import PointEstimator
from wbf_mission import Decision, Triggers, benchmark
from wbf_mission.bench import engine
from wbf_mission.bench.benchmark import BenchmarkInterrupted
from wbf_mission.bench.engine import fly_all, fly_run
from wbf_mission.bench.provenance import hardware
from wbf_mission.bench.rows import BenchStore, read_rows
from wbf_mission.bench.spec import BenchSpec
from wbf_mission.cli.app import main

TEN = ["WBF/Miniberry-10-v1"]


@pytest.fixture(scope="module")
def spec():
    return BenchSpec.of(
        scenarios=TEN, planners=["spiral", "lawnmower"], estimators=["point", "adaptive-disk"], seeds=2
    )


@pytest.fixture(scope="module")
def rows(spec):
    return benchmark(spec)


def test_a_row_has_what_the_run_gave(rows):
    assert len(rows) == 8
    one = rows[0]
    assert (one.error, one.outcome) == (None, "completed")
    assert set(one.losses) == set(one.history) == {"tylcv", "ccr", "soil"}
    assert one.score == pytest.approx(sum(one.scores) / len(one.scores))
    assert one.final_score == one.scores[-1]
    assert len(one.times_s) == len(one.scores) == len(one.history["soil"])
    assert one.losses["soil"] == one.history["soil"][-1]
    assert (one.observations, one.decisions) == (33, 1)
    assert one.cpu_time_s > 0.0
    assert set(one.versions) >= {"wbf-mission", "python", "numpy"}
    assert one.hardware == hardware() and {"processor", "cores", "system"} <= set(one.hardware)
    assert one.objects == {}
    assert set(one.codes) == {"code", "scenario"}


@pytest.mark.parametrize(
    ("budget", "told", "error"), [("40steps", "40 steps", 0.05), ("1min", "60 s", 0.1), ("60m", "60 m", None)]
)
def test_a_policy_is_held_to_the_last_paths_that_it_chose(tmp_path, budget, told, error):
    vehicle = "ideal" if "steps" in budget else "quad"
    file = tmp_path / "own.toml"
    file.write_text(f'farm = "miniberry-10"\nvehicle = "{vehicle}"\nbudget = "{budget}"\n')
    (row,) = benchmark(BenchSpec.of([file], planners=["greedy"], estimators=["point"], seeds=1))
    assert (row.error, row.budget) == (None, told)
    assert (row.battery_used is None) == (vehicle == "ideal")
    if error is None:
        assert row.predicted_time_s is None  # metres are no time
    else:
        assert row.predicted_time_s == pytest.approx(row.flight_time_s, rel=error)


def test_processes_change_nothing_and_runs_that_cannot_be_flown_there_are_rows_that_say_so(spec, rows):
    class Locked(PointEstimator):
        def __init__(self):
            self.lock = threading.Lock()

    class Deadly(PointEstimator):
        def _learn(self, observations):
            os.kill(os.getpid(), signal.SIGKILL)

    class Faulty(PointEstimator):
        def _learn(self, observations):
            raise KeyError("humidity")

    bad = BenchSpec.of(scenarios=TEN, planners=["spiral"], estimators=[Deadly(), Locked(), Faulty()], seeds=1)
    found = list(fly_all([*bad.runs(), *spec.runs()], jobs=2))
    errors = {row.estimator: row.error for row in found if row.estimator in ("Deadly", "Locked", "Faulty")}
    line = Faulty._learn.__code__.co_firstlineno + 1
    assert errors["Faulty"].endswith(f"KeyError: 'humidity' (test_bench_benchmark.py, line {line})")
    assert errors["Locked"].startswith("a planner, policy or estimator cannot be sent to another process")
    assert "was killed" in errors["Deadly"]
    assert decided(row for row in found if row.estimator not in errors) == decided(rows)


def test_what_is_kept_is_not_flown_again(spec, rows, tmp_path, monkeypatch):
    part = BenchSpec.of(scenarios=TEN, planners=["spiral"], estimators=["point"], seeds=2)
    assert decided(benchmark(part, out=tmp_path)) == decided(
        [one for one in rows if (one.planner, one.estimator) == ("spiral", "point")]
    )
    flown = []

    def counted(run):
        flown.append(run.key)
        return fly_run(run)

    monkeypatch.setattr(engine, "fly_run", counted)
    told = []
    found = benchmark(spec, out=tmp_path, progress=lambda what, done, total: told.append((what, done, total)))
    assert decided(found) == decided(rows)
    assert (len(flown), told[-1]) == (6, ("flying", 8, 8))
    assert benchmark(spec, out=tmp_path) == found
    assert len(flown) == 6


def test_a_run_that_fails_is_kept_with_the_cause_and_the_others_go_on(tmp_path, monkeypatch):
    class Broken(PointEstimator):
        def _estimate(self):
            return 1 / 0

    mixed = BenchSpec.of(scenarios=TEN, planners=["spiral"], estimators=["point", Broken()], seeds=2)
    found = benchmark(mixed, out=tmp_path)
    errors = {one.estimator: one.error for one in found}
    assert errors["point"] is None
    assert "division by zero" in errors["Broken"]
    flown = []
    monkeypatch.setattr(engine, "fly_run", lambda run: flown.append(run.estimator) or fly_run(run))
    benchmark(mixed, out=tmp_path)
    assert flown == []
    benchmark(mixed, out=tmp_path, retry=True)
    assert flown == ["Broken", "Broken"]


def test_a_run_does_not_see_what_those_before_it_left(tmp_path):
    class Counting(PointEstimator):
        count = 0

        def _learn(self, observations):
            self.count += 1
            assert self.count < 100
            super()._learn(observations)

    made = Counting()
    spec = BenchSpec.of(scenarios=TEN, planners=["spiral"], estimators=[made], seeds=4)
    keys = [one.key for one in spec.runs()]
    assert [one.error for one in benchmark(spec, out=tmp_path)] == [None] * 4
    assert made.count == 0
    assert [one.key for one in spec.runs()] == keys


def test_rows_of_other_code_are_kept_apart_with_a_word(tmp_path, monkeypatch, capsys):
    spec = BenchSpec.of(scenarios=TEN, planners=["spiral"], estimators=["point"], seeds=2)
    old = [msgspec.structs.replace(one, key=f"old{one.seed}", codes={}) for one in benchmark(spec)]
    with BenchStore(tmp_path) as store:
        for one in old:
            store.add(one)
    with pytest.warns(
        UserWarning, match="2 rows with the names of these runs are kept, but do not count here"
    ):
        assert len(benchmark(spec, out=tmp_path)) == 2
    monkeypatch.setattr("wbf_mission.bench.spec.behaviour", lambda: "1.2.3")
    with pytest.warns(UserWarning, match="4 rows with the names of these runs"):
        again = benchmark(spec, out=tmp_path)
    assert {one.codes["code"] for one in again} == {"1.2.3"}
    assert main(["bench", "report", str(tmp_path), "--json", "--out", str(tmp_path / "report")]) == 0
    told = capsys.readouterr()
    assert [one["environments"] for one in json.loads(told.out)["standings"]] == [2, 2, 2]
    assert "warning: rows of 3 versions" in told.err and "of 3 behaviours" in told.err


def test_ctrl_c_gives_what_is_done(spec, tmp_path, monkeypatch):
    count = []

    def flown(run):
        count.append(run)
        if len(count) == 4:
            raise KeyboardInterrupt
        return fly_run(run)

    monkeypatch.setattr(engine, "fly_run", flown)
    with pytest.raises(BenchmarkInterrupted) as stop:
        benchmark(spec, out=tmp_path)
    assert (len(stop.value.rows), stop.value.total) == (3, 8)
    assert len(read_rows(tmp_path)) == 3


def started(folder, *more):
    arguments = ["bench", "run", "--scenarios", TEN[0], "--planners", "lawnmower", "--estimators", "point"]
    arguments += ["--seeds", "3000", "--out", str(folder), "--json", *more]
    process = processes.started(command(*arguments))
    while process.poll() is None and not (
        (folder / "journal.jsonl").exists() and (folder / "journal.jsonl").read_bytes().count(b"\n") >= 2
    ):
        time.sleep(0.05)
    assert process.poll() is None, process.communicate()
    return process


def test_a_signal_keeps_what_is_finished(tmp_path):
    process = started(tmp_path / "b", "--jobs", "2")
    os.killpg(process.pid, signal.SIGINT)  # a terminal sends it to the workers as well
    out, err = process.communicate(timeout=120)
    assert process.returncode == 130
    (row,) = json.loads(out)["standings"]
    assert 2 <= row["environments"] < 3000
    assert len(read_rows(tmp_path / "b")) == row["environments"]
    assert f"after {row['environments']} of 3000 runs; the same command flies the remaining runs" in err
    assert "Traceback" not in err


def test_the_commands_print_tables(tmp_path, capsys):
    benchmark(BenchSpec.of(scenarios=TEN, planners=["spiral"], estimators=["point"], seeds=2), out=tmp_path)
    assert main(["bench", "report", str(tmp_path), "--out", str(tmp_path / "report")]) == 0
    text = capsys.readouterr().out
    assert TEN[0] in text and "spiral" in text
    assert (tmp_path / "report" / "report.html").is_file()
    for folder in (tmp_path / "no", tmp_path / "rows.parquet"):
        assert main(["bench", "report", str(folder)]) == 2
        assert f"{folder}: holds no results of a benchmark" in capsys.readouterr().err
    assert main(["bench", "run", "--out", str(tmp_path / "x"), "--jobs", "0"]) == 2
    assert "--jobs 0 runs nothing" in capsys.readouterr().err
    assert not (tmp_path / "x").exists()


def test_a_benchmark_with_failures_says_so(tmp_path, capsys):
    (tmp_path / "short.toml").write_text('farm = "miniberry-10"\nvehicle = "quad"\nbudget = "3s"\n')
    arguments = ["--scenarios", str(tmp_path / "short.toml"), "--planners", planner_names()[0]]
    code = main(
        ["bench", "run", *arguments, "--estimators", "point", "--seeds", "7", "--out", str(tmp_path / "b")]
    )
    told = capsys.readouterr()
    assert code == 1
    assert told.err.count("warning: ") == 7
    assert "0 environments count; 7 do not: no run has a score (seeds 0..6)" in " ".join(told.err.split())
    assert "2 more runs failed" in told.err
    assert "7 failed" in told.out


class Leaves:
    triggers = Triggers(waypoints=True)

    def start(self):
        sys.exit(4)

    def decide(self, observation):
        return Decision({})


def test_a_policy_that_ends_the_program_has_rows_and_the_others_go_on():
    spec = BenchSpec.of(["WBF/Miniberry-10-v1"], planners=[Leaves(), "spiral"], estimators=["point"], seeds=1)
    assert ["SystemExit: 4" in str(row.error) for row in benchmark(spec)] == [True, False]
