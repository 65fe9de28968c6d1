"""How commands speak: text that cannot be encoded, bars on a terminal."""

import io
import json
import re
import subprocess
import sys

import pytest
from rich.console import Console

from sensors.estimators.base import LEARNING
from wbf_mission.cli.output import Output


def test_json_spells_out_what_no_reader_could_decode(capsys):
    values = {"file": "a\udcff.plan", "rows": [{"name": "b\udc80"}, 3], "pair": ("c", 1.5)}
    Output(as_json=True).raw_json(values)
    told = json.loads(capsys.readouterr().out)
    assert told == {"file": "a\\udcff.plan", "rows": [{"name": "b\\udc80"}, 3], "pair": ["c", 1.5]}


def test_a_number_is_never_broken(capsys):
    interval = "-0.2840 (-0.3010 to -0.2670)"
    rows = [["WBF/Miniberry-30-Sweep-v1 greedy:least_weight=0.35", *[interval] * 3, *["-0.2840"] * 9]] * 2
    Output().table(None, ["planner", *["score over the run"] * 3, *["loss a cell"] * 9], rows)
    told = capsys.readouterr().out
    assert len(re.findall(r"-0\.2840 ", told)) >= 2 * 12


def test_a_bar_has_the_time_left():
    output, written = Output(), io.StringIO()
    output._stderr = Console(file=written, force_terminal=True, width=90)
    with output.progress() as progress:
        progress("flying", 1.0, 2.0)
    assert re.search(
        r"flying .* 50% 0:00:0\d .* left", re.sub(r"\x1b\[[\d;?]*[A-Za-z]", "", written.getvalue())
    )


@pytest.mark.parametrize(
    ("every_s", "said"),
    [(0.0, ["flying: 9 of 11, about T left", "flying: 10 of 11, about T left"]), (3600.0, [])],
)
def test_without_a_terminal_lines_say_at_an_interval_how_long_it_will_take(capsys, every_s, said):
    with Output().progress(every_s=every_s) as progress:
        for done in range(8, 12):
            progress("flying", done, 11)
    lines = capsys.readouterr().err.splitlines()
    assert [re.sub(r"\d+:\d\d:\d\d", "T", line) for line in lines] == said


def test_tasks_that_ctrl_c_left_behind_end_in_silence():
    """As asyncio tells it of a write of zarr's that was not waited for."""
    script = (
        "import logging; from wbf_mission.cli.app import main; main(['vehicle', 'list', '--json']);"
        "logging.getLogger('asyncio').error('Future exception was never retrieved', exc_info=OSError('late'))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("[")
    assert done.stderr == ""


def test_the_first_flight_on_a_farm_tells_how_long_it_learns(capsys, monkeypatch):
    now_s = iter([0.0, 0.0, 0.0, 5.0, 5.0, 20.0, 20.0])
    monkeypatch.setattr("wbf_mission.cli.output.time.monotonic", lambda: next(now_s, 20.0))
    with Output().progress() as progress:
        for part in (0.0, 0.1, 0.25, 1.0):
            progress(LEARNING, part, 1.0)
    begun, left = capsys.readouterr().err.splitlines()
    assert begun == "training the estimator for this farm and day; later runs reuse the training ..."
    assert left == "training the estimator: 25%, about 0:01:00 left"
    with Output(quiet=True).progress() as progress:
        progress(LEARNING, 0.0, 1.0)
    assert capsys.readouterr().err == ""
