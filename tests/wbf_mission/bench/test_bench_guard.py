"""A small benchmark whose scores change only with a commit that says so."""

import json

import pytest
from write_benchmark_guard import TABLE, table


@pytest.mark.slow
def test_scores_change_only_on_purpose():
    # Where it is meant: python tools/write_benchmark_guard.py, and say in the commit why.
    kept = json.loads(TABLE.read_text())
    now = table()
    assert now.keys() == kept.keys()
    for name, scores in kept.items():
        assert now[name] == pytest.approx(scores, rel=1e-6, abs=1e-9), name
