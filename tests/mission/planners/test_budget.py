"""Budgets and their text form."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mission.errors import PlanningError
from mission.planners import LengthBudget, StepBudget, parse_budget


@pytest.mark.parametrize(
    ("text", "value", "unit"),
    [
        ("8000m", 8000.0, "m"),
        ("2.5km", 2500.0, "m"),
        ("1500s", 1500.0, "s"),
        ("1h", 3600.0, "s"),
        ("360steps", 360.0, "steps"),
        ("120Wh", 120.0, "Wh"),
        (".5km", 500.0, "m"),
    ],
)
def test_budgets_are_read(text, value, unit):
    assert parse_budget(text) == (pytest.approx(value), unit)


@pytest.mark.parametrize(
    "text", ["", "8000", "-5m", "0m", "infm", "1e999m", "5 miles", "\uff15m", "5m\n\n5m", "x" * 5000]
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
