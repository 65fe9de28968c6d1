"""The page of benchmarks/families.py: who leads where, on rows that nobody flew."""

import families
from bench_rows import made_row
from msgspec import structs

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
    lines = list(families.markdown(rows))
    (own,) = (line for line in lines if line.startswith(f"| `own` | {SWEEP} |"))
    (smooth,) = (line for line in lines if line.startswith(f"| `smooth` | {SHORT} |"))
    assert f"| {SWEEP} | 10 | greedy, epidemic | -0.1450 (" in own and "| spiral, gp | -0.3450 (" in own
    assert "| 0.2000 (0.2000 to 0.2000) | better |" in own
    assert "| 10 | rolling-horizon, gp | -0.1695 (" in smooth and "| lawnmower, gp | -0.1450 (" in smooth
    assert "| -0.0245 (" in smooth and "| worse |" in smooth
    assert "behind by more than chance in 1 (WBF/Miniberry-30-Smooth-Short-v1)" in " ".join(lines).replace(
        "\n", " "
    )


def test_whether_what_is_stated_holds():
    rows = [
        structs.replace(
            row(SWEEP, "spiral", "gp", seed, -0.3),
            calibration={
                "ccr_sick_held": held,
                "ccr_healthy_held": 0.25,
                "soil_held": 0.5,
                "soil_error": 2.0,
            },
        )
        for seed, held in enumerate((0.8, 1.0))
    ]
    page = "\n".join(families.markdown(rows))
    assert "| family | `gp` |\n|---|---|\n| `own` | ccr 90% (25%), soil 50% |" in page
