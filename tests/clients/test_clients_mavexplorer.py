"""MAVExplorer, the log viewer of MAVProxy, before the log that a run leaves: opened, read and plotted.

It is the program itself, typed at through a terminal. Nothing has a window: wxPython, which it would draw
windows with, is an empty module, and Matplotlib saves what it would show.
"""

import contextlib
import json
import os
import pty
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest

from wbf_mission.flight import Simulated, fly
from wbf_mission.results.result import Result
from wbf_mission.scenario import Scenario

pytestmark = pytest.mark.slow

SAVES_FIGURES = """
import json, os
from matplotlib.backends.backend_agg import FigureCanvasAgg as FigureCanvas
from matplotlib.backends.backend_agg import FigureManagerBase as FigureManager

def show(*_, **__):
    import matplotlib.pyplot as plt
    figure = plt.gcf()
    lines = [line for axes in figure.axes for line in axes.get_lines() if len(line.get_xdata()) > 2]
    curves = {str(line.get_label()): [float(y) for y in line.get_ydata()] for line in lines}
    figure.savefig("graph.png")
    with open("graph.part", "w") as file:
        json.dump(curves, file)
    os.rename("graph.part", "graph.json")
"""


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, Path]:
    log = tmp_path_factory.mktemp("run") / "flight.tlog"
    scenario = Scenario(farm="miniberry-10", planner="lawnmower", budget="60s", estimator="point")
    return fly(scenario, by=Simulated(tlog=log)), log


class Terminal:
    """A program at a terminal, as it expects: at a pipe it would wait for itself."""

    def __init__(self, command: list[str], **how: Any) -> None:
        self._master, slave = pty.openpty()
        self.process = subprocess.Popen(command, stdin=slave, stdout=slave, stderr=slave, **how)
        os.close(slave)
        self.said = ""
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        with contextlib.suppress(OSError):  # which is how the end of a terminal is told
            while data := os.read(self._master, 4096):
                self.said += data.decode(errors="replace")

    def type(self, line: str) -> None:
        os.write(self._master, f"{line}\n".encode())

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        self._reader.join(10.0)
        os.close(self._master)


def test_mavexplorer_opens_and_plots_our_log(flown, installed, tools, tmp_path):
    result, log = flown
    # It plots with a function that Matplotlib 3.11 has no more.
    packages = Path(installed("--no-deps", "MAVProxy>=1.8.70", "matplotlib<3.11"))
    (packages / "wx.py").touch()
    (packages / "saves_figures.py").write_text(SAVES_FIGURES, encoding="utf-8")
    environment = {
        **os.environ,
        "PYTHONPATH": str(packages),
        "PYTHONUNBUFFERED": "1",
        "HOME": str(tmp_path),
        "MPLBACKEND": "module://saves_figures",
        "TERM": "dumb",
    }
    command = [sys.executable, str(packages / "bin" / "MAVExplorer.py"), str(log)]
    explorer = Terminal(command, env=environment, cwd=tmp_path)
    try:
        texts = [text for _, _, text in result.flights[0].texts]
        explorer.type("messages")
        tools.wait_until(lambda: all(text in explorer.said for text in texts), what="the texts")
        explorer.type("graph GLOBAL_POSITION_INT.relative_alt*0.001 VFR_HUD.groundspeed")
        tools.wait_until((tmp_path / "graph.json").exists, what="the graph")
    finally:
        explorer.close()
    curves = json.loads((tmp_path / "graph.json").read_text(encoding="utf-8"))
    assert len(curves) == 2
    heights = next(values for name, values in curves.items() if "relative_alt" in name)
    track = result.flights[0].track
    assert max(heights) == pytest.approx(track.altitude_m.max(), abs=1e-3)
    assert len(heights) >= len(track.time_s)
    assert (tmp_path / "graph.png").stat().st_size > 10_000
