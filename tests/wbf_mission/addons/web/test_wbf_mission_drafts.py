"""Drafts of the studio: what a page may ask for, and what becomes of it."""

import contextlib
import json
import math
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from geo import get_farm, save_farm
from geo.errors import FarmError, WbfMissionError
from geo.geojson import farm_document
from wbf_mission.addons.web.drafts import DraftError, Drafts, NewestOnly, SupersededError
from wbf_mission.planning import PlanResult
from wbf_mission.progress import Progress
from wbf_mission.run.plan import plan
from wbf_mission.scenario import Scenario


@pytest.fixture(scope="module")
def drafts() -> Iterator[Drafts]:
    found = Drafts(Scenario(farm="miniberry-30"))
    yield found
    found.close()


def body(farm: object = "miniberry-30", **options: object) -> bytes:
    return json.dumps({"farm": farm, "options": options}).encode()


def square(side_deg: float = 0.001, **properties: object) -> dict[str, object]:
    corners = [(0.0, 0.0), (side_deg, 0.0), (side_deg, side_deg), (0.0, side_deg), (0.0, 0.0)]
    ring = [[-82.15 + x, 28.05 + y] for x, y in corners]
    given = {"name": "north", "crop": "tomato", "owner": "me", **properties}
    geometry = {"type": "Polygon", "coordinates": [ring]}
    return {"type": "Feature", "properties": given, "geometry": geometry}


def kml(rings: dict[str, list[tuple[float, float]]], home: tuple[float, float] | None) -> bytes:
    places = [f"<Point><coordinates>{home[0]},{home[1]}</coordinates></Point>"] if home else []
    marks = [f"<Placemark><name>home</name>{place}</Placemark>" for place in places]
    for name, ring in rings.items():
        corners = " ".join(f"{lon!r},{lat!r},0" for lon, lat in [*ring, ring[0]])
        marks.append(
            f"<Placemark><name>{name}</name><Polygon><outerBoundaryIs><LinearRing><coordinates>{corners}"
            "</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark>"
        )
    return f'<kml xmlns="http://www.opengis.net/kml/2.2"><Document>{"".join(marks)}</Document></kml>'.encode()


@given(
    planner=st.sampled_from(
        [{"planner": one} for one in ("spiral", "lawnmower", "adaptive-lawnmower")]
        + [{"policy": one} for one in ("greedy", "orienteering")]
    ),
    place=st.tuples(st.floats(-170, 170), st.floats(-60, 60)),
    corners=st.lists(st.floats(0.4, 1.0), min_size=4, max_size=7),
    clockwise=st.booleans(),
    has_home=st.booleans(),
    digits=st.sampled_from([7, 15]),
)
@settings(
    max_examples=5,
    deadline=None,
    phases=[Phase.explicit, Phase.generate],  # A plan takes too long to look for a simpler one
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
def test_a_file_that_is_opened_is_planned_as_the_command_line_plans_it(
    drafts: Drafts,
    tmp_path: Path,
    planner: dict[str, str],
    place: tuple[float, float],
    corners: list[float],
    clockwise: bool,
    has_home: bool,
    digits: int,
) -> None:
    turns = [2 * math.pi * k / len(corners) for k in range(len(corners))][:: -1 if clockwise else 1]
    ring = [
        (
            round(place[0] + 0.0004 * far * math.cos(turn), digits),
            round(place[1] + 0.0004 * far * math.sin(turn), digits),
        )
        for turn, far in zip(turns, corners, strict=True)
    ]
    path = tmp_path / "mine.kml"
    path.write_bytes(kml({"block": ring}, place if has_home else None))
    farm = drafts.farm_of_file(path.read_bytes(), path.name, crop=None, crs=None, repair=False)
    given_here = body(farm_document(farm), budget="4min", **planner)
    here = in_short(lambda: drafts.plan(drafts.draft(given_here)).missions[0].plan)
    assert here == in_short(lambda: plan(Scenario(farm=str(path), budget="4min", **planner)))


def in_short(make: Callable[[], PlanResult]) -> object:
    """Return a plan's path and mission, or why there is none."""
    try:
        made = make()
    except WbfMissionError as error:
        return str(error)
    return made.path_m.tolist(), made.mission


@pytest.mark.slow
def test_a_mission_longer_than_a_battery_is_told_in_sorties(drafts: Drafts) -> None:
    found = drafts.plan(drafts.draft(body("waterberry", planner="lawnmower", budget="25km")))
    assert len(found.missions) > 1
    assert found.missions[1].name == "sortie 2"
    assert found.flown(drafts.folder) == found.draft.scenario


def test_a_number_of_batteries_is_planned_for_and_flown(drafts: Drafts) -> None:
    found = drafts.plan(drafts.draft(body("miniberry-100", planner="lawnmower", budget="1 battery")))
    assert found.results[0].budget_text == "1 battery"
    flown = found.flown(drafts.folder)
    assert flown.mission.budget is None
    assert plan(flown).mission.items == found.results[0].mission.items


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (b"{", "cannot be read"),
        (b"[" * 100_000, "cannot be read"),
        (b"\xff\xfe", "cannot be read"),
        (b'{"farm": "miniberry-30", "more": 1}', "cannot be read"),
        (body("no-such-farm"), "the studio knows miniberry-10"),
        (body("/etc/passwd"), "the studio knows miniberry-10"),
        (body({"type": "FeatureCollection", "features": []}), 'has no "features"'),
        (body([1, 2]), "the farm: is not a GeoJSON"),
        (body({"type": "FeatureCollection", "features": [square(crop=[3])]}), "feature 1 .'north'."),
        (body(vehicle="mine.toml"), "the studio knows"),
        (body(planner="/tmp/mine.py:planner"), "not key=value"),
        (body(planner=["spiral"]), "is not a text"),
        (body(planner="spiral:nonsense=1"), "unknown parameter 'nonsense'"),
        (body(estimator="mine.py"), "the studio knows"),
        (body(fields="mine.toml"), "the studio knows tylcv"),
        (body(camera_model="mine.toml"), "the studio knows"),
        (body(terrain="heights.tif"), "is not an option of a draft"),
        (body(mission="/etc/passwd"), "is not an option of a draft"),
        (body(farm_crs="EPSG:1"), "is not an option of a draft"),
        (body(budget="much"), "budget 'much' is not understood"),
        (body(wind_speed_m_s=1e9), "out of range"),
        (body(wind_speed_m_s="strong"), "wind_speed_m_s"),
        (body(vehicles=1.5), "vehicles"),
    ],
)
def test_what_cannot_be_used_is_told_in_a_line(drafts: Drafts, given: bytes, told: str) -> None:
    with pytest.raises(WbfMissionError, match=told) as caught:
        drafts.plan(drafts.draft(given))
    assert str(drafts.folder) not in str(caught.value)


def test_what_was_named_at_the_beginning_may_be_a_file(tmp_path: Path) -> None:
    path = tmp_path / "mine.geojson"
    save_farm(get_farm("miniberry-10"), path)
    own = Drafts(Scenario(farm=str(path)))
    assert own.draft(body(str(path))).farm.name == "miniberry-10"
    with pytest.raises(DraftError):
        own.draft(body(str(tmp_path / "other.geojson")))
    own.close()
    assert not own.folder.exists()


def test_a_farm_file_becomes_what_is_drawn(drafts: Drafts, tmp_path: Path) -> None:
    path = tmp_path / "mine.geojson"
    save_farm(get_farm("miniberry-10"), path)
    farm = drafts.farm_of_file(path.read_bytes(), "../../mine.GeoJSON", crop=None, crs=None, repair=False)
    assert (farm.name, farm.patches[0].crop) == ("miniberry-10", "strawberry")
    with pytest.raises(FarmError, match="is not a farm file"):
        drafts.farm_of_file(b"", "mine.exe", crop=None, crs=None, repair=False)
    with pytest.raises(FarmError, match=r"^farm file mine\.geojson: feature 1"):
        drafts.farm_of_file(
            b'{"type": "FeatureCollection", "features": [3]}',
            "mine.geojson",
            crop=None,
            crs=None,
            repair=False,
        )


def superseded_by(one: NewestOnly[str], older: Callable[[Progress], str], begun: threading.Event) -> str:
    """Begin something and ask for something newer; return what that found, once the older was told."""
    told: list[str] = []

    def ask() -> None:
        with pytest.raises(SupersededError):
            one.do("older", older)
        told.append("superseded")

    thread = threading.Thread(target=ask)
    thread.start()
    assert begun.wait(20)
    found = one.do("newer", lambda _progress: "new")
    thread.join(20)
    assert told == ["superseded"]
    return found


def test_what_is_newer_ends_what_is_under_way() -> None:
    begun, ended = threading.Event(), threading.Event()

    def endless(progress: Progress) -> str:
        begun.set()
        try:
            while True:
                progress("planning", 0.0, 1.0)
                time.sleep(0.001)
        finally:
            ended.set()

    assert superseded_by(NewestOnly[str](), endless, begun) == "new"
    assert ended.is_set()


def test_what_does_not_tell_how_far_it_is_holds_nobody_up_for_long(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wbf_mission.addons.web.drafts.PATIENCE_S", 0.2)
    begun, go_on = threading.Event(), threading.Event()

    def stubborn(_progress: Progress) -> str:
        begun.set()
        go_on.wait(60)
        return "old"

    assert superseded_by(NewestOnly[str](), stubborn, begun) == "new"
    go_on.set()


def test_what_waits_for_its_turn_and_is_superseded_is_never_begun() -> None:
    one, begun, go_on = NewestOnly[str](), threading.Event(), threading.Event()
    done: list[int] = []

    def first(_progress: Progress) -> str:
        begun.set()
        go_on.wait(20)
        return "first"

    def waits(number: int) -> Callable[[Progress], str]:
        return lambda _progress: str(done.append(number))

    def ask(what: str, work: Callable[[Progress], str]) -> None:
        with contextlib.suppress(SupersededError):
            one.do(what, work)

    threads = [threading.Thread(target=ask, args=("first", first))]
    threads[0].start()
    assert begun.wait(20)
    for number in range(5):
        threads.append(threading.Thread(target=ask, args=(f"{number}", waits(number))))
        threads[-1].start()
        threads[-2].join(20)  # The caller of the older request is told at once
    go_on.set()
    for thread in threads:
        thread.join(20)
    assert done == [4]


def test_the_same_is_done_once_and_errors_are_told() -> None:
    one, begun, go_on = NewestOnly[str](), threading.Event(), threading.Event()
    done: list[str] = []

    def work(_progress: Progress) -> str:
        done.append("done")
        begun.set()
        go_on.wait(20)
        return "found"

    found: list[str] = []
    threads = [threading.Thread(target=lambda: found.append(one.do("same", work))) for _ in range(3)]
    for thread in threads:
        thread.start()
    assert begun.wait(20)
    go_on.set()
    for thread in threads:
        thread.join(20)
    assert found == ["found"] * 3
    assert done == ["done"]

    def broken(_progress: Progress) -> str:
        raise DraftError("no such thing")

    with pytest.raises(DraftError, match="no such thing"):
        one.do("broken", broken)
    one.stop()
    assert one.do("same", lambda _progress: "new") == "new"
