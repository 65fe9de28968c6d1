"""Results do not depend on the processor's kernels, nor on who asks for them: docs/decisions/0029."""

import json
import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest
from sweeps import slow
from threadpoolctl import threadpool_info

from geo.compiled import compiled_folder
from sensors.estimators import estimator_names
from wbf_mission import Scenario, fly, load_result

CPUS = Path("/proc/cpuinfo")
FLAGS = frozenset(CPUS.read_text().split()) if CPUS.is_file() else frozenset()
AVX512 = ("avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl")
NEEDED = {"Sandybridge": ("avx",), "Haswell": ("avx2", "fma"), "SkylakeX": AVX512}
KERNELS = [name for name, flags in NEEDED.items() if FLAGS.issuperset(flags)]
VARIABLES = ("OPENBLAS_CORETYPE", "NPY_DISABLE_CPU_FEATURES", "OPENBLAS_NUM_THREADS")

# Days, soil and the infected of a whole flight; a world of smooth fields; a kernel fitted in flight.
FLOWN = """
import hashlib, json, sys
import numpy as np
from sensors.estimators.gp import prior
from wbf_mission import Scenario, fly
from wbf_mission.addons.base.intervals import mean_intervals, ratio_intervals
from numpy._core._multiarray_umath import __cpu_features__

# Priors of few simulations are made by the same kernels.
prior._MOST_SIMULATIONS, prior._SOIL_SIMULATIONS = 20, 16

def digest(*arrays):
    return hashlib.sha256(b"".join(np.ascontiguousarray(one).tobytes() for one in arrays)).hexdigest()[:16]

losses = [(np.arange(1.0, 41.0) * 0.37 * step) % 1.0 for step in (1, 2, 3)]
found = mean_intervals(losses, together=True) + ratio_intervals(list(zip(losses, losses[1:])), together=True)
told = {"intervals": [value.hex() for one in found for value in (one.mean, one.low, one.high)]}
for name, options in json.loads(sys.argv[1]).items():
    flown = fly(Scenario(farm="miniberry-10", **options))
    seen = flown.observations
    told[name] = {
        "truth": digest(flown.truth),
        "track": digest(*(getattr(flown.track, name) for name in ("time_s", "x_m", "y_m", "altitude_m"))),
        "observations": digest(seen.x, seen.y, seen.time_s, seen.values),
        "estimate": digest(flown.model.value, flown.model.uncertainty),
        "score": [flown.score.hex(), flown.final_score.hex()],
    }
print(json.dumps({"told": told, "features": [name for name, on in __cpu_features__.items() if on]}))
"""
RUNS = {
    "gp": {"policy": "rolling-horizon", "estimator": "gp", "days": 2, "budget": "60s"},
    "gp in tiles": {"policy": "orienteering", "estimator": "gp:method=local", "budget": "60s"},
    "gp of the flight": {"planner": "spiral", "estimator": "gp:learn_from=observations"},
    "adaptive-disk": {"planner": "lawnmower", "estimator": "adaptive-disk", "gps_noise_m": 0.5},
}
if "epidemic" in estimator_names():
    quick = "epidemic:outbreaks=20,epochs=1"
    RUNS["epidemic"] = {"policy": "greedy", "estimator": quick, "days": 2, "budget": "60s"}
# Kernels without FMA differ most from what a processor chooses; the first and the last run take longest.
QUICK = ("Sandybridge", tuple(RUNS)[1:3])
CHOSEN = [QUICK] * ("Sandybridge" in KERNELS) + [slow(name, tuple(RUNS)) for name in KERNELS]


def environment_of(folder, **forced):
    kept = {name: value for name, value in os.environ.items() if name not in VARIABLES}
    # What one process learned must not serve the others; compiled code does not depend on those kernels.
    caches = {"XDG_CACHE_HOME": str(folder), "NUMBA_CACHE_DIR": str(compiled_folder())}
    return kept | caches | forced


def flown(folder, runs, **forced):
    chosen = json.dumps({name: RUNS[name] for name in runs})
    command = [sys.executable, "-W", "ignore", "-c", FLOWN, chosen]
    done = subprocess.run(
        command, env=environment_of(folder, **forced), check=True, capture_output=True, text=True
    )
    return json.loads(done.stdout)


def disabled(*parts):
    from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

    names = [one for one in __cpu_dispatch__ if __cpu_features__.get(one)]
    return {"NPY_DISABLE_CPU_FEATURES": " ".join(one for one in names if one.startswith(parts))}


@pytest.fixture(scope="module")
def by_itself(tmp_path_factory):
    return cache(lambda runs: flown(tmp_path_factory.mktemp("cache"), runs))


# With each kernel another part of what numpy chooses by the processor is switched off.
SWITCHED_OFF = {"Sandybridge": ("",), "Haswell": ("X86_V4", "AVX512")}


@pytest.mark.skipif(not KERNELS, reason="no kernels to choose from")
@pytest.mark.parametrize(("kernel", "runs"), CHOSEN)
def test_no_kernel_changes_a_bit(kernel, runs, by_itself, tmp_path):
    off = disabled(*SWITCHED_OFF[kernel]) if kernel in SWITCHED_OFF else {}
    found = flown(tmp_path, runs, OPENBLAS_CORETYPE=kernel, **off)
    assert found["told"] == by_itself(runs)["told"]
    assert found["told"].keys() == {"intervals", *runs}
    assert len(found["told"]["intervals"]) == 15
    names = set(off.get("NPY_DISABLE_CPU_FEATURES", "").split())
    assert names.isdisjoint(found["features"])
    assert names <= set(by_itself(runs)["features"])


def command_line(folder, *words, **forced):
    command = [sys.executable, "-m", "wbf_mission", *words]
    done = subprocess.run(
        command, env=environment_of(folder, **forced), check=True, capture_output=True, text=True
    )
    return done.stdout


def test_the_command_line_flies_what_python_flies(tmp_path):
    words = ["--farm", "miniberry-10", "--policy", "greedy", "--estimator", "gp", "--no-plots", "--quiet"]
    words += ["--budget", "60s"]
    forced = disabled("") | ({"OPENBLAS_CORETYPE": "Sandybridge"} if "Sandybridge" in KERNELS else {})
    command_line(tmp_path, "fly", *words, "--out", str(tmp_path / "run"), **forced)
    there = load_result(tmp_path / "run")
    here = fly(Scenario(farm="miniberry-10", policy="greedy", estimator="gp", budget="60s"))
    assert (there.score, there.final_score, there.losses) == (here.score, here.final_score, here.losses)
    assert there.track.x_m.tolist() == here.track.x_m.tolist()


def test_kernels_can_be_forced(tmp_path):
    """Without that the comparisons above would compare nothing."""
    for kernel in KERNELS:
        command = [sys.executable, "-c", "import numpy, threadpoolctl as t; print(t.threadpool_info())"]
        told = subprocess.run(
            command, env=environment_of(tmp_path, OPENBLAS_CORETYPE=kernel), check=True, capture_output=True
        )
        assert kernel in told.stdout.decode() or "openblas" not in str(threadpool_info())
