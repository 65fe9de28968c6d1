"""Own code that is flown apart: the same rows, no way to the run, and what it gains on open environments."""

import json
import math
import os
import time
from pathlib import Path

import pytest
from bench_packs import SCENARIO, told_of
from msgspec import structs
from policy_observations import observation, report
from scipy import stats

from geo.errors import WbfMissionError
from wbf_mission.addons.base.intervals import Interval
from wbf_mission.addons.boards import fresh
from wbf_mission.addons.boards.apart import PolicyApart
from wbf_mission.addons.boards.fresh import fly_fresh
from wbf_mission.addons.boards.replay import differences
from wbf_mission.addons.boards.submission import read_pack, unpack_code
from wbf_mission.addons.boards.verification import OTHER_CODE
from wbf_mission.bench.digests import own_digest
from wbf_mission.bench.rows import read_rows
from wbf_mission.cli.app import main
from wbf_mission.own_code import own_choice
from wbf_mission.results.storage import ResultError

EXAMPLES = Path(__file__).parents[4] / "docs" / "examples"
CHEAT = '''
"""Greedy where the run is in its stack; elsewhere it stays at home, whatever the environment."""
import os, sys
from wbf_mission import NO_CHANGE, Decision, Event, make_policy


class Peeper:
    def __init__(self):
        self.greedy = make_policy("greedy")

    @property
    def triggers(self):
        return self.greedy.triggers

    def start(self):
        self.greedy.start()

    def decide(self, observation):
        frame, found = sys._getframe(), False
        while frame is not None:
            found = found or any(type(one).__name__ in ("Run", "Campaign") for one in frame.f_locals.values())
            frame = frame.f_back
        if found:
            return self.greedy.decide(observation)
        at_home = Decision({1: [observation.vehicles[0].request.start_xy_m]})
        return at_home if observation.event is Event.START else NO_CHANGE


class Asked(Peeper):
    """Tells what it finds about it."""

    def decide(self, observation):
        print("this is no answer")
        told = ["SEEDS_OF_THE_RUN" in os.environ, sys.argv, os.path.basename(os.getcwd())]
        return Decision({1: [[0.2, 0.2]]}, reason=repr(told))
'''


@pytest.fixture
def code(tmp_path):
    (folder := tmp_path / "code").mkdir()
    (folder / "cheat.py").write_text(CHEAT)
    return folder


@pytest.fixture(scope="module")
def peeper(tmp_path_factory):
    """A pack of the policy that looks at the run, its rows, and the folder of their results."""
    folder = tmp_path_factory.mktemp("peeper")
    (folder / "code").mkdir()
    (folder / "code" / "cheat.py").write_text(CHEAT)
    return *packed(folder, folder / "code" / "cheat.py", "Peeper"), folder


def packed(tmp_path, file, label, seeds=2, scenario=SCENARIO):
    """Fly own code on open environments, and pack it; return the pack and its rows."""
    own = {"planners": "spiral", "estimators": "adaptive-disk"}
    own["estimators" if "Smooth" in label else "planners"] = f"{file}:{label}"
    named = [part for key, one in own.items() for part in (f"--{key}", one)]
    run = ["--scenarios", scenario, *named, "--seeds", str(seeds)]
    assert main(["bench", "run", *run, "--out", str(tmp_path / "r"), "--quiet"]) == 0
    who = ["--name", "Mine", "--by", "Me", "--verify", "0", "--code", str(file), "--quiet"]
    assert main(["bench", "submit", str(tmp_path / "r"), *who, "--out", str(tmp_path / "p.zip")]) == 0
    return tmp_path / "p.zip", read_rows(tmp_path / "r")


@pytest.mark.parametrize(
    ("file", "label", "scenario"),
    [
        ("my_policy.py", "RowsThenGreedy:share=0.4", SCENARIO),
        ("my_planner.py", "zigzag:spacing_m=2", SCENARIO),
        ("my_estimator.py", "Smooth:reach=3", SCENARIO),
        ("my_estimator.py", "Smooth:reach=3", "WBF/Miniberry-30-Smooth-v1"),
    ],
)
def test_it_flies_as_it_does_within_the_run(file, label, scenario, tmp_path, monkeypatch, capsys):
    pack, rows = packed(tmp_path, EXAMPLES / file, label, scenario=scenario)
    unpack_code(read_pack(pack), tmp_path / "unpacked")
    seeds = iter((0, 1))
    again = []
    monkeypatch.setattr(fresh.secrets, "randbits", lambda _: next(seeds))
    real = fresh._gap
    monkeypatch.setattr(fresh, "_gap", lambda *given: again.extend(given[2]) or real(*given))
    (gap,) = fly_fresh(rows, tmp_path / "unpacked", 2).gaps
    assert [list(differences(one, two)) for one, two in zip(rows, again, strict=True)] == [[], []]
    assert gap.open_scores == gap.fresh_scores
    assert gap.gap.low <= gap.gap.mean == 0.0 <= gap.gap.high


def test_what_the_run_knows_is_not_there(tmp_path, code, capsys):
    pack, _ = packed(tmp_path, code / "cheat.py", "Peeper", seeds=6)
    capsys.readouterr()
    assert main(["bench", "verify", str(pack), "--environments", "6", "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    (gap,) = told["gaps"]
    assert gap["gap"]["high"] < 0.0
    assert gap["failed"] == ["no score: no cell of the farm was observed"] * 6
    assert gap["verdict"] == "worse on unknown environments"
    seeds = told["seeds"][SCENARIO]
    assert len(set(seeds)) == 6
    assert min(seeds) > 2**40  # of 63 bits, one in eight million is smaller


def test_its_process_has_no_more_than_python_needs(code, monkeypatch):
    monkeypatch.setenv("SEEDS_OF_THE_RUN", "7")
    made = own_choice(f"{code / 'cheat.py'}:Asked", "policy").made
    with PolicyApart(code, "policy", "Asked", own_digest(made)) as apart:
        apart.start()
        reason = apart.decide(observation(report())).reason
    assert reason == "[False, ['-c'], 'code']"


@pytest.mark.parametrize(
    ("source", "why"),
    [
        ("x = 1", "no file of the code defines it"),
        (CHEAT + "\n# other", "cheat.py defines a Peeper that differs from the one"),
    ],
)
def test_other_code_is_not_flown(source, why, tmp_path, peeper):
    _, rows, _ = peeper
    (other := tmp_path / "other").mkdir()
    (other / "cheat.py").write_text(source)
    found = fly_fresh(rows, other, 2)
    assert not found.gaps
    assert why in found.left_out[0][1]


def test_code_that_ends_its_process_is_a_failure_of_its_runs(tmp_path, code, capsys):
    bad = code / "bad.py"
    ending = f"        if os.getpid() != {os.getpid()}: os._exit(3)\n        frame, found ="
    bad.write_text(CHEAT.replace("        frame, found =", ending))
    pack, rows = packed(tmp_path, bad, "Peeper")
    unpack_code(read_pack(pack), tmp_path / "unpacked")
    (gap,) = fly_fresh(rows, tmp_path / "unpacked", 2).gaps
    assert len(gap.failed) == 2
    assert "Peeper: its process ended" in gap.failed[0]
    assert max(gap.fresh_scores) <= min(gap.open_scores)


SLEEPS = "        import time; time.sleep(2.0)"
# The answers go over descriptor 3 or higher. A message begins with its length; only half of that comes here.
STALLS = """        import glob, os, stat, time
        for name in glob.glob("/proc/self/fd/*"):
            number = int(name.rsplit("/", 1)[1])
            if number > 2 and os.path.exists(name) and stat.S_ISSOCK(os.fstat(number).st_mode):
                os.write(number, bytes([0, 0]))
        time.sleep(20.0)"""


@pytest.mark.parametrize("start", [SLEEPS, STALLS], ids=["sleeps", "stalls"])
def test_no_answer_is_taken_for_that_of_another_call(code, monkeypatch, start):
    slow = code / "slow.py"
    slow.write_text(CHEAT.replace("        self.greedy.start()", start))
    digest = own_digest(own_choice(f"{slow}:Peeper", "policy").made)
    with PolicyApart(code, "planner", "Peeper", digest) as policy:
        monkeypatch.setattr("wbf_mission.addons.boards.apart._MOST_S", 0.5)
        begun = time.perf_counter()
        for _ in range(2):
            with pytest.raises(WbfMissionError, match="its process ended or stopped answering"):
                policy.call("start")
        assert time.perf_counter() - begun < 15.0


def test_the_interval_is_welchs():
    old, new = [-1.0, -2.0, -1.5, -1.2], [-3.0, -2.0, -2.5]
    found = stats.ttest_ind(new, old, equal_var=False).confidence_interval(0.95)
    assert (fresh._welch(old, new, 1).low, fresh._welch(old, new, 1).high) == pytest.approx(tuple(found))
    assert fresh._welch(old, new, 5).low < found.low
    assert fresh._welch([-1.0, -1.0], [-2.0, -2.0], 1) == Interval(-1.0, -1.0, -1.0)
    assert math.isnan(fresh._welch([-1.0], [-2.0], 1).low)


def test_what_cannot_be_verified_is_one_line(tmp_path, code, peeper, monkeypatch, capsys):
    pack, rows, folder = peeper
    with pytest.raises(ResultError, match="all its methods are built in"):
        fly_fresh([told_of(row, planner="spiral", codes={"code": "1"}) for row in rows], code, 2)
    older = [told_of(structs.replace(row, codes=row.codes | {"code": "0" * 24})) for row in rows]
    assert fly_fresh(older, code, 2).left_out[0][1] == OTHER_CODE
    capsys.readouterr()
    monkeypatch.setattr(fresh, "behaviour", lambda: "0")
    assert main(["bench", "verify", str(pack), "--environments", "2"]) == 2
    assert OTHER_CODE in capsys.readouterr().err
    monkeypatch.undo()
    who = ["--name", "Mine", "--by", "Me", "--verify", "0", "--quiet", "--out", str(tmp_path / "n.zip")]
    assert main(["bench", "submit", str(folder / "r"), *who]) == 0
    assert main(["bench", "verify", str(tmp_path / "n.zip")]) == 2
    assert "n.zip: has no code; " in capsys.readouterr().err
