"""The pages of `sim` and `monitor`, and orders from a page, with all programs as processes of their own."""

import json
import re
import subprocess
import time
from contextlib import ExitStack, contextmanager
from threading import Thread

import pytest
from processes import FARM, JOB, LONG_S, command, running, wait_until
from stand_in import scenario, stand_in
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from mission.ground.link import upload
from wbf_mission.cli.app import main
from wbf_mission.run.plan import plan


class Page:
    """What a browser would get, and what it sends."""

    def __init__(self, socket):
        self.updates, self.replies, self._socket = [], [], socket
        self._beat, self._sent = None, 0
        Thread(target=self._read, daemon=True).start()

    def _read(self):
        try:
            for text in self._socket:
                update = json.loads(text)
                if "beat" in update:
                    self._beat = update["beat"]["time_s"], time.monotonic()
                (self.replies if "reply" in update else self.updates).append(update)
        except ConnectionClosed:
            return

    def rows(self, name):
        return [row for one in list(self.updates) for row in one.get(name, ())]

    def last(self, name):
        return next((one[name] for one in reversed(list(self.updates)) if name in one), None)

    def states(self, vehicle, name):
        told = [one["states"][vehicle] for one in list(self.updates) if vehicle in one.get("states", {})]
        return [value for one in told for value in one[name]]

    def wait(self, condition, what):
        return wait_until(lambda: condition(self), what)

    def wait_for_text(self, text):
        self.wait(lambda page: any(text in one["text"] for one in page.rows("said")), text)

    def may(self, order):
        self.wait(
            lambda page: order in (page.last("status") or {}).get("orders", ()), f"{order} is not possible"
        )

    def orders(self, order, system_id=1, **more):
        """Order something; return why it is refused."""
        self.wait(lambda page: page._beat, "the program does not live")
        count, (beat_s, came_s) = len(self.replies), self._beat
        self._sent += 1
        given = {"number": self._sent, "beat_s": beat_s, "after_s": time.monotonic() - came_s}
        self._socket.send(json.dumps({"order": order, "system_ids": [system_id], "given": given, **more}))
        self.wait(lambda page: len(page.replies) > count, "no reply")
        return self.replies[-1]["reply"]["error"]


@contextmanager
def shown(cwd, *words):
    """Run a program with a page; yields the page, the process, and the lines that it says."""
    with running(
        command(*words, "--live", "0"), cwd, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        lines = []

        def read(stream):
            lines.extend(iter(stream.readline, ""))

        for stream in (process.stderr, process.stdout):
            Thread(target=read, args=(stream,), daemon=True).start()
        told = re.compile(r"live page: (http\S+)")
        found = wait_until(
            lambda: [one for one in map(told.search, list(lines)) if one], "no address was printed"
        )
        address = found[0][1]
        live, origin = address.replace("http", "ws") + "live", address.rstrip("/")
        with connect(live, origin=origin, open_timeout=LONG_S, max_size=None) as socket:
            yield Page(socket), process, lines


def said(lines, text):
    return wait_until(lambda: [one for one in list(lines) if text in one], f"not said: {text}")


@pytest.mark.slow
def test_pages_of_a_simulator_and_a_monitor_show_one_flight_and_order_it(tmp_path):
    sim = ("sim", *FARM, "--count", "2", "--speed", "4", "--listen", "tcpin:127.0.0.1:0", "--control")
    with ExitStack() as stack:
        page, process, lines = stack.enter_context(shown(tmp_path, *sim))
        (line,) = said(lines, "Ctrl-C ends it")
        url = re.search(r"tcpin(:\S+);", line)[1].join(("tcp", ""))
        upload(plan(scenario(fence_m=5.0)).mission, url, system_id=2)
        page.may("start")
        assert page.orders("start", system_id=2) == "start starts motors: it has to be confirmed"
        assert page.orders("start", system_id=2, confirmed=True) == ""
        page.wait_for_text("vehicle 2: start is carried out")
        watch = ("monitor", url, *FARM, "--control")
        other, monitor, told = stack.enter_context(shown(tmp_path, *watch))
        other.wait(lambda one: one.rows("plans"), "the monitor's page has no plan")
        assert [one["system_id"] for one in other.rows("plans")] == [2]
        assert len(other.rows("plans")[0]["items"]) == len(page.rows("plans")[-1]["items"])
        assert len(other.rows("plans")[0]["fence"]) == 1
        page.wait(lambda one: (one.states("2", "item")[-1] or 0) >= 6, "it does not fly its rows")
        assert other.orders("hold", system_id=2) == ""
        for one in (page, other):
            one.wait(
                lambda one: one.states("2", "mode")[-1] == "LOITER", "the page does not show that it holds"
            )
        said(told, "vehicle 2: hold is carried out (mode LOITER)")
        assert page.orders("land", system_id=2) == ""
        page.wait(lambda one: not one.states("2", "armed")[-1], "it does not come down")
        assert not any(one.states("1", "armed")[-1] for one in (page, other)), "nothing was ordered of it"
        assert page.last("run")["farm"]["name"] == other.last("run")["farm"]["name"] == "miniberry-10"
        assert any(one["layer"].startswith("truth/") for one in page.rows("tiles"))
        assert page.last("readings")["values"]["tylcv"], "what the camera saw"
        for program in (monitor, process):
            program.terminate()
            program.wait(LONG_S)
        page.wait(lambda one: one.last("status")["outcome"] != "running", "the page does not tell of the end")


@pytest.mark.slow
def test_a_page_flies_a_vehicle_behind_a_link_without_a_terminal(tmp_path):
    words = ("fly", *FARM, "--planner", "lawnmower", *JOB, "--autopilot", "px4", "--no-files", "--control")
    with stand_in("px4") as (url, made), shown(tmp_path, *words, "--connect", url) as (page, process, lines):
        page.may("start")
        assert not made.vehicle.pilot.armed
        assert page.last("status")["question"]["answers"] == ["do not start"]
        assert page.orders("start") == "start starts motors: it has to be confirmed"
        assert page.orders("start", confirmed=True) == ""
        page.may("hold")
        page.wait(lambda one: max(one.states("1", "height_m")) > 5.0, "it does not climb")
        assert page.orders("hold") == ""
        said(lines, "the vehicle holds (mode")
        assert page.orders("return") == ""
        said(lines, "the vehicle returns (mode RTL)")
        page.wait(lambda one: one.last("status")["outcome"] != "running", "it does not come home")
        assert page.last("status")["outcome"] == "interrupted"
        assert page.last("status")["orders"] == [], "there is nothing left to order"
        assert process.poll() is None, "the page stays"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (
            ("monitor", "tcp:127.0.0.1:1", "--farm", "miniberry-10"),
            "a farm is shown on the live page only: add --live PORT",
        ),
        (
            ("monitor", "tcp:127.0.0.1:1", "--crop", "peas", "--live", "0"),
            "--crop has an effect only with --farm: give --farm, too",
        ),
        (("monitor", "tcp:127.0.0.1:1", "--control"), "--control has an effect only with --live PORT"),
        (("sim", "--control"), "--control has an effect only with --live PORT"),
    ],
)
def test_what_has_no_effect_is_told_in_one_line(words, told, capsys):
    assert main([*words]) == 2
    error = capsys.readouterr().err
    assert told in error and "Traceback" not in error
