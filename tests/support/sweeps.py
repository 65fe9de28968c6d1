"""Few examples and variants for the default suite, all of them for its slow part."""

import os
from typing import Any

import pytest
from hypothesis import settings

IN_THE_SLOW_PART = "WBF_MISSION_TESTS_SLOW"
"""The environment variable that `tests/conftest.py` sets for a run of the slow tests."""


def sweep(few: int, many: int, **more: Any) -> Any:
    """Return the settings of a property test; in the slow part it is a slow test."""
    many_now = IN_THE_SLOW_PART in os.environ
    chosen = settings(max_examples=many if many_now else few, deadline=None, **more)
    return lambda test: pytest.mark.slow(chosen(test)) if many_now else chosen(test)


def slow(*values: Any, **more: Any) -> Any:
    """Return the values of a parametrised test as a variant of the slow part."""
    return pytest.param(*values, marks=pytest.mark.slow, **more)


def autopilots(*, slow_with: Any = ()) -> Any:
    """Parametrise a test with both autopilots; the variants in `slow_with` are in the slow part."""
    return pytest.mark.parametrize(
        "autopilot", [slow(name) if name in slow_with else name for name in ("px4", "ardupilot")]
    )
