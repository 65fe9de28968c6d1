"""Budgets and their text form."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mission.errors import PlanningError
from mission.planners import Budget, LengthBudget, StepBudget, parse_budget


@pytest.mark.parametrize(
    ("text", "value", "unit"),
    [
        ("8000m", 8000.0, "m"),
        ("2.5km", 2500.0, "m"),
        (" 25 min ", 1500.0, "s"),
        ("1500s", 1500.0, "s"),
        ("1h", 3600.0, "s"),
        ("360steps", 360.0, "steps"),
        ("120Wh", 120.0, "Wh"),
        ("120wh", 120.0, "Wh"),
        ("1.2e3M", 1200.0, "m"),
        (".5km", 500.0, "m"),
    ],
)
def test_budgets_are_read(text, value, unit):
    assert parse_budget(text) == (pytest.approx(value), unit)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "m",
        "8000",
        "-5m",
        "0m",
        "0.0km",
        "infm",
        "nan s",
        "inf",
        "1e999m",
        "5 miles",
        "8,000m",
        "1_000m",
        "\uff15m",
        "5m\n\n5m",
        "0x10m",
        "5mm",
        "m5",
        "--5s",
        "+-1s",
        "x" * 5000,
    ],
)
def test_nonsense_is_refused_in_one_line(text):
    with pytest.raises(PlanningError) as caught:
        parse_budget(text)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 250


@given(st.text(max_size=20))
def test_any_text_gives_a_positive_budget_or_a_planning_error(text):
    try:
        value, unit = parse_budget(text)
    except PlanningError as error:
        assert "\n" not in str(error)
    else:
        assert 0 < value < math.inf
        assert unit in {"m", "s", "steps", "Wh"}


@pytest.mark.parametrize("limit", [0.0, -1.0, math.inf, math.nan])
def test_limits_must_be_finite_and_positive(limit):
    for kind in (LengthBudget, StepBudget):
        with pytest.raises(PlanningError, match="finite"):
            kind(limit)
    with pytest.raises(PlanningError, match="step"):
        StepBudget(10, step_m=limit)


def test_length_counts_the_return():
    path = np.array([(0.0, 0.0), (3.0, 4.0), (3.0, 10.0)])
    assert LengthBudget(1.0).cost(path) == 11.0
    assert LengthBudget(1.0, return_to=(0.0, 10.0)).cost(path) == 14.0
    assert LengthBudget(1.0, return_to=(0.0, 3.0)).cost(path[:1]) == 3.0
    assert isinstance(LengthBudget(1.0), Budget)
    assert isinstance(StepBudget(1.0), Budget)


def test_steps_are_those_of_the_papers_robot():
    def walk(path, step):
        here, steps = np.array(path[0], dtype=float), 0
        for target in path[1:]:
            while True:
                steps += 1
                way = np.subtract(target, here)
                distance = np.hypot(*way)
                if distance <= step + 1e-6:
                    here = np.array(target, dtype=float)
                    break
                here = here + way / distance * step
        return steps

    rng = np.random.default_rng(3)
    for _ in range(20):
        path = rng.uniform(0, 30, (8, 2))
        assert StepBudget(1.0, step_m=1.0).cost(path) == walk(path, 1.0)
    rows = [(0.0, 0.0), (0.0, 0.0), (30.0, 0.0), (30.0, 3.0)]
    assert StepBudget(1.0, step_m=1.0).cost(rows) == walk(rows, 1.0) == 34
