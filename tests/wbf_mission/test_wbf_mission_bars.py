"""The bar of what is being done, on a real pseudo-terminal."""

import pytest
from terminal import on_terminal, screen

BAR = "\u2501"
PROGRAM = """
import sys, time
from wbf_mission.cli.output import Output
output = Output()
with output.progress() as bars:
    bars("planning", 1, 1)
    for step in range(24):
        bars("training", min(step, 5), 5)
        if step > 5:
            bars("flying", step, 23)
        if step % 6 == 0:
            output.note(f"line {step} " + "x" * 4 * step)
        if step == 9:
            print("warned", file=sys.stderr)
        if step == 15:
            output.show_bars(False)
            output.note("question?")
            time.sleep(0.6)
            output.show_bars(True)
            output.note("answered")
        time.sleep(0.1)
print("done")
"""
SAID = ["line 0", "line 6 ", "warned", "line 12 ", "question?", "answered", "line 18 ", "done"]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Output on a terminal of 80 columns, of a shell that exported COLUMNS before its window was resized."""
    folder = tmp_path_factory.mktemp("terminal")
    code, text = on_terminal(["-c", PROGRAM], width=80, cwd=folder, columns=200)
    assert code == 0
    return text


def test_lines_stay_and_the_bar_leaves_nothing_behind(written):
    assert BAR in written
    shown = [line for line in screen(written, 80) if line]
    assert not any(BAR in line for line in shown)
    starts = [line for line in shown if not line.startswith("x")]
    assert len(starts) == len(SAID) and all(map(str.startswith, starts, SAID)), shown


def test_one_bar_is_shown_at_a_time(written):
    """What records a terminal has a new line for each line of it, so none for a bar."""
    lines = written.replace("\r\n", "\n").split("\n")
    assert len(lines) <= len(SAID) + 6, lines
    for moment in range(len(written)):
        if written.startswith("\x1b[2K", moment):
            assert sum(BAR in line for line in screen(written[:moment], 80)) <= 1
