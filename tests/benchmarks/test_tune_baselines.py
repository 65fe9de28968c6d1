"""The choice of tuned fixed planners."""

import pytest
import tune_baselines
from tune_baselines import best, choices, chosen, distinct, specification

from wbf_mission.bench.rows import BenchRow
from wbf_mission.bench.spec import BenchSpec
from wbf_mission.scenario import load_scenario

SCENARIO = "WBF/Miniberry-10-v1"


def rows_of(planner, scores, ends):
    return [
        BenchRow(
            key=f"{planner}{k}",
            scenario=SCENARIO,
            planner=planner,
            estimator="gp",
            seed=k,
            score=a,
            final_score=b,
        )
        for k, (a, b) in enumerate(zip(scores, ends, strict=True))
    ]


ROWS = [
    *rows_of("lawnmower", (-0.3, -0.5), (-0.2, -0.2)),
    *rows_of("spiral", (-0.4, -0.4), (-0.1, -0.1)),
    *rows_of("adaptive-lawnmower", (-0.5, -0.5), (-0.4, -0.4)),
    *rows_of("adaptive-lawnmower:tomato_share=0.8", (-0.2, -0.4), (-0.3, -0.3)),
    *rows_of("spiral:min_spacing_m=0.6", (-0.1,), (-0.1,)),
]


def test_choices_that_plan_the_same_path_are_tried_once():
    every = choices(0.3048)
    assert every[:3] == list(tune_baselines.DEFAULTS)
    assert len(every) == len(set(every))
    kept = distinct(
        load_scenario(SCENARIO), ["lawnmower", "lawnmower:direction=x", "lawnmower:direction=1.5708"]
    )
    assert kept == ["lawnmower", "lawnmower:direction=1.5708"]
    # A path that does not fit is not tried.
    assert distinct(load_scenario(SCENARIO), ["lawnmower:max_spacing_m=0.31", "spiral"]) == ["spiral"]


def test_only_what_flew_all_seeds_is_chosen():
    assert best(ROWS, "run", 2) == ["adaptive-lawnmower:tomato_share=0.8", "lawnmower"]
    assert best(ROWS, "end", 2, "spiral") == ["spiral"]
    found = {(one.measure, one.planner): one.gain.mean for one in chosen(ROWS)}
    assert found == pytest.approx(
        {
            ("run", "lawnmower"): 0.0,
            ("run", "spiral"): 0.0,
            ("run", "adaptive-lawnmower:tomato_share=0.8"): 0.2,
            ("end", "lawnmower"): 0.0,
            ("end", "spiral"): 0.0,
            ("end", "adaptive-lawnmower:tomato_share=0.8"): 0.1,
        }
    )


def test_the_specification_can_be_flown(tmp_path):
    file = tmp_path / "tuned.toml"
    file.write_text(specification(chosen(ROWS), range(910_000, 910_002)))
    spec = BenchSpec.read(file)
    assert [str(one) for one in spec.planners] == [
        "lawnmower",
        "spiral",
        "adaptive-lawnmower:tomato_share=0.8",
    ]
    assert [name for name, _ in spec.scenarios] == [SCENARIO]
    assert len(spec.seeds) == 40
