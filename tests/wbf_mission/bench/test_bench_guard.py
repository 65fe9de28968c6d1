"""A small benchmark whose scores change only with a commit that says so."""

import json
import subprocess
import sys

import pytest
import write_benchmark_guard


@pytest.mark.slow
def test_scores_change_only_on_purpose(tmp_path):
    # Where it is meant: python tools/write_benchmark_guard.py, and say in the commit why.
    kept = json.loads(write_benchmark_guard.TABLE.read_text())
    out = tmp_path / "now.json"
    subprocess.run([sys.executable, write_benchmark_guard.__file__, "--out", out], check=True)
    now = json.loads(out.read_text())
    assert now.keys() == kept.keys()
    for name, scores in kept.items():
        assert now[name] == pytest.approx(scores, rel=1e-6, abs=1e-9), name
