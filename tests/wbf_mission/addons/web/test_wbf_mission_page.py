"""The page of a run in a real browser: what it shows, what it lets do, and how it looks."""

from __future__ import annotations

import io
import itertools
import json
import math
import re
import sqlite3
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from live_page import page_at, standing, standing_page
from PIL import Image, ImageChops
from playwright.sync_api import Browser, Page, expect
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route
from viewer import Taking

from geo import Farm
from geo.farms import get_farm
from geo.frame import LocalFrame
from mission.model import Mission, MissionItem
from mission.policies.decision import Alternative
from sensors.dynamics.continuous import Measured
from sensors.fields import PAPER_FIELDS, Field, FieldSet
from sensors.observations import Observations
from sensors.scoring.information import InformationModel
from wbf_mission.addons.base.markup import data_element
from wbf_mission.addons.web import server
from wbf_mission.addons.web.server import LiveServer
from wbf_mission.addons.web.view import View
from wbf_mission.events import (
    Asked,
    DayBegun,
    Decided,
    Estimated,
    Event,
    Noted,
    Orderable,
    Planned,
    RunBegun,
    RunEnded,
    Seen,
    VehicleInfo,
    VehicleMoved,
    VehicleSaid,
)
from wbf_mission.replanning.record import DecisionRecord, PathChange

GREY = Field("grey", Measured(), ("all",), default=0.5, colours=("#000000", "#ffffff"))
FARM = get_farm("miniberry-10")
SHAPE = FARM.width_cells, FARM.height_cells
BAD = '<img src="x" onerror="document.title=1">'
HEAR = """() => {
    const lost = document.querySelector(".lost");
    window.heard = [];
    new MutationObserver(() => heard.push(lost.textContent)).observe(lost, { childList: true });
}"""
STILL = "() => new Promise(done => requestAnimationFrame(() => setTimeout(done, 300)))"


@pytest.fixture
def view() -> View:
    return View(share=1.0)


def begun(
    fields: FieldSet | None = PAPER_FIELDS, farm: Farm = FARM, names: tuple[str, ...] = ("one",)
) -> RunBegun:
    vehicles = tuple(VehicleInfo(k, name, "copter") for k, name in enumerate(names, 1))
    return RunBegun("a flight", farm, fields, vehicles)


def moved(time_s: float, system_id: int = 1, **more: Any) -> VehicleMoved:
    place = 1.0 + 0.2 * time_s % 2.0, 0.3 * system_id
    return VehicleMoved(time_s, 1, 1, system_id, *place, 5.0, 2.5, **{"battery": 0.75, "mode": "AUTO"} | more)


def estimated(values: np.ndarray, time_s: float, fields: FieldSet) -> Estimated:
    known = np.full_like(values, 0.25)
    return Estimated(time_s, 1, 9, InformationModel(values, known, fields=fields.names), None)


def told(view: View, *events: Event) -> None:
    for event in events:
        view.take(event)


def a_flight(names: tuple[str, ...] = ("one",)) -> list[Event]:
    """A short run with something of everything."""
    truth = np.full((3, *SHAPE), 0.9, np.float32)
    path = np.array([[0.5, 0.5], [2.5, 0.5], [2.5, 2.5], [0.5, 2.5]])
    mission = Mission(tuple(MissionItem.waypoint(*FARM.frame.to_wgs84(*place), 5.0) for place in path))
    cells = np.arange(4)
    seen = Observations(cells, cells, cells * 1.0, np.ones(4), np.array([[1.0, 0.5, 0.2]] * 4))
    events: list[Event] = [begun(names=names), DayBegun(0.0, 1, truth)]
    for k in range(1, len(names) + 1):
        events.append(Planned(0.0, 1, 1, k, mission, path, 60.0, 6.0, 0.5))
        events += [moved(float(time_s), k) for time_s in range(11)]
    events += [
        Seen(0.0, seen),
        estimated(truth * 0.9, 5.0, PAPER_FIELDS),
        VehicleSaid(2.0, 1, 6, "Mission: 1 WP"),
        VehicleSaid(6.0, 1, 3, "Battery failsafe"),
        Noted("the vehicle is heard"),
    ]
    return events


def uncover(page: Page) -> None:
    """Show the values alone, as they are."""
    for label in ("Crops", "Plans and fences", "Trails", "Camera readings"):
        page.get_by_label(label).uncheck()
    page.get_by_label("Opacity").fill("1")
    page.evaluate(STILL)


def looked(page: Page) -> Image.Image:
    return Image.open(io.BytesIO(page.screenshot())).convert("RGB")


def cells_in_sight(page: Page, farm: Farm) -> dict[tuple[int, int], tuple[float, float]]:
    """Find cells by latitude and longitude told under the pointer; without borders and home."""
    box = page.locator(".map").bounding_box()
    assert box is not None
    found, home = {}, np.array(farm.home_m) // farm.cell_size_m
    for left in np.linspace(box["x"] + 420, box["x"] + box["width"] - 150, 15):
        for top in np.linspace(box["y"] + 20, box["y"] + box["height"] - 120, 12):
            page.mouse.move(left, top)
            text = page.locator(".under-pointer").text_content() or ""
            place = re.search(r"(-?\d+\.\d{7}), (-?\d+\.\d{7})", text)
            assert place is not None
            x, y = (float(m) / farm.cell_size_m for m in farm.frame.from_wgs84(*map(float, place.groups())))
            cell = int(x // 1), int(y // 1)
            inside = 0 <= cell[0] < farm.width_cells and 0 <= cell[1] < farm.height_cells
            if inside and math.dist(cell, home) > 1.5 and all(0.2 < part % 1 < 0.8 for part in (x, y)):
                found[cell] = left, top
    page.mouse.move(box["x"] + 20, box["y"] + box["height"] - 5)
    return found


@pytest.mark.slow
@pytest.mark.parametrize("rotation_deg", [0.0, 33.0])
def test_the_map_shows_what_the_data_say_where_they_say_it(
    browser: Browser, view: View, rotation_deg: float
) -> None:
    farm = replace(FARM, frame=LocalFrame(28.05, -82.15, rotation_deg=rotation_deg))
    fields = FieldSet((GREY,))
    values = np.random.default_rng(1).random((1, *SHAPE), np.float32)
    told(view, begun(fields, farm), estimated(values, 1.0, fields))
    with LiveServer(view) as server, page_at(browser, server.url) as page:
        page.wait_for_selector(".ramp")
        uncover(page)
        cells = cells_in_sight(page, farm)
        assert len(cells) > 15
        for shown in (values, 1.0 - values):
            told(view, estimated(shown, 2.0, fields))
            page.wait_for_timeout(700)
            picture = looked(page)
            for (x, y), place in cells.items():
                assert picture.getpixel((round(place[0]), round(place[1]))) == pytest.approx(
                    (255 * shown[0, x, y],) * 3, abs=2.0
                )
        (x, y), place = next(iter(cells.items()))
        page.mouse.move(*place)
        expect(page.locator(".under-pointer")).to_contain_text(f"grey, estimate {1 - values[0, x, y]:.2f}")


@pytest.mark.slow
def test_the_truth_is_compared_with_the_estimate_left_and_right_of_a_handle(
    browser: Browser, view: View
) -> None:
    fields = FieldSet((GREY,))
    told(view, begun(fields), DayBegun(0.0, 1, np.ones((1, *SHAPE), np.float32)))
    told(view, estimated(np.zeros((1, *SHAPE), np.float32), 1.0, fields))
    with LiveServer(view) as server, page_at(browser, server.url) as page:
        page.get_by_label("Compare with truth").check()
        uncover(page)
        handle = page.get_by_label("Estimate left, truth right of here")
        handle.fill("1")
        cells = cells_in_sight(page, FARM)
        for split, is_true in (("1", False), ("0", True)):
            handle.fill(split)
            page.evaluate(STILL)
            picture = looked(page)
            assert {picture.getpixel((round(x), round(y))) for x, y in cells.values()} == {
                (255 * is_true,) * 3
            }


def test_orders_are_sent_as_they_are_given_and_motors_start_only_after_a_second_word(
    browser: Browser, view: View
) -> None:
    orders = Taking({"land": "it is not flying"})
    told(view, *a_flight(("one", "two")), Orderable(("start", "hold", "land", "set item")))
    with LiveServer(view, orders=orders) as server, page_at(browser, server.url) as page:
        page.get_by_label("Orders go to").select_option("two")
        page.get_by_role("button", name="Hold").click()
        expect(page.locator(".became")).to_have_text("Hold, two: sent")
        page.get_by_role("button", name="Land").click()
        expect(page.locator(".became")).to_have_text("Land, two: not done: it is not flying")
        page.get_by_role("button", name="Start").click()
        dialog = page.get_by_role("dialog")
        expect(dialog).to_contain_text("Start: two")
        dialog.get_by_role("button", name="Cancel").click()
        page.get_by_role("button", name="Start").click()
        dialog.get_by_role("button", name="Yes").click()
        page.get_by_role("button", name="Set item").click()
        dialog.get_by_label("Item number").fill("3")
        page.keyboard.press("Enter")
        told(view, Asked("start the motors?", ("yes", "no"), 5))
        page.get_by_role("button", name="No", exact=True).click()
        told(view, Asked(""))
        expect(page.locator(".question")).to_be_hidden()
    assert orders.taken == [
        ([2], "hold", "", False),
        ([2], "land", "", False),
        ([2], "start", "", True),
        ([2], "set item", "3", False),
        ("no", 5),
    ]


def test_a_page_that_only_shows_has_no_orders(browser: Browser, view: View) -> None:
    told(view, *a_flight())
    with LiveServer(view) as server, page_at(browser, server.url) as page:
        expect(page.get_by_text("Battery failsafe").first).to_be_visible()
        expect(page.locator(".controls")).to_be_hidden()


def test_layers_are_those_that_are_known_of_crops_that_the_farm_has(browser: Browser, view: View) -> None:
    field = replace(FARM, patches=tuple(replace(one, crop="strawberry") for one in FARM.patches))
    truth = np.full((3, *SHAPE), 0.9, np.float32)
    told(view, begun(farm=field), DayBegun(0.0, 1, truth), replace(moved(1.0), height_m=-0.04))
    with LiveServer(view) as server, page_at(browser, server.url) as page:
        fields = page.locator("fieldset", has_text="soil humidity").get_by_role("radio")
        expect(fields).to_have_count(2)
        expect(page.get_by_role("radio", name="charcoal rot (strawberry)")).to_be_checked()
        expect(page.get_by_role("radio", name="Truth")).to_be_visible()
        expect(page.get_by_role("radio", name="None")).to_be_checked()
        expect(page.locator(".controls")).to_be_hidden()  # This page gives no orders
        expect(page.locator(".card")).to_contain_text("0.0 m")
        expect(page.locator(".card")).not_to_contain_text("-0.0 m")


def test_cards_tell_how_each_vehicle_is_and_messages_what_it_said(browser: Browser) -> None:
    view = View(share=1.0, clock=standing)
    told(view, *a_flight(("one", "two")), moved(11.0, 2, battery=0.1, silent_s=9.0))
    with standing_page(browser, view) as page:
        first, second = page.locator(".card").all()
        for text in ("one", "75 %", "AUTO", "5.0 m", "2.5 m/s"):
            expect(first).to_contain_text(text.replace(" %", "\u00a0%"))
        expect(second).to_contain_text("no news for 0:09")
        expect(second).to_have_class(re.compile("silent.*low"))
        view.take(replace(moved(12.0), phase="waiting until the vehicle can arm"))
        expect(first).to_contain_text("waiting until")
        name = first.locator(".name").bounding_box()
        assert name is not None and name["width"] > 60, "a long phase leaves room for the name"
        expect(page.locator(".vehicle.silent")).to_have_count(1)
        assert page.locator(".legend .key").all_inner_texts() == ["strawberry", "tomato", "seen sick"]
        expect(page.locator("ol.messages li").first).to_contain_text("the vehicle is heard")
        expect(page.locator("ol.messages .error")).to_have_text(re.compile("one Error: Battery failsafe"))


def test_dragging_goes_back_in_a_run_that_goes_on_and_live_returns(browser: Browser, view: View) -> None:
    told(view, *a_flight())
    with LiveServer(view) as server, page_at(browser, server.url) as page:
        clock, slider = page.locator(".clock"), page.get_by_label("Time of the run")
        expect(clock).to_have_text("0:10 / 0:10")
        slider.fill("1")
        expect(clock).to_have_text("0:01 / 0:10")
        expect(page.locator("ol.messages")).not_to_contain_text("Battery failsafe")
        told(view, moved(20.0))
        expect(clock).to_have_text("0:01 / 0:20")
        slider.press("ArrowRight")
        expect(clock).to_have_text("0:06 / 0:20")
        page.get_by_role("button", name="Latest").click()
        expect(clock).to_have_text("0:20 / 0:20")
        told(view, moved(25.0))
        expect(clock).to_have_text("0:25 / 0:25")


def test_a_lost_connection_is_told_and_found_again_where_the_reader_looked(
    browser: Browser, view: View
) -> None:
    told(view, *a_flight())
    with LiveServer(view) as server:
        port = server.port
        page = browser.new_page()
        page.clock.install()
        page.goto(server.url)
        expect(page.locator(".connection")).to_have_text("Live")
        page.get_by_role("button", name="Zoom in").click()
        page.get_by_label("Uncertainty").check(force=True)
        page.evaluate(STILL)
        before = page.locator(".vehicle").bounding_box()
    expect(page.locator(".lost")).to_contain_text("The connection to the program is lost")
    page.evaluate(HEAR)
    page.clock.run_for(4_500)  # It tries again meanwhile, and its data get old
    assert page.evaluate("heard") == [], "it is read aloud once"
    told(view, VehicleSaid(12.0, 1, 6, "here again"))
    with LiveServer(view, port=port):
        expect(page.locator(".connection")).to_have_text("Live", timeout=20_000)
        expect(page.locator(".lost")).to_be_empty()
        expect(page.locator("ol.messages li").first).to_contain_text("here again")
        expect(page.locator(".card")).to_have_count(1)
        assert page.get_by_label("Uncertainty").is_checked()
        assert page.locator(".vehicle").bounding_box() == before
        page.close()


@pytest.mark.parametrize(("dark", "width"), [(False, 1280), (True, 360)])
def test_dark_and_light_wide_and_narrow_it_fits_and_everybody_can_use_it(
    browser: Browser, view: View, dark: bool, width: int
) -> None:
    told(view, *a_flight(("one", "a vehicle with a rather long name, longer than any card is wide")))
    told(view, Orderable(("start", "hold")), Asked("start the motors?", ("yes", "no")))
    look: dict[str, Any] = {
        "viewport": {"width": width, "height": 780},
        "color_scheme": "dark" if dark else "light",
    }
    with LiveServer(view, orders=Taking()) as server, page_at(browser, server.url, **look) as page:
        expect(page.locator(".card")).to_have_count(2)
        brightness = sum(looked(page).resize((1, 1)).getpixel((0, 0)))
        assert (brightness < 3 * 110) == dark
        for panel in ("Charts", "Messages", "Vehicles") if width < 600 else ("",):
            if panel:
                page.get_by_role("button", name=panel).click()
            assert page.evaluate("document.documentElement.scrollWidth") == width
            found = Axe().run(page).response["violations"]
            assert [
                (one["id"], one["nodes"][0]["html"])
                for one in found
                if one["impact"] in ("serious", "critical")
            ] == []


def test_decisions_tell_why_and_their_candidates_are_on_the_map(browser: Browser, view: View) -> None:
    taken, refused = (np.array([[0.3, y], [2.7, y]]) for y in (2.0, 2.6))
    record = DecisionRecord(
        *(1, 1, 4.0, "observations", 9, "two plants are sick"),
        changes=[PathChange(1, (0.3, 2.0), taken, 5.0)],
        alternatives=(Alternative(1, taken, 3.0, 5.0), Alternative(1, refused, 1.0, 4.0)),
    )
    told(view, *a_flight())
    with LiveServer(view) as server, page_at(browser, server.url) as page:
        page.get_by_label("Plans and fences").uncheck()
        before = looked(page)
        assert page.locator(".panel.decisions").is_hidden()
        told(view, Decided(4.0, record))
        page.locator(".decisions summary").click()
        expect(page.locator(".decisions details")).to_contain_text("Two plants are sick")
        expect(page.locator(".decided > .small")).to_have_text(
            "This policy has shown no acquisition map yet."
        )
        rows = page.locator(".decisions tbody tr").all()
        assert [row.inner_text().split("\t")[:3] for row in rows] == [
            ["one \N{CHECK MARK}", "3.00", "5.00"],
            ["one", "1.00", "4.00"],
        ]
        page.evaluate(STILL)
        box = page.locator(".map").bounding_box()
        assert box is not None
        part = tuple(round(box[side]) + more for side, more in (("x", 400), ("y", 0), ("x", 860), ("y", 400)))
        assert ImageChops.difference(before.crop(part), looked(page).crop(part)).getbbox() is not None
        record.changes[0].outcome = "flown"
        told(view, moved(12.0))
        expect(page.locator(".decisions .outcome")).to_have_text("flown")


def test_vehicles_are_followed_where_nobody_says_over_which_farm(browser: Browser, view: View) -> None:
    told(view, RunBegun("watched", None, None, (VehicleInfo(7, "seven", "plane"),)))
    with LiveServer(view) as server, page_at(browser, server.url, drawn=False) as page:
        for k in range(5):
            told(view, replace(moved(k / 1.0, 7), x_m=1e3 * k, y_m=-500.0 * k))
            page.wait_for_timeout(250)
            mark, room = page.locator(".vehicle").bounding_box(), page.locator(".map").bounding_box()
            assert mark is not None and room is not None
            assert room["x"] < mark["x"] < room["x"] + room["width"]
            assert room["y"] < mark["y"] < room["y"] + room["height"]


def test_the_users_own_tiles_are_behind_the_farm(browser: Browser, view: View, tmp_path: Path) -> None:
    tile = io.BytesIO()
    Image.new("RGB", (256, 256), (10, 20, 200)).save(tile, "PNG")
    with sqlite3.connect(tmp_path / "own.mbtiles") as database:
        database.execute("create table metadata (name text, value text)")
        zoom, farm = 18, get_farm("miniberry-100")
        facts = {"format": "png", "minzoom": "0", "maxzoom": f"{zoom}", "attribution": "<b>own</b> pictures"}
        database.executemany("insert into metadata values (?, ?)", facts.items())
        database.execute("create table tiles (zoom_level, tile_column, tile_row, tile_data)")
        column = int((farm.frame.longitude_deg + 180) / 360 * 2**zoom)
        north = math.asinh(math.tan(math.radians(farm.frame.latitude_deg))) / math.pi
        row = int((1 + north) / 2 * 2**zoom)
        for x, y in itertools.product((-1, 0, 1), repeat=2):
            values = zoom, column + x, row + y, tile.getvalue()
            database.execute("insert into tiles values (?, ?, ?, ?)", values)
    told(view, begun(farm=farm))
    with LiveServer(view, tiles=tmp_path / "own.mbtiles") as server, page_at(browser, server.url) as page:
        expect(page.locator(".leaflet-control-attribution")).to_contain_text("own")
        page.wait_for_selector(".leaflet-tile-loaded")
        page.get_by_label("Crops").uncheck()
        page.wait_for_timeout(500)
        box = page.locator(".map").bounding_box()
        assert box is not None
        beside = round(box["x"] + box["width"] - 60), round(box["y"] + box["height"] - 80)
        assert looked(page).getpixel(beside) == (10, 20, 200)


def test_everything_is_reached_by_keys_and_seen_when_it_is(browser: Browser, view: View) -> None:
    told(view, *a_flight(("one", "two")), Orderable(("hold",)))
    with LiveServer(view, orders=Taking()) as server, page_at(browser, server.url) as page:
        page.get_by_label("Orders go to").select_option("one")
        expect(page.get_by_role("button", name="Hold")).to_be_enabled()
        reached = []
        for _ in range(60):
            page.keyboard.press("Tab")
            reached.append(
                page.evaluate(
                    """() => {
                        const one = document.activeElement;
                        if (one === document.body) return ["", true];  // After the last element
                        const seen = one.matches(".segments input") ? one.nextElementSibling : one;
                        const name = one.getAttribute("aria-label") || one.closest("label")?.textContent;
                        return [name || one.textContent, getComputedStyle(seen).outlineStyle !== "none"];
                    }"""
                )
            )
        names = " | ".join(name for name, _ in reached)
        for name in ("Hold", "Zoom in", "Vehicle one", "Layers", "TYLCV", "Estimate", "Opacity", "Crops"):
            assert name in names
        for name in ("Show all", "Play", "Time of the run", "Speed of playing", "Latest", "two", "Messages"):
            assert name in names
        assert [name for name, is_seen in reached if not is_seen] == []


def test_names_are_text_and_never_markup(browser: Browser, view: View) -> None:
    obstacle = replace(get_farm("miniberry-10"), name=BAD)
    event = replace(begun(farm=obstacle, names=(BAD, BAD)), title=BAD)
    told(view, event, moved(1.0), moved(1.0, 2), VehicleSaid(1.0, 1, 2, BAD), RunEnded(2.0, BAD, BAD))
    told(view, Asked(BAD, (BAD,)), Orderable((BAD,)))
    with LiveServer(view, orders=Taking()) as server, page_at(browser, server.url) as page:
        for place in (
            "h1",
            ".card .name",
            ".vehicle .name",
            "ol.messages .text",
            ".question p",
            ".controls .group:nth-child(2) button:last-child",
        ):
            expect(page.locator(place).first).to_contain_text(BAD, ignore_case=True)
        assert page.locator("img").count() == 0
        assert BAD in page.title()


def recording(view: View) -> str:
    """Return a page with the recording of a run, as `source.ts` asks for it."""
    whole = json.loads(view.update(None)[0].json())
    moment = {"time_s": 5.0, "day": 1, "observations": 4}
    moment |= {name: whole.pop(name) for name in ("tiles", "scales")}
    data = data_element("recording", [whole | {"moments": [moment]}], packed=True)
    page = (Path(server.__file__).parent / "static" / "live.html").read_text()
    return page.replace('<div id="app">', f'{data}<div id="app">')


def serving(text: str, view: View) -> LiveServer:
    async def answer(_: Request) -> Response:
        return Response(text, media_type="text/html")

    return LiveServer(view, routes=[Route("/recording", answer)])


def test_a_recording_is_played_and_sought_by_keys(browser: Browser, view: View) -> None:
    told(view, *a_flight(), RunEnded(10.0, "completed", ""))
    with serving(recording(view), view) as server, page_at(browser, server.url + "recording") as page:
        clock, slider = page.locator(".clock"), page.get_by_label("Time of the run")
        expect(page.locator(".connection")).to_have_text("Recording")
        expect(clock).to_have_text("0:10 / 0:10")
        expect(page.locator(".top .outcome")).to_have_text("Completed")
        slider.focus()
        page.keyboard.press("ArrowLeft")
        expect(clock).to_have_text("0:05 / 0:10")
        expect(page.locator("ol.messages")).not_to_contain_text("Battery failsafe")
        page.get_by_label("Speed of playing").select_option("2")
        page.locator("h1").click()
        page.keyboard.press("Space")
        expect(page.get_by_role("button", name="Pause")).to_be_visible()
        expect(clock).to_have_text("0:10 / 0:10")
        expect(page.get_by_role("button", name="Play")).to_be_visible()
