"""Every error that a test of the command line sees advises what its command can do; a small vehicle."""

import pytest
from advice import misadvice

from wbf_mission.cli import app


@pytest.fixture(scope="session")
def small(tmp_path_factory):
    """A vehicle whose battery lasts for four minutes."""
    file = tmp_path_factory.mktemp("vehicles") / "small.toml"
    file.write_text('base = "quad"\n[battery]\ncapacity_wh = 12.0\n')
    return str(file)


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
