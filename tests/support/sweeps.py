"""Property tests with few examples in the default suite, and with many in its slow part."""

import os
from typing import Any

import pytest
from hypothesis import settings

IN_THE_SLOW_PART = "WBF_MISSION_TESTS_SLOW"
"""The environment variable that `tests/conftest.py` sets for a run of the slow tests."""


def sweep(few: int, many: int, **more: Any) -> Any:
    """Return the settings of a property test; in the slow part it is a slow test."""
    slow = IN_THE_SLOW_PART in os.environ
    chosen = settings(max_examples=many if slow else few, deadline=None, **more)
    return lambda test: pytest.mark.slow(chosen(test)) if slow else chosen(test)
