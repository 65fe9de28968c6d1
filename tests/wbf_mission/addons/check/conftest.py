"""Checks over sockets in less than real time."""

import time

import pytest

from mission.transfer.driver import wait_readable
from wbf_mission.addons.check.runner import check_vehicle

PACE = 5.0


@pytest.fixture
def pace(monkeypatch):
    """Checks of this process go `pace` times as fast as real time; their vehicles have to, too."""
    hastened = {
        "clock": lambda: PACE * time.monotonic(),
        "wait": lambda link, seconds: wait_readable(link, seconds / PACE),
    }
    for name, value in hastened.items():
        monkeypatch.setitem(check_vehicle.__kwdefaults__, name, value)
    return PACE
