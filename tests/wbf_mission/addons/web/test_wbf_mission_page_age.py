"""The page in a browser shows nothing old as the present; orders go once, fresh, to whom they are meant."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from queue import Queue
from threading import Thread
from typing import Any

import frozen_server
import pytest
from live_page import STANDING, page_at, standing, standing_page
from playwright.sync_api import Browser, Page, expect
from viewer import Clock, Taking

from geo.farms import get_farm
from mission.outcome import in_words
from sensors.fields import PAPER_FIELDS
from wbf_mission.addons.web.server import LiveServer
from wbf_mission.addons.web.view import View
from wbf_mission.events import (
    Asked,
    Noted,
    Orderable,
    Progressed,
    RunBegun,
    RunEnded,
    VehicleInfo,
    VehicleMoved,
)

LONG_S = 60.0  # A limit against hanging, not a measure
WIDTHS = (360, 700, 1280)


class Program:
    """A live page's program as a process that can be stopped."""

    def __init__(self) -> None:
        path = os.pathsep.join(
            [str(Path(__file__).parents[4]), *filter(None, [os.environ.get("PYTHONPATH")])]
        )
        self.process = subprocess.Popen(
            [sys.executable, frozen_server.__file__],
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": path},
        )
        self.said: Queue[str] = Queue()
        Thread(target=self._read, daemon=True).start()
        self.url = self.said.get(timeout=LONG_S).strip()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.said.put(line.strip())

    def stop(self) -> None:
        self.process.send_signal(signal.SIGSTOP)

    def go_on(self) -> None:
        self.process.send_signal(signal.SIGCONT)


@contextmanager
def program() -> Iterator[Program]:
    one = Program()
    try:
        yield one
    finally:
        one.go_on()
        one.process.kill()
        one.process.wait(LONG_S)


def order(page: Page, name: str) -> Any:
    return (
        page.get_by_role("group", name="Orders")
        .or_(page.locator(".controls"))
        .get_by_role("button", name=name, exact=True)
    )


def says_nothing_of_the_present(page: Page) -> None:
    expect(page.locator("body")).not_to_contain_text(re.compile(r"\bLive\b|\bnow\b"), use_inner_text=True)


def test_a_page_whose_program_stands_still_says_so_and_gives_no_order(browser: Browser) -> None:
    with program() as one, page_at(browser, one.url, viewport={"width": 390, "height": 800}) as page:
        pill, card = page.locator(".connection"), page.locator(".card").first
        expect(pill).to_have_text("Live")
        expect(card).to_contain_text("now")
        page.get_by_label("Orders go to").select_option("drone-1")
        expect(order(page, "Hold")).to_be_enabled()
        one.stop()
        expect(pill).to_have_text(re.compile(r"No news for 0:0\d"))
        expect(page.locator(".lost")).to_have_text(
            "The program sends no data: the page shows old data, and takes no orders."
        )
        for name in ("Arm", "Hold", "Resume", "Return", "Land"):
            expect(order(page, name)).to_be_disabled()
        expect(card).to_contain_text(re.compile(r"no news for 0:0\d"))
        assert (
            page.locator(".card .body").first.evaluate("one => getComputedStyle(one).filter")
            == "grayscale(1)"
        )
        says_nothing_of_the_present(page)
        assert page.title().startswith("Old · ")
        one.go_on()
        expect(pill).to_have_text("Live")
        expect(page.locator(".lost")).to_be_empty()
        expect(card).to_contain_text("now")
        expect(order(page, "Hold")).to_be_enabled()
        assert page.locator(".card .body").first.evaluate("one => getComputedStyle(one).filter") == "none"
        order(page, "Hold").click()
        expect(page.locator(".became")).to_have_text("Hold, drone-1: sent")
        assert one.said.get(timeout=LONG_S) == "taken: hold 1"


def test_what_was_ordered_while_the_program_stood_still_is_not_carried_out_when_it_goes_on(
    browser: Browser,
) -> None:
    with program() as one, page_at(browser, one.url) as page:
        expect(page.locator(".connection")).to_have_text("Live")
        page.get_by_label("Orders go to").select_option("drone-1")
        order(page, "Arm").click()
        one.stop()
        # Before the page can know it.
        page.get_by_role("dialog").get_by_role("button", name="Yes").click()
        expect(page.locator(".became")).to_have_text(
            "Arm, drone-1: not answered: the request may or may not have arrived"
        )
        expect(page.locator(".connection")).to_have_text(re.compile("No news for"))
        one.go_on()
        expect(page.locator(".became")).to_have_text(re.compile("Arm: not done: too late: it was given"))
        expect(page.locator(".connection")).to_have_text("Live")
        order(page, "Resume").click()
        expect(page.locator(".became")).to_have_text("Resume, drone-1: sent")
        assert one.said.get(timeout=LONG_S) == "taken: resume 1", "the order before was carried out late"
        assert one.said.empty()


def test_a_question_that_stood_open_when_the_program_stopped_is_taken_away(browser: Browser) -> None:
    with program() as one, page_at(browser, one.url) as page:
        page.get_by_label("Orders go to").select_option("drone-1")
        order(page, "Hold").click()
        expect(page.locator(".became")).to_have_text("Hold, drone-1: sent")
        order(page, "Arm").click()
        expect(page.get_by_role("dialog")).to_be_visible()
        one.stop()
        expect(page.get_by_role("dialog")).to_be_hidden()
        expect(page.locator(".became")).to_have_text("Nothing was sent: your choice is no longer possible")
        one.go_on()
        expect(page.locator(".connection")).to_have_text("Live")
        order(page, "Resume").click()
        expect(page.locator(".became")).to_have_text("Resume, drone-1: sent")
        assert [one.said.get(timeout=LONG_S) for _ in "12"] == ["taken: hold 1", "taken: resume 1"]


def test_a_connection_that_is_lost_ends_orders_and_the_line_of_the_last_one(browser: Browser) -> None:
    with program() as one:
        page = browser.new_page()
        page.goto(one.url)
        page.get_by_label("Orders go to").select_option("drone-2")
        order(page, "Hold").click()
        expect(page.locator(".became")).to_have_text("Hold, drone-2: sent")
        one.process.kill()
        expect(order(page, "Hold")).to_be_disabled()
        expect(page.locator(".became")).to_be_empty()
        expect(page.locator(".connection")).to_have_text(re.compile("Connection lost|No news for"))
        says_nothing_of_the_present(page)
        page.close()


def two(view: View, *orders: str, simulated: bool = False) -> None:
    vehicles = tuple(VehicleInfo(number, f"drone-{number}", "copter") for number in (1, 2))
    view.take(RunBegun("a flight", get_farm("miniberry-10"), PAPER_FIELDS, vehicles, simulated=simulated))
    for number in (1, 2):
        view.take(moved(1.0, number))
    view.take(Orderable(orders))


def moved(time_s: float, number: int, **more: Any) -> VehicleMoved:
    known: dict[str, Any] = {"battery": 0.75, "mode": "AUTO", "armed": True}
    return VehicleMoved(time_s, 1, 1, number, 1.0, 1.0, 5.0, 3.0, **(known | more))


def test_a_vehicle_that_is_not_heard_is_told_while_the_program_lives(browser: Browser) -> None:
    clock = Clock()
    view = View(clock=clock)
    two(view)
    # The server's own clock goes on, and its beats with it; the vehicles' news get older by hand.
    with LiveServer(view) as server, page_at(browser, server.url, script=STANDING) as page:
        expect(page.locator(".connection")).to_have_text("Live")
        view.take(moved(2.0, 1))
        clock.now_s += 8.0
        view.take(moved(3.0, 2))
        first, second = page.locator(".card").all()
        expect(first).to_contain_text("no news for 0:08")
        expect(second).not_to_contain_text("no news")
        expect(page.locator(".lost")).to_have_text("No news of drone-1: the page shows old data.")
        expect(page.locator(".connection")).to_have_text("Vehicle not heard")
        speeds = page.locator(".chart", has_text="Speed").locator(".value")
        expect(speeds).to_have_text(re.compile("^[^/]+ / [^/]+$"))
        view.take(moved(20.0, 2))
        expect(speeds).to_have_text(re.compile("^[^/]+$"))
        view.take(moved(20.5, 1))
        expect(page.locator(".lost")).to_be_empty()
        expect(page.locator(".connection")).to_have_text("Live")


def test_orders_go_to_the_vehicle_that_is_chosen_and_to_none_before(browser: Browser) -> None:
    view, orders = View(clock=standing), Taking()
    two(view, "hold", "resume", "return", "land", simulated=True)
    with standing_page(browser, view, orders) as page:
        expect(page.locator(".connection")).to_have_text("Live")
        target = page.get_by_label("Orders go to")
        expect(target).to_have_value("")
        for name in ("Hold", "Return", "Land"):
            expect(order(page, name)).to_be_disabled()
        page.locator(".card .head").nth(1).click()
        expect(target).to_have_value("2")
        order(page, "Land").click()
        expect(page.locator(".became")).to_have_text("Land, drone-2: sent")
        target.select_option("drone-1")
        expect(page.locator(".card").first).to_have_class(re.compile("selected"))
        order(page, "Hold").click()
        expect(page.locator(".became")).to_have_text("Hold, drone-1: sent")
        page.locator(".card .head").first.click()
        expect(target).to_have_value("")
        expect(order(page, "Hold")).to_be_disabled()
    assert orders.taken == [([2], "land", "", False), ([1], "hold", "", False)]


def test_several_vehicles_are_brought_down_only_after_a_second_word(browser: Browser) -> None:
    view, orders = View(clock=standing), Taking()
    two(view, "hold", "return", "land", simulated=True)
    with standing_page(browser, view, orders) as page:
        page.get_by_label("Orders go to").select_option("All 2 vehicles")
        order(page, "Hold").click()
        expect(page.locator(".became")).to_have_text("Hold, All 2 vehicles: sent")
        for name in ("Return", "Land"):
            order(page, name).click()
            dialog = page.get_by_role("dialog")
            expect(dialog).to_contain_text("The order goes to 2 vehicles: drone-1, drone-2.")
            expect(page.locator(".became")).to_be_empty()
            if name == "Return":
                dialog.get_by_role("button", name="Cancel").click()
            else:
                page.keyboard.press("Escape")
            expect(page.locator(".became")).to_have_text(f"{name}, All 2 vehicles: not sent")
            order(page, name).click()
            expect(page.locator(".became")).to_be_empty()
            dialog.get_by_role("button", name="Yes").click()
            expect(page.locator(".became")).to_have_text(f"{name}, All 2 vehicles: sent")
        view.take(Asked("vehicles fly", ("hold", "return"), 7))
        question = page.locator(".question")
        question.get_by_role("button", name="Return").click()
        dialog.get_by_role("button", name="Cancel").click()
        expect(page.locator(".became")).to_have_text("Answer “return”: not sent")
        question.get_by_role("button", name="Return").click()
        dialog.get_by_role("button", name="Yes").click()
        expect(page.locator(".became")).to_have_text("Answer “return”: sent")
    assert orders.taken == [
        ([1, 2], "hold", "", False),
        ([1, 2], "return", "", True),
        ([1, 2], "land", "", True),
        ("return", 7),
    ]


@pytest.mark.parametrize(
    "orders",
    [
        ("hold", "resume", "return", "land", "set item"),
        ("start", "arm", "takeoff", "hold", "resume", "return", "land", "set item"),
    ],
)
def test_land_does_not_stand_beside_resume_and_no_order_moves(
    browser: Browser, orders: tuple[str, ...]
) -> None:
    view = View(clock=standing)
    two(view, *orders, simulated=True)
    with standing_page(browser, view, Taking()) as page:

        def boxes_at(width: int) -> dict[str, Any]:
            page.set_viewport_size({"width": width, "height": 800})
            return {name: order(page, name.capitalize()).bounding_box() for name in orders}

        before = {width: boxes_at(width) for width in WIDTHS}
        for boxes in before.values():
            land, resume = boxes["land"], boxes["resume"]
            # A finger's breadth between them, whichever way.
            across = max(land["x"] - resume["x"] - resume["width"], resume["x"] - land["x"] - land["width"])
            along = max(land["y"] - resume["y"] - resume["height"], resume["y"] - land["y"] - land["height"])
            assert max(across, along) >= 50 or (across >= 0 and along >= 10), (land, resume)
        view.take(Orderable(("hold", "land")))
        expect(order(page, "Resume")).to_be_disabled()
        assert {width: boxes_at(width) for width in WIDTHS} == before


def test_land_does_not_stand_beside_resume(browser: Browser) -> None:
    view = View(clock=standing)
    two(view, "start", "arm", "takeoff", "hold", "resume", "return", "land", "set item", simulated=True)
    with standing_page(browser, view, Taking()) as page:
        for width in WIDTHS:
            page.set_viewport_size({"width": width, "height": 800})
            land, resume = (order(page, name).bounding_box() for name in ("Land", "Resume"))
            # A finger's breadth between them, whichever way.
            across = max(land["x"] - resume["x"] - resume["width"], resume["x"] - land["x"] - land["width"])
            along = max(land["y"] - resume["y"] - resume["height"], resume["y"] - land["y"] - land["height"])
            assert max(across, along) >= 50 or (across >= 0 and along >= 10), (land, resume)


LOOKS = {
    "completed": "good",
    "failed": "bad",
    "crashed": "bad",
    "battery_depleted": "bad",
    "interrupted": "warn",
    "ended": "running",
}


def test_live_ends_with_the_run_and_a_failure_is_not_green(browser: Browser) -> None:
    view = View(clock=standing)
    two(view, "hold")
    # On standing clocks: the vehicles would be too old to be live on a busy machine.
    with standing_page(browser, view) as page:
        expect(page.locator(".connection")).to_have_text("Live")
        for outcome, look in LOOKS.items():
            view.take(RunEnded(9.0, outcome, ""))
            expect(page.locator(".connection")).to_have_text("Ended")
            pill = page.locator(".top .outcome")
            expect(pill).to_have_text(re.compile(re.escape(in_words(outcome)), re.IGNORECASE))
            expect(pill).to_have_attribute("data-state", look)
            colour = pill.evaluate("one => getComputedStyle(one).backgroundColor")
            red, green, blue = map(int, re.findall(r"\d+", colour)[:3])
            assert (green > red and green > blue) == (outcome == "completed")
            says_nothing_of_the_present(page)


# It gets old only where the test says so, however busy the machine is.
CLOCKS = """() => {
    window.ahead = { performance: 0, date: 0 };
    const [now, date] = [performance.now(), Date.now()];
    performance.now = () => now + ahead.performance;
    Date.now = () => date + ahead.date;
}"""


class Told:
    """A page whose program is played by hand: its beats come when the test sends them."""

    def __init__(self, browser: Browser, url: str, view: View) -> None:
        self.asked: list[dict[str, Any]] = []
        self.sockets: list[Any] = []
        self.page = browser.new_page()
        self.page.clock.install()
        self.page.add_init_script(f"({CLOCKS})()")
        self._update = view.update(None)[0].json().decode()
        self.page.route_web_socket(re.compile("/live"), self._open)
        self.page.goto(url)

    def _open(self, socket: Any) -> None:
        self.sockets.append(socket)
        socket.on_message(lambda text: self.asked.append(json.loads(text)))
        socket.send(self._update)

    def beats(self, time_s: float) -> None:
        self.sockets[-1].send(json.dumps({"time_s": 1.0, "beat": {"time_s": time_s, "silent_s": {}}}))

    def passes(self, ms: float, *clocks: str) -> None:
        for name in clocks or ("performance", "date"):
            self.page.evaluate(f"ahead.{name} += {ms}")

    @property
    def pill(self) -> Any:
        return self.page.locator(".connection")


@pytest.fixture
def told(browser: Browser) -> Iterator[Told]:
    view = View()
    two(view, "hold")
    with LiveServer(view) as server:
        one = Told(browser, server.url, view)
        yield one
        one.page.close()


def test_nothing_is_live_before_the_first_beat(told: Told) -> None:
    expect(told.page.locator(".card")).to_have_count(2)
    expect(told.pill).to_have_text("Connecting …")
    told.page.get_by_label("Orders go to").select_option("drone-1")
    expect(order(told.page, "Hold")).to_be_disabled()
    told.beats(0.0)
    expect(told.pill).to_have_text("Live")
    expect(order(told.page, "Hold")).to_be_enabled()


def test_an_age_is_told_before_what_is_shown_is_old(told: Told) -> None:
    told.beats(0.0)
    for ms, words in ((0, "Live"), (1_900, "Live"), (200, "2 s old"), (800, "2 s old")):
        told.passes(ms)
        told.page.clock.run_for(300)  # It looks four times a second
        expect(told.pill).to_have_text(words)
    told.passes(200)
    expect(told.pill).to_have_text("No news for 0:03")


@pytest.mark.parametrize("clocks", [("performance",), ("date",)])
def test_a_page_that_slept_is_old_whichever_clock_went_on(told: Told, clocks: tuple[str, ...]) -> None:
    told.beats(0.0)
    expect(told.pill).to_have_text("Live")
    told.passes(30_000, *clocks)
    expect(told.pill).to_have_text("No news for 0:30")


def test_beats_that_a_sleeping_page_kept_are_old_when_it_wakes(told: Told) -> None:
    told.beats(100.0)
    expect(told.pill).to_have_text("Live")
    told.passes(30_000)
    for kept_s in (101.0, 102.0, 103.0):
        told.beats(kept_s)
    expect(told.pill).to_have_text("No news for 0:26")
    told.beats(130.0)
    expect(told.pill).to_have_text("Live")


def test_clocks_that_drift_apart_make_nothing_old(told: Told) -> None:
    told.beats(0.0)
    for hours in range(1, 10):
        told.passes(3_600_500)  # Half a second an hour faster than the program's
        told.beats(3_600.0 * hours)
    expect(told.pill).to_have_text("Live")


def test_an_order_carries_the_newest_beat_and_the_time_since(told: Told) -> None:
    told.beats(50.0)
    told.page.get_by_label("Orders go to").select_option("drone-2")
    told.passes(1_500)
    order(told.page, "Hold").click()
    expect(told.page.locator(".became")).to_have_text("Hold, drone-2 …")
    told.beats(51.0)
    order(told.page, "Hold").click()
    first, second = told.asked
    assert (first["system_ids"], first["given"]["beat_s"], first["given"]["after_s"]) == ([2], 50.0, 1.5)
    assert second["given"]["beat_s"] == 51.0 and second["given"]["number"] > first["given"]["number"]


def test_nothing_that_was_ordered_is_sent_again_over_the_next_connection(told: Told) -> None:
    told.beats(0.0)
    told.page.get_by_label("Orders go to").select_option("drone-1")
    order(told.page, "Hold").click()
    expect(told.page.locator(".became")).to_have_text("Hold, drone-1 …")
    told.sockets[-1].close()
    expect(told.page.locator(".became")).to_have_text(
        "Hold, drone-1: not answered: the request may or may not have arrived"
    )
    expect(order(told.page, "Hold")).to_be_disabled()
    while len(told.sockets) < 2:
        told.page.wait_for_timeout(50)
    told.passes(60_000)  # The next connection has beats of its own
    told.beats(0.0)
    expect(told.page.get_by_label("Orders go to")).to_have_value("1")
    expect(order(told.page, "Hold")).to_be_enabled()
    assert len(told.asked) == 1


def test_an_order_that_is_clicked_before_its_button_is_off_is_not_sent(told: Told) -> None:
    told.beats(0.0)
    told.page.get_by_label("Orders go to").select_option("drone-1")
    expect(order(told.page, "Hold")).to_be_enabled()
    # The page wakes from a sleep with this click.
    told.page.evaluate(
        """() => {
            ahead.performance += 30000;
            ahead.date += 30000;
            document.querySelector("[data-order=hold]").click();
        }"""
    )
    expect(order(told.page, "Hold")).to_be_disabled()
    told.page.clock.run_for(300)  # It looks four times a second, and the message stays
    expect(told.page.locator(".became")).to_have_text("Hold, drone-1: not sent: the program does not answer")
    assert told.asked == []


def test_the_page_says_why_no_order_can_be_given(browser: Browser) -> None:
    view = View(clock=standing)
    view.take(RunBegun("a flight", get_farm("miniberry-10"), PAPER_FIELDS, (), simulated=True))
    view.take(Orderable(("hold", "land")))
    with standing_page(browser, view, Taking()) as page:
        why = page.locator(".why")
        expect(why).to_have_text("No vehicle has been heard yet: orders have nowhere to go.")
        two(view, "hold", "land", simulated=True)
        expect(why).to_have_text("Choose a vehicle: until then, orders go to no vehicle.")
        assert order(page, "Hold").get_attribute("aria-describedby") == why.get_attribute("id")
        for target in ("drone-2", "All 2 vehicles"):
            page.get_by_label("Orders go to").select_option(target)
            expect(why).to_be_empty()
        page.get_by_label("Orders go to").select_option("")
        expect(why).to_have_text("Choose a vehicle: until then, orders go to no vehicle.")
        view.take(Orderable(()))
        expect(why).to_have_text("The program takes no orders now.")
        view.take(RunEnded(9.0, "completed", ""))
        expect(why).to_be_empty()
        expect(page.locator(".controls")).to_be_hidden()


def test_what_an_order_came_to_is_told_below_it(browser: Browser) -> None:
    view = View(clock=standing)
    two(view, "takeoff", "hold", simulated=True)
    view.take(Noted("a warning of before", warns=True))
    with standing_page(browser, view, Taking()) as page:
        page.get_by_label("Orders go to").select_option("drone-1")
        view.take(Noted("a warning of nothing that was ordered", warns=True))
        expect(page.locator("ol.messages")).to_contain_text("nothing that was ordered")
        order(page, "Hold").click()
        expect(page.locator(".became")).to_have_text("Hold, drone-1: sent")
        view.take(Noted("vehicle 1: hold is carried out"))
        expect(page.locator("ol.messages")).to_contain_text("carried out")
        expect(page.locator(".became")).to_have_text("Hold, drone-1: sent")
        view.take(Noted("vehicle 1: hold: it is not flying", warns=True))
        expect(page.locator(".became.refused")).to_have_text("vehicle 1: hold: it is not flying")


LONG = "a title that is as long as those of policies with many parameters, and of farms with long names"
BOXES = """() => [...document.querySelectorAll("[data-order]")].map((one) => {
    const { x, y, width, height } = one.getBoundingClientRect();
    return [one.dataset.order, x, y, width, height];
})"""


def test_no_order_moves_whatever_the_page_says(browser: Browser) -> None:
    view = View()
    two(view)
    begun = partial(RunBegun, farm=get_farm("miniberry-10"), fields=PAPER_FIELDS, simulated=True)
    vehicles = tuple(VehicleInfo(number, f"drone-{number}", "copter") for number in (1, 2))
    longer = (VehicleInfo(1, LONG, "copter"), *vehicles)
    view.take(Orderable(("start",)))
    with LiveServer(view) as server:
        one = Told(browser, server.url, view)
        one.beats(0.0)
        expect(order(one.page, "Start")).to_be_visible()

        def places() -> dict[int, Any]:
            found = {}
            for width in WIDTHS:
                one.page.set_viewport_size({"width": width, "height": 800})
                found[width] = one.page.evaluate(BOXES)
            return found

        boxes = places()
        assert all(len(found) >= 6 for found in boxes.values())
        assert boxes[360] != boxes[700] != boxes[1280]

        def stays(why: str) -> None:
            one.page.clock.run_for(450)  # Panels are drawn anew
            assert places() == boxes, why

        def says(*events: Any) -> None:
            cursor = view.cursor
            for event in events:
                view.take(event)
            one.sockets[-1].send(view.update(cursor)[0].json().decode())
            stays(str(events))

        stays("it is live")
        says(begun(LONG, vehicles=vehicles))
        says(
            begun("a flight", vehicles=vehicles), Progressed("uploading the mission and its fence", 3.0, 10.0)
        )
        says(Orderable(("hold", "resume", "set item", "return", "land")))
        says(Asked(f"{LONG}?", ("hold", "return"), 7))
        says(Asked(""), Progressed("uploading", 10.0, 10.0))
        says(begun("a flight", vehicles=longer))
        for target in ("1", "2", "all", ""):
            one.page.get_by_label("Orders go to").select_option(target)
            stays(f"orders go to {target!r}")
        one.page.get_by_label("Orders go to").select_option("2")
        order(one.page, "Hold").click()
        stays("an order is on its way")
        says(Asked("the battery is low: what now?", ("hold", "return"), 8))
        answer = one.page.locator(".question").get_by_role("button", name="Return")
        place = answer.bounding_box()
        one.passes(2_200)
        stays("2 s old")
        one.passes(30_000)
        expect(one.page.locator(".lost")).not_to_be_empty()
        stays("old, with a banner")
        assert answer.bounding_box() == place
        one.beats(32.2)
        expect(one.page.locator(".lost")).to_be_empty()
        stays("live again")
        says(Orderable(()))
        says(Orderable(("start",)))
        one.sockets[-1].close()
        stays("the connection is lost")
        one.page.close()
