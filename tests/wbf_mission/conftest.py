"""Every error that a test of the command line sees advises what its command can do."""

import pytest
from advice import misadvice

from wbf_mission.cli import app


@pytest.fixture(autouse=True)
def advice_is_checked(monkeypatch):
    run, complain = app._run, app._complain
    now = []

    def checked_run(arguments):
        now[:] = arguments
        return run(arguments)

    def checked(text, code):
        assert not misadvice(now, text), f"wbf-mission {' '.join(map(str, now))}: {text}"
        return complain(text, code)

    monkeypatch.setattr(app, "_run", checked_run)
    monkeypatch.setattr(app, "_complain", checked)
