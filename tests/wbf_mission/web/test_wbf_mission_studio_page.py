"""The studio's page in a real browser: a field is drawn, the plan follows, and it is taken along."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from axe_playwright_python.sync_playwright import Axe
from live_page import chromium, page_at
from playwright.sync_api import Browser, Locator, Page, expect

from geo import load_farm
from mission.files import read_mission
from wbf_mission.scenario import Scenario
from wbf_mission.web.server import LiveServer
from wbf_mission.web.studio import Studio
from wbf_mission.web.view import View

pytestmark = pytest.mark.slow
PLANNED = re.compile(r"planned in")
SLOW_MS = 90_000


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as started:
        yield started


@pytest.fixture(scope="module")
def server() -> Iterator[LiveServer]:
    studio = Studio(Scenario(farm="miniberry-30", planner="lawnmower", budget="3min", estimator="point"))
    with LiveServer(View(), routes=studio.routes(), home="studio") as listening:
        studio.begin(listening)
        yield listening
    studio.close()


@pytest.fixture
def page(browser: Browser, server: LiveServer) -> Iterator[Page]:
    with page_at(browser, server.url, drawn=False) as opened:
        planned(opened)
        yield opened


def planned(page: Page) -> None:
    """Wait for the plan of what is drawn and chosen now."""
    expect(page.locator("#studio.stale")).to_have_count(0, timeout=SLOW_MS)
    expect(page.get_by_role("status").first).to_have_text(PLANNED, timeout=SLOW_MS)


def draw(page: Page, tool: str, *corners: tuple[float, float]) -> None:
    """Draw a ring on the map; corners are parts of its width and height."""
    page.get_by_role("button", name=tool, exact=True).click()
    box = page.locator(".map").bounding_box()
    assert box is not None
    for x, y in corners:
        page.mouse.click(box["x"] + x * box["width"], box["y"] + y * box["height"])


def figure(page: Page, name: str) -> Locator:
    return page.locator(".figures div", has_text=name).locator("dd")


FIELD = (0.2, 0.2), (0.8, 0.25), (0.75, 0.8), (0.25, 0.7)


def test_it_begins_with_the_plan_of_the_command_line(page: Page) -> None:
    expect(page.get_by_role("heading", level=1)).to_have_text("Studio: miniberry-30")
    expect(page.get_by_label("Planner")).to_have_value("lawnmower")
    expect(page.get_by_label("Budget")).to_have_value("3min")
    expect(figure(page, "Time")).to_contain_text("3 min")
    assert page.locator(".leaflet-plans-pane path").count() >= 2


def test_a_field_is_drawn_changed_and_taken_along(page: Page, tmp_path: Path) -> None:
    page.get_by_role("button", name="New farm").click()
    page.get_by_label("Go to latitude, longitude").fill("48.2, 16.4")
    page.get_by_label("Go to latitude, longitude").press("Enter")
    expect(page.get_by_role("status").first).to_have_text("draw a field")
    page.get_by_label("Budget").fill("12min")
    draw(page, "Field", *FIELD, FIELD[0])
    planned(page)
    draw(page, "Pond", (0.05, 0.04))  # Below what tells how to draw, which must not catch the click
    expect(page.locator(".hint")).to_have_text("1 of at least 3 corners")
    page.keyboard.press("Escape")
    draw(page, "Hole", (0.4, 0.4), (0.5, 0.4), (0.5, 0.5))
    page.keyboard.press("Enter")
    draw(page, "Obstacle", (0.6, 0.4), (0.62, 0.4), (0.62, 0.44), (0.6, 0.4))
    draw(page, "Home", (0.2, 0.75))
    planned(page)
    before = figure(page, "Time").text_content()
    page.get_by_label("Budget").fill("8min")
    planned(page)
    assert figure(page, "Time").text_content() != before

    with page.expect_download() as saved:
        page.get_by_role("button", name="Save farm").click()
    path = tmp_path / "farm.geojson"
    saved.value.save_as(path)
    farm = load_farm(path)
    assert [one.crop for one in farm.patches] == ["strawberry"]
    assert len(farm.patches[0].polygon.interiors) == 1
    assert farm.obstacles[0].height_m == 5
    assert abs(farm.frame.latitude_deg - 48.2) < 0.01
    with page.expect_download() as saved:
        page.get_by_role("button", name="Save file").click()
    assert saved.value.suggested_filename == "new-farm-lawnmower.plan"
    saved.value.save_as(tmp_path / "mission.plan")
    assert len(read_mission(tmp_path / "mission.plan").items) > 5

    page.locator("input[type=file]").set_input_files(path)
    planned(page)
    expect(page.locator(".shapes li")).to_have_count(2)


def test_keys_draw_move_undo_and_delete(page: Page) -> None:
    page.get_by_role("button", name="strawberries").click()
    corner = page.get_by_title("Corner 1", exact=True)
    corner.focus()
    page.keyboard.press("ArrowRight")
    expect(page.get_by_role("button", name="Undo")).to_be_enabled()
    expect(page.locator("#farms")).to_have_value("")
    expect(corner).to_be_focused()
    page.keyboard.press("Delete")
    expect(page.get_by_text("3 corners as numbers")).to_be_visible()
    page.keyboard.press("Control+z")
    page.keyboard.press("Control+z")
    expect(page.get_by_text("4 corners as numbers")).to_be_visible()
    expect(page.locator("#farms")).to_have_value("miniberry-30")
    planned(page)

    draw(page, "Pond", (0.4, 0.4), (0.5, 0.4))
    page.keyboard.press("Backspace")
    expect(page.locator(".hint")).to_have_text("1 of at least 3 corners")
    page.keyboard.press("Escape")
    expect(page.locator(".hint")).to_contain_text("Pond: click its corners")
    page.keyboard.press("Escape")
    expect(page.get_by_role("button", name="Select", exact=True)).to_have_attribute("aria-pressed", "true")
    expect(page.locator(".shapes li")).to_have_count(2)


def test_a_field_is_drawn_without_a_mouse(page: Page) -> None:
    page.get_by_role("button", name="Field", exact=True).focus()
    page.keyboard.press("Enter")
    page.locator(".map").focus()
    for key in (None, "ArrowRight", "ArrowDown"):
        if key is not None:
            page.keyboard.press(key)
            page.wait_for_timeout(500)  # The map moves
        page.keyboard.press(" ")
    expect(page.locator(".hint")).to_contain_text("3 corners")
    page.keyboard.press("Enter")
    expect(page.locator(".shapes li")).to_have_count(3)
    planned(page)


def test_a_border_that_crosses_itself_is_mended(page: Page) -> None:
    page.get_by_role("button", name="strawberries").click()
    page.get_by_text("4 corners as numbers").click()

    def corner(number: int) -> tuple[Locator, Locator]:
        names = (f"Outline, {what} of corner {number}" for what in ("latitude", "longitude"))
        lat, lon = (page.get_by_label(name, exact=True) for name in names)
        return lat, lon

    (south, west), (_, east), (north, _) = (
        (float(lat.input_value()), float(lon.input_value())) for lat, lon in (corner(k) for k in (1, 2, 3))
    )
    page.get_by_label("Add a corner after corner 1", exact=True).click()
    for box, value in zip(
        corner(2), (south + 0.03 * (north - south), east + 0.02 * (east - west)), strict=True
    ):
        box.fill(f"{value:.8f}")
        box.press("Tab")
    expect(page.locator(".results [role=alert]")).to_contain_text("--repair", timeout=SLOW_MS)
    page.get_by_role("button", name="Mend it").click()
    planned(page)
    expect(page.locator(".hint")).to_contain_text("mended")
    expect(page.locator(".results [role=alert]")).to_be_empty()
    expect(page.get_by_role("button", name="Mend it")).to_be_hidden()


def test_corners_are_dragged_and_added(page: Page) -> None:
    page.get_by_role("button", name="strawberries").click()
    corner = page.get_by_title("Corner 3", exact=True)
    place = corner.bounding_box()
    assert place is not None
    corner.drag_to(
        page.locator(".map"), target_position={"x": place["x"] + 60, "y": place["y"] - 40}, force=True
    )
    expect(page.locator(".hint")).to_have_text("Corner moved")
    page.get_by_title("New corner after corner 1", exact=True).click()
    expect(page.get_by_text("5 corners as numbers")).to_be_visible()
    page.get_by_title("Corner 2", exact=True).click(button="right")
    expect(page.get_by_text("4 corners as numbers")).to_be_visible()
    planned(page)


def test_corners_are_edited_as_numbers(page: Page) -> None:
    page.get_by_role("button", name="tomatoes").click()
    page.get_by_text("4 corners as numbers").click()
    latitude = page.get_by_label("Outline, latitude of corner 3")
    latitude.fill(str(float(latitude.input_value()) + 1e-5))
    latitude.press("Tab")
    planned(page)
    page.get_by_label("Add a corner after corner 1", exact=True).click()
    expect(page.get_by_text("5 corners as numbers")).to_be_visible()
    page.get_by_label("Crop", exact=True).fill("Maize")
    page.get_by_label("Crop", exact=True).press("Tab")
    expect(page.locator(".shapes li").nth(1)).to_contain_text("maize")
    planned(page)


def test_what_cannot_be_planned_is_told_and_goes_away(page: Page) -> None:
    page.get_by_label("Budget").fill("much")
    expect(page.locator(".results [role=alert]")).to_contain_text(
        "Budget 'much' is not understood", timeout=SLOW_MS
    )
    expect(page.get_by_role("button", name="Save file")).to_be_disabled()
    page.get_by_label("Policy").select_option("greedy")
    page.get_by_label("Budget").fill("2min")
    planned(page)
    expect(page.get_by_label("Planner")).to_be_disabled()
    expect(page.locator(".results [role=alert]")).to_be_empty()


def test_a_number_out_of_its_range_is_told_and_nothing_is_planned(page: Page) -> None:
    planned(page)
    page.get_by_label("Wind speed, m/s").fill("99")
    expect(page.get_by_text("99.0 is out of range: give 0 to 40 m/s")).to_be_visible()
    expect(page.get_by_role("status").first).to_have_text("no plan")
    page.get_by_label("Wind speed, m/s").fill("4")
    planned(page)


def test_names_of_a_file_are_text(page: Page, tmp_path: Path) -> None:
    name = '<img src="x" onerror="document.title=1">'
    ring = [[-82.15, 28.05], [-82.149, 28.05], [-82.149, 28.051], [-82.15, 28.05]]
    feature = {
        "type": "Feature",
        "properties": {"name": name, "crop": "tomato", "owner": name},
        "geometry": {"type": "Polygon", "coordinates": [ring]},
    }
    path = tmp_path / "bad.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "name": name, "features": [feature]}))
    page.locator("input[type=file]").set_input_files(path)
    expect(page.get_by_role("heading", level=1)).to_have_text(f"Studio: {name}")
    expect(page.locator(".shapes li")).to_contain_text(name)
    planned(page)
    assert page.locator("img[src=x]").count() == 0
    path.write_text("{}")
    page.locator("input[type=file]").set_input_files(path)
    expect(page.locator(".results [role=alert]")).to_contain_text("Farm file bad.geojson")


def test_an_upload_is_confirmed(page: Page) -> None:
    page.get_by_role("button", name="Upload to a vehicle").click()
    dialog = page.get_by_role("dialog")
    dialog.get_by_label("Link").fill("nonsense")
    dialog.get_by_role("button", name="Upload", exact=True).click()
    expect(dialog).to_be_visible()  # It was not confirmed
    dialog.get_by_label("Replace the vehicle's mission").check()
    dialog.get_by_role("button", name="Upload", exact=True).click()
    expect(page.locator(".told")).to_contain_text("nonsense")


def test_it_is_flown_and_watched(page: Page) -> None:
    page.get_by_label("Speed", exact=True).select_option("10")
    page.get_by_role("button", name="Fly it in the simulator").click()
    with page.context.expect_page() as opened:
        page.get_by_role("link", name="Watch the flight").click()
    live = opened.value
    expect(live.get_by_role("heading", level=1)).to_contain_text("miniberry-30", timeout=SLOW_MS)
    expect(live.locator(".vehicle")).to_have_count(1, timeout=SLOW_MS)
    page.get_by_role("button", name="Stop").click()
    expect(page.locator(".told")).to_have_text("The flight is stopped")
    expect(live.locator(".top .outcome")).to_contain_text("nterrupted", timeout=SLOW_MS)
    live.close()


@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (1280, "dark"), (360, "light")])
def test_it_is_accessible_and_fits(browser: Browser, server: LiveServer, width: int, scheme: str) -> None:
    options = {"viewport": {"width": width, "height": 760}, "color_scheme": scheme}
    with page_at(browser, server.url, drawn=False, **options) as page:
        planned(page)
        page.get_by_role("button", name="tomatoes").click()
        for summary in page.locator("summary").all():
            if summary.is_visible():
                summary.click()
        assert [one["id"] for one in Axe().run(page).response["violations"]] == []
        assert page.evaluate("document.documentElement.scrollWidth") <= width
