"""Rows that are flown again without another process."""

import pytest

from wbf_mission.addons.boards import verification
from wbf_mission.bench.engine import fly_run


@pytest.fixture
def at_once(monkeypatch):
    """Rows are flown again in this process, which costs no start of another one."""
    monkeypatch.setattr(verification, "_flown_apart", lambda runs: map(fly_run, runs))
