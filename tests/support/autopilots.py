"""Tests with both autopilots."""

import pytest


def autopilots(*, slow=()):
    """Parametrise a test with both autopilots; flights in real time may be slow tests with one of them."""
    marks = dict.fromkeys(slow, pytest.mark.slow)
    given = [pytest.param(name, marks=marks.get(name, ())) for name in ("px4", "ardupilot")]
    return pytest.mark.parametrize("autopilot", given)
