"""The page of benchmarks/families.py: who leads where, on rows that nobody flew."""

import families
from bench_rows import made_row

SWEEP, SHORT = "WBF/Miniberry-30-Sweep-v1", "WBF/Miniberry-30-Smooth-Short-v1"


def row(scenario, planner, estimator, seed, score):
    key = f"{scenario}{planner}{estimator}{seed}"
    return made_row(planner, seed, [score, score], scenario=scenario, estimator=estimator, key=key)


def test_the_page_tells_where_ours_leads_and_where_it_does_not():
    rows = []
    for seed in range(10):
        luck = 0.01 * seed
        rows += [
            row(SWEEP, "greedy", "epidemic", seed, -0.1 - luck),
            row(SWEEP, "rolling-horizon", "epidemic", seed, -0.15 - luck),
            row(SWEEP, "spiral", "gp", seed, -0.3 - luck),
            row(SHORT, "lawnmower", "gp", seed, -0.1 - luck),
            row(SHORT, "rolling-horizon", "gp", seed, -0.12 - luck * 1.1),
        ]
    page = "\n".join(families.markdown(rows))
    own, smooth, behind = page.split("## ")[1:]
    assert own.startswith("Our own world") and smooth.startswith("Smooth static fields")
    assert f"| {SWEEP} | 10 | greedy, epidemic | -0.1450 (" in own and "ours leads" in own
    assert "greedy, epidemic 1.0; rolling-horizon, epidemic 2.0; spiral, gp 3.0" in own
    assert "| rolling-horizon, gp | -0.1695 (" in smooth and "| ours is worse |" in smooth
    assert SWEEP not in behind
    assert f"- {SHORT}: lawnmower, gp leads; rolling-horizon, gp is behind by 0.0245 (" in behind


def test_methods_that_were_not_flown_are_told():
    rows = [row(SWEEP, "spiral", "gp", seed, -0.3 - 0.01 * seed) for seed in range(3)]
    assert "ours was not flown (nothing to compare)" in "\n".join(families.markdown(rows))
