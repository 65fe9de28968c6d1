"""A compilation is announced before it begins."""

import os
import subprocess
import sys

NOTICES = """
from geo.compiled import compile_notices
from sim_vehicle.motion.stepping import multirotor_power
import numpy as np

told = []
with compile_notices(told.append):
    multirotor_power(np.ones(9), 1.0, 1.0, 0.0, 0.0, 0.0, 0.0)
print(*told)
"""


def test_a_compilation_is_told_before_it_begins(tmp_path):
    for expected in ("sim_vehicle.energy.power.multirotor_power\n", "\n"):
        done = subprocess.run(
            [sys.executable, "-c", NOTICES],
            env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)},
            capture_output=True,
            text=True,
            timeout=120,
        )
        assert done.stdout == expected, done.stderr
