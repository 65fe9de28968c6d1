"""The studio's page in a real browser: a field is drawn, the plan follows, and it is taken along."""

from __future__ import annotations

import contextlib
import json
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from axe_playwright_python.sync_playwright import Axe
from live_page import page_at
from playwright.sync_api import Browser, Error, Locator, Page, Route, expect

from geo import load_farm
from mission.files import read_mission
from wbf_mission.addons.web.server import LiveServer
from wbf_mission.addons.web.studio import Studio
from wbf_mission.addons.web.view import View
from wbf_mission.scenario import Scenario

pytestmark = pytest.mark.slow
DATA = Path(__file__).parents[3] / "data" / "studio"
PLANNED = re.compile(r"planned in")
SLOW_MS = 90_000


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
    click_ring(page, *corners)


def click_ring(page: Page, *corners: tuple[float, float]) -> None:
    box = page.locator(".map").bounding_box()
    assert box is not None
    for x, y in corners:
        page.mouse.click(box["x"] + x * box["width"], box["y"] + y * box["height"])


def figure(page: Page, name: str) -> Locator:
    return page.locator(".figures div", has_text=name).locator("dd")


FIELD = (0.2, 0.2), (0.8, 0.25), (0.75, 0.8), (0.25, 0.7)


def test_the_plan_of_an_older_draft_is_not_shown(page: Page) -> None:
    held: list[Route] = []
    page.route("**/api/plan*", lambda route: held.append(route))
    page.get_by_label("Budget").fill("2min")
    while not held:
        page.wait_for_timeout(10)
    answer = held[0].fetch()
    page.get_by_label("Budget").fill("1min")
    with contextlib.suppress(Error):  # The page may have closed the connection
        held[0].fulfill(response=answer)
    page.wait_for_timeout(100)
    expect(page.locator("#studio.stale")).to_have_count(1)
    while len(held) < 2:
        page.wait_for_timeout(10)
    held[1].continue_()
    planned(page)


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
    expect(page.locator(".problem")).to_contain_text("'Mend it' mends", timeout=SLOW_MS)
    page.get_by_role("button", name="Mend it").click()
    planned(page)
    expect(page.locator(".hint")).to_contain_text("mended")
    expect(page.locator(".problem")).to_be_empty()
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


def test_what_cannot_be_planned_is_told_and_goes_away(page: Page) -> None:
    page.get_by_label("Budget").fill("much")
    expect(page.locator(".problem")).to_contain_text("Budget 'much' is not understood", timeout=SLOW_MS)
    expect(page.get_by_role("button", name="Save file")).to_be_disabled()
    page.get_by_label("Policy").select_option("greedy")
    page.get_by_label("Budget").fill("2min")
    planned(page)
    expect(page.get_by_label("Planner")).to_be_disabled()
    expect(page.locator(".problem")).to_be_empty()


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


def test_a_bad_file_leaves_the_open_farm_as_it_was(page: Page, tmp_path: Path) -> None:
    time = figure(page, "Time").text_content()
    path = tmp_path / "bad.geojson"
    path.write_text("{}")
    page.locator("input[type=file]").set_input_files(path)
    expect(page.locator(".unopened")).to_contain_text("Farm file bad.geojson")
    page.locator("input[type=file]").set_input_files(DATA / "bowtie.geojson")
    expect(page.locator(".unopened")).to_contain_text("cannot be mended safely")
    expect(page.locator(".unopened button")).to_have_count(0)
    assert figure(page, "Time").text_content() == time
    expect(page.locator(".problem")).to_be_empty()
    expect(page.get_by_role("status").first).to_have_text(PLANNED)
    expect(page.get_by_role("button", name="Save file")).to_be_enabled()
    expect(page.get_by_role("heading", level=1)).to_have_text("Studio: miniberry-30")
    expect(page.locator(".shapes li")).to_have_count(2)
    expect(page.get_by_role("button", name="Undo")).to_be_disabled()


def test_a_file_without_what_it_needs_is_opened_on_request(page: Page, tmp_path: Path) -> None:
    ring = [[-82.15, 28.05], [-82.149, 28.05], [-82.149, 28.051], [-82.15, 28.05]]
    features = [
        {"type": "Feature", "properties": given, "geometry": {"type": "Polygon", "coordinates": [ring]}}
        for given in ({"crop": "tomato"}, {})
    ]
    path = tmp_path / "halves.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    page.locator("input[type=file]").set_input_files(path)
    page.get_by_role("button", name="Crop: strawberry").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("Studio: halves")
    expect(page.locator(".shapes li").nth(1)).to_contain_text("strawberry")
    expect(page.locator(".unopened")).to_be_empty()


def test_what_was_said_before_an_upload_is_not_said_of_one_that_is_cancelled(page: Page) -> None:
    with page.expect_download():
        page.get_by_role("button", name="Save file").click()
    expect(page.locator(".told")).to_contain_text("Saved as")
    page.get_by_role("button", name="Upload to a vehicle").click()
    expect(page.locator(".told")).to_be_empty()
    page.keyboard.press("Escape")
    expect(page.locator(".told")).to_have_text("Nothing was uploaded")


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
    expect(page.locator(".told")).to_have_text(
        re.compile(r"The flight: interrupted: stopped after \d+ simulated seconds"), timeout=SLOW_MS
    )
    expect(page.get_by_role("button", name="Stop")).to_be_hidden()
    expect(live.locator(".top .outcome")).to_contain_text("nterrupted", timeout=SLOW_MS)
    live.close()


@pytest.mark.parametrize(("width", "scheme"), [(1280, "dark"), (360, "light")])
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


def test_a_crossing_is_marked_while_it_is_drawn(page: Page) -> None:
    page.get_by_role("button", name="New farm").click()
    bow = [(0.2, 0.2), (0.7, 0.7), (0.7, 0.2), (0.2, 0.7)]
    draw(page, "Field", *bow[:3])
    expect(page.locator(".crossing")).to_have_count(0)
    click_ring(page, bow[3])
    expect(page.locator(".crossing")).to_have_count(1)
    expect(page.locator(".hint")).to_contain_text("crosses itself")
    page.keyboard.press("Backspace")
    box = page.locator(".map").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 0.25 * box["height"])
    expect(page.locator(".crossing")).to_have_count(0)
    page.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 0.65 * box["height"])  # Before the click
    expect(page.locator(".crossing")).to_have_count(1)
    click_ring(page, bow[3])
    page.keyboard.press("Enter")
    expect(page.locator(".hint")).to_contain_text("crosses itself")
    expect(page.locator(".crossing")).to_have_count(1)
    expect(page.locator(".problem")).to_contain_text("corners in order?", timeout=SLOW_MS)
    expect(page.get_by_role("button", name="Mend it")).to_be_hidden()


def test_a_double_click_ends_a_border(page: Page) -> None:
    page.get_by_role("button", name="New farm").click()
    draw(page, "Field", *FIELD[:3])
    box = page.locator(".map").bounding_box()
    assert box is not None
    x, y = FIELD[3]
    page.mouse.dblclick(box["x"] + x * box["width"], box["y"] + y * box["height"])
    planned(page)
    expect(page.get_by_text("4 corners as numbers")).to_be_visible()
    expect(page.get_by_role("button", name="Select", exact=True)).to_have_attribute("aria-pressed", "true")


TAMPA = "28.0599722, -82.1387222"
PLACES = [
    ("28.0599722, -82.1387222", TAMPA),
    ("28.0599722,-82.1387222", TAMPA),
    ("+28.0599722, -82.1387222", TAMPA),
    ("28,0599722; -82,1387222", TAMPA),
    ("28,0599722 N 82,1387222 W", TAMPA),
    ("28.0599722\u00b0N, 82.1387222\u00b0W", TAMPA),
    ("N 28.0599722\u00b0, W 82.1387222\u00b0", TAMPA),
    ("82.1387222W 28.0599722N", TAMPA),
    ("28\u00b03'35.9\"N 82\u00b08'19.4\"W", TAMPA),
    ("28\u00b03\u203235,9\u2033N 82\u00b08\u203219,4\u2033W", TAMPA),
    ("28\u00b03'35.9''N 82\u00b08'19.4''W", TAMPA),
    ("28 3 35.9 -82 8 19.4", TAMPA),
    ("28:03:35.9N 82:08:19.4W", TAMPA),
    ("28\u00b03'35.9\" \u221282\u00b08'19.4\"", TAMPA),
    ("28 deg 3 min 35.9 sec North 82 deg 8 min 19.4 sec West", TAMPA),
    ("28\u00b0 3.5983' N 82\u00b0 8.3233' W", "28.0599717, -82.1387217"),
    ("Lon: -82.1387222, Lat: 28.0599722", TAMPA),
    ("geo:28.0599722,-82.1387222", TAMPA),
    ("-0\u00b030' 0\u00b030'", "-0.5, 0.5"),
    ("28.0599722\u00b0S, 82.1387222\u00b0E", "-28.0599722, 82.1387222"),
    ("0,5 S 0,5 O", "is not understood"),
    ("12, 13", "12, 13"),
    ("12,13", "longitude is missing"),
    ("28,05,82,15", "write decimal points"),
    ("somewhere", "is not understood"),
    ("28 70 0 N 82 0 0 W", "0 to 60"),
    ("28.5 30 N 82 W", "decimals before"),
    ("-28 N 82 W", "a sign and a direction"),
    ("28 N 29 S", "two latitudes"),
    ("28 3 N 82", "28.05, 82"),
    ("95, 10", "beyond 90"),
    ("10, 190", "beyond 180"),
    ("86, 10", "the map ends"),
    ("28'3\" 82'8\"", "follow each other"),
    ("28.05, -82.15, 17", "more than two angles"),
    ("1 2 3", "two angles"),
    ("<b>28</b>", "is not understood"),
]


def test_go_to_reads_places_as_people_write_them(page: Page) -> None:
    box = page.get_by_label("Go to latitude, longitude")
    for text, wanted in PLACES:
        box.fill(text)
        box.press("Enter")
        found = page.locator(".hint").text_content() or ""
        assert found == wanted if re.fullmatch(r"[-\d., ]+", wanted) else wanted in found, (text, found)


def accepting(page: Page) -> list[str]:
    """Go on where the browser asks; return what it asked."""
    asked: list[str] = []
    page.on("dialog", lambda dialog: (asked.append(dialog.type), dialog.accept()))
    return asked


def drawn_farm(page: Page) -> None:
    page.get_by_role("button", name="New farm").click()
    draw(page, "Field", *FIELD, FIELD[0])
    planned(page)  # Or its plan is shown for a moment as that of the budget
    page.get_by_label("Budget").fill("2min")
    planned(page)


def test_what_is_drawn_is_there_again_after_a_reload(page: Page) -> None:
    asked = accepting(page)
    drawn_farm(page)
    time = figure(page, "Time").text_content()
    page.reload()
    expect(page.get_by_role("heading", level=1)).to_have_text("Studio: new farm")
    assert asked == ["beforeunload"]
    expect(page.locator(".shapes li")).to_have_count(1)
    corners = page.locator(".leaflet-overlay-pane path.leaflet-interactive").bounding_box()
    assert corners is not None and corners["x"] > 0 and corners["width"] > 100  # It is in sight
    expect(page.get_by_label("Budget")).to_have_value("2min")
    planned(page)
    assert figure(page, "Time").text_content() == time
    page.goto("about:blank")
    page.go_back()
    expect(page.get_by_role("heading", level=1)).to_have_text("Studio: new farm")
    page.get_by_role("button", name="Undo").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("Studio: miniberry-30")
    planned(page)


def another_tab(page: Page) -> Page:
    """Open the studio in a tab that knows nothing of this one's session."""
    with page.context.expect_page() as opened:
        page.evaluate("() => { open(location.href, '_blank', 'noopener'); }")
    return opened.value


def test_what_is_drawn_is_there_again_after_a_crash(page: Page) -> None:
    drawn_farm(page)
    other = another_tab(page)  # Of the tab that crashed nothing is left but what the browser keeps
    expect(other.locator(".shapes li")).to_have_text(["field 1strawberry"])
    planned(other)
    expect(other.get_by_role("heading", level=1)).to_have_text("Studio: new farm")
    other.close()


def test_leaving_is_asked_only_where_something_is_unsaved(page: Page) -> None:
    asked = accepting(page)
    page.locator("#farms").select_option("miniberry-10")
    expect(page.get_by_role("heading", level=1)).to_have_text("Studio: miniberry-10")
    planned(page)
    page.reload()
    expect(page.get_by_role("heading", level=1)).to_have_text("Studio: miniberry-10")
    assert asked == []
    drawn_farm(page)
    with page.expect_download():
        page.get_by_role("button", name="Save farm").click()
    page.reload()
    expect(page.get_by_role("heading", level=1)).to_have_text("Studio: new farm")
    assert asked == []
    page.get_by_role("button", name="field 1").click()
    page.get_by_role("button", name="Delete").click()
    draw(page, "Field", (0.3, 0.3))
    page.reload()
    expect(page.get_by_role("heading", level=1)).to_have_text("Studio: miniberry-30")
    assert asked == ["beforeunload"]


def test_another_farm_can_be_undone(page: Page, tmp_path: Path) -> None:
    undo, redo = (page.get_by_role("button", name=name) for name in ("Undo", "Redo"))
    drawn_farm(page)
    for begin in (
        lambda: page.get_by_role("button", name="New farm").click(),
        lambda: page.locator("#farms").select_option("miniberry-10"),
        lambda: page.locator("input[type=file]").set_input_files(DATA / "field.geojson"),
    ):
        begin()
        expect(page.locator(".shapes li")).not_to_have_text(["field 1strawberry"])
        undo.click()
        expect(page.locator(".shapes li")).to_have_text(["field 1strawberry"])
        expect(page.locator("#farms")).to_have_value("")
    redo.click()
    expect(page.get_by_role("heading", level=1)).to_have_text("Studio: field")
    undo.click()
    planned(page)


SHAPE = (
    '{"name": "n", "crop": "c", "owner": "o", "kind": "field", "height_m": null, "margin_m": null,'
    ' "rings": RINGS}'
)
DRAFT = (
    '{"form": 1, "start": "", "values": VALUES, "sketch": {"known": KNOWN, "name": "n", "owner": "o",'
    ' "home": null, "rally": [], "members": {}, "shapes": [SHAPES]}}'
)


def draft(values: str = "{}", known: str = "null", shapes: str = "") -> str:
    return DRAFT.replace("VALUES", values).replace("KNOWN", known).replace("SHAPES", shapes)


HOSTILE = [
    "{",
    "null",
    "[1]",
    "[" * 9999,
    '{"form": 2}',
    '{"form": 1, "start": "", "values": {}, "sketch": {}}',
    draft(shapes=SHAPE.replace("RINGS", "[[[1, 2], [3, null], [4, 5]]]")),
    draft(shapes=SHAPE.replace("RINGS", "[[[1, 2], [3, 4]]]")),
    draft(shapes=SHAPE.replace("RINGS", "[]")),
    draft(known="{}"),
    draft(values='{"__proto__": 1, "budget": {}}', known='"no-such-farm"'),
]


def test_what_is_no_draft_in_the_browser_is_left_alone(page: Page) -> None:
    for text in HOSTILE:
        # Written before the page's own scripts: what it keeps itself as it goes must not come after
        write = f"one.setItem('wbf-mission studio', {json.dumps(text)})"
        page.context.add_init_script(f"for (const one of [localStorage, sessionStorage]) {write};")
        page.reload()
        expect(page.get_by_role("heading", level=1)).to_have_text("Studio: miniberry-30")
        planned(page)
        expect(page.get_by_label("Budget")).to_have_value("3min")
        expect(page.get_by_role("button", name="Undo")).to_be_disabled()


def test_a_browser_that_keeps_nothing_says_so(page: Page) -> None:
    page.evaluate("() => { Storage.prototype.setItem = () => { throw new Error('full'); }; }")
    page.get_by_label("Budget").fill("2min")
    expect(page.locator(".hint")).to_contain_text("does not keep this draft")
    planned(page)


def test_the_older_of_two_pages_says_who_plans_and_goes_on(page: Page) -> None:
    page.get_by_label("Budget").fill("")
    page.locator("#farms").select_option("waterberry")
    page.get_by_label("Planner").select_option("lawnmower")
    expect(page.get_by_role("status").first).to_have_text(re.compile("planning"))
    page.wait_for_timeout(300)
    other = another_tab(page)
    expect(other.get_by_role("heading", level=1)).to_have_text("Studio: waterberry")
    other.get_by_label("Budget").fill("15min")
    expect(page.get_by_role("status").first).to_have_text(
        "another page of the studio plans now", timeout=SLOW_MS
    )
    planned(other)
    other.close()
    page.get_by_role("button", name="Plan here").click()
    planned(page)
    expect(page.get_by_role("button", name="Plan here")).to_be_hidden()


def test_a_plan_for_a_survey_camera_is_flown(page: Page) -> None:
    page.get_by_text("More: leaf camera").click()
    page.locator("#choice-camera_model").select_option("dji-p1-35")
    page.locator("#choice-gsd_cm").fill("0.1")
    planned(page)
    expect(page.locator(".how")).to_contain_text("where the survey camera would take them")
    page.get_by_label("Speed", exact=True).select_option("")
    page.get_by_role("button", name="Fly it in the simulator").click()
    expect(page.locator(".told")).to_have_text("The flight: completed", timeout=SLOW_MS)
    page.get_by_label("Policy").select_option("greedy")
    planned(page)
    expect(page.get_by_role("button", name="Fly it in the simulator")).to_be_disabled()
    expect(page.locator(".how")).to_contain_text("needs leaf camera readings")


def test_a_flight_that_fails_is_told_beside_the_button(page: Page) -> None:
    page.get_by_text("More: what to run").click()
    page.locator("#choice-fields").fill("tylcv")
    page.get_by_role("button", name="strawberries").click()
    page.get_by_label("Crop", exact=True).fill("maize")
    page.get_by_label("Crop", exact=True).press("Tab")
    page.get_by_role("button", name="tomatoes").click()
    page.get_by_label("Crop", exact=True).fill("maize")
    page.get_by_label("Crop", exact=True).press("Tab")
    planned(page)
    page.get_by_role("button", name="Fly it in the simulator").click()
    expect(page.locator(".told.bad")).to_contain_text("The flight: failed", timeout=SLOW_MS)
    expect(page.locator(".told.bad")).to_contain_text("'Fields'")


LOST = re.compile("The connection to the program is lost: nothing can be planned, saved or flown")


def test_an_idle_studio_says_that_its_program_is_gone_and_goes_on_when_it_is_back(browser: Browser) -> None:
    studio = Studio(Scenario(farm="miniberry-10", planner="spiral", budget="1min", estimator="point"))
    with LiveServer(View(), routes=studio.routes(), home="studio") as server:
        studio.begin(server)
        url, port = server.url, server.port
        page = browser.new_page()
        page.goto(url)
        planned(page)
        lost = page.locator(".urgent .lost")
        expect(lost).to_be_empty()
        before = figure(page, "Time").inner_text()
    expect(lost).to_have_text(LOST, timeout=SLOW_MS)
    expect(page.locator(".figures")).to_have_css("opacity", "0.4")
    page.get_by_label("Budget").fill("50s")
    page.get_by_label("Budget").press("Tab")
    expect(page.locator(".problem")).to_contain_text("does not answer", timeout=SLOW_MS)
    with LiveServer(View(), port=port, routes=studio.routes(), home="studio") as server:
        expect(lost).to_be_empty(timeout=SLOW_MS)
        planned(page)
        expect(figure(page, "Time")).not_to_have_text(before)
        expect(page.locator(".problem")).to_be_empty()
        page.close()
    studio.close()


def test_an_idle_studio_says_that_its_program_stands_still(browser: Browser) -> None:
    words = "-m wbf_mission studio --farm miniberry-10 --port 0 --json"
    with subprocess.Popen([sys.executable, *words.split()], stdout=subprocess.PIPE, text=True) as program:
        try:
            assert program.stdout is not None
            text = ""
            while not text.rstrip().endswith("}"):
                text += program.stdout.readline()
            page = browser.new_page()
            page.goto(json.loads(text)["url"])
            lost = page.locator(".urgent .lost")
            planned(page)
            expect(lost).to_be_empty()
            program.send_signal(signal.SIGSTOP)
            expect(lost).to_have_text(re.compile("The program sends no data: nothing"), timeout=SLOW_MS)
            program.send_signal(signal.SIGCONT)
            expect(lost).to_be_empty(timeout=SLOW_MS)
            program.kill()
            expect(lost).to_have_text(LOST, timeout=SLOW_MS)
            page.close()
        finally:
            program.kill()
