"""What a page shows of a run: the view that events make, and the updates that viewers get of it."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sweeps import sweep
from viewer import Viewer
from write_page_schema import SOURCE, TYPES, typescript

from geo import Farm
from geo.farms import get_farm
from geo.frame import LocalFrame
from mission.files.fence import Circle, CircleShape, GeoFence, Polygon, fence_items
from mission.model import Mission, MissionItem
from mission.policies.decision import AcquisitionMap, Alternative
from sensors.fields import PAPER_FIELDS
from sensors.observations import Observations
from sensors.scoring.information import InformationModel, tile_shape
from sensors.scoring.score import Score
from wbf_mission.addons.web import view
from wbf_mission.addons.web.view import View
from wbf_mission.events import (
    Asked,
    DayBegun,
    Decided,
    Estimated,
    Event,
    FlightEnded,
    Noted,
    Orderable,
    Planned,
    Progressed,
    RunBegun,
    RunEnded,
    Seen,
    VehicleInfo,
    VehicleMoved,
    VehicleSaid,
)
from wbf_mission.replanning.record import DecisionRecord, PathChange

FARM = get_farm("miniberry-10")
SHAPE = FARM.width_cells, FARM.height_cells


def begun(farm: Farm = FARM, **more: Any) -> RunBegun:
    return RunBegun("a flight", farm, PAPER_FIELDS, (VehicleInfo(1, "one", "copter"),), **more)


def random_model(shape: tuple[int, int], seed: int = 0, **more: Any) -> InformationModel:
    made = np.random.default_rng(seed)
    value, uncertainty = (made.random((3, *shape), np.float32) for _ in range(2))
    return InformationModel(value, uncertainty * np.float32(0.7), **more)


def estimated(model: InformationModel, time_s: float = 1.0, score: Score | None = None) -> Estimated:
    return Estimated(time_s, 1, 5, model, score)


def shown(seen: View) -> Viewer:
    viewer = Viewer()
    viewer.take(seen.update(None)[0].json())
    return viewer


def expected_bytes(farm: Farm, value: np.ndarray, field: str, cells: int, scale: float) -> np.ndarray:
    """The means over blocks by plain loops, of the owner's cells that the field concerns."""
    mask = PAPER_FIELDS[field].mask(farm.grid()) & np.isfinite(value)
    if cells == 1:
        return np.where(mask, np.rint(value * np.float32(254.0 / scale)), 255).astype(np.uint8)
    width, height = (-(-side // cells) for side in value.shape)
    expected = np.full((width, height), 255, np.uint8)
    for x in range(width):
        for y in range(height):
            block = np.s_[x * cells : (x + 1) * cells, y * cells : (y + 1) * cells]
            if mask[block].any():
                mean = value[block][mask[block]].astype(np.float64).mean()
                expected[x, y] = np.rint(np.float32(mean) * np.float32(254.0 / scale))
    return expected


def test_the_pages_types_are_made_of_the_structs() -> None:
    assert TYPES.read_text() == typescript(SOURCE.read_text()), "run python tools/write_page_schema.py"


@pytest.mark.parametrize("name", ["miniberry-10", "miniberry-100"])
def test_a_small_farm_is_shown_cell_by_cell(name: str) -> None:
    farm = get_farm(name)
    shape = farm.width_cells, farm.height_cells
    model = random_model(shape)
    model.value[0, 3, 4] = np.nan
    seen = View(longest=1024)
    seen.take(begun(farm))
    seen.take(DayBegun(0.0, 1, model.value))
    seen.take(estimated(model))
    page = shown(seen)
    assert page.run is not None
    assert (page.run["raster"]["width"], page.run["raster"]["height"]) == shape
    for k, field in enumerate(PAPER_FIELDS.names):
        expected = expected_bytes(farm, model.value[k], field, 1, 1.0)
        np.testing.assert_array_equal(page.layer(f"value/{field}"), expected)
        np.testing.assert_array_equal(page.layer(f"truth/{field}"), expected)
        scale = page.scales[f"uncertainty/{field}"]
        assert scale == 1.0
        expected = expected_bytes(farm, model.uncertainty[k], field, 1, scale)
        np.testing.assert_array_equal(page.layer(f"uncertainty/{field}"), expected)


@pytest.mark.kernel
def test_a_large_farm_is_shown_by_the_means_of_blocks() -> None:
    farm = get_farm("miniberry-100")
    shape = farm.width_cells, farm.height_cells
    model = random_model(shape, seed=1)
    model.value[:, 10:20, 10:20] = np.nan
    seen = View(longest=max(shape) // 3)
    seen.take(begun(farm))
    seen.take(estimated(model))
    page = shown(seen)
    assert page.run is not None
    cells = page.run["raster"]["cells"]
    assert cells > 1
    for k, field in enumerate(PAPER_FIELDS.names):
        expected = expected_bytes(farm, model.value[k], field, cells, 1.0)
        found = page.layer(f"value/{field}")
        assert np.abs(found.astype(int) - expected).max() <= 1  # A sum may be rounded the other way
        assert (found == expected).mean() > 0.99


def test_a_scale_is_a_round_number_and_never_falls() -> None:
    seen = View(share=1.0)
    seen.take(begun())
    scales, cursor = [], None
    for peak in (0.003, 0.3, 0.004):
        value = np.full((3, *SHAPE), peak, np.float32)
        seen.take(estimated(InformationModel(value, value)))
        update, cursor = seen.update(cursor)
        # Bytes that stay equal on another scale are other values.
        assert "uncertainty/tylcv" in {tile.layer for tile in update.tiles}
        page = shown(seen)
        scales.append(page.scales["uncertainty/tylcv"])
        own = PAPER_FIELDS["tylcv"].mask(FARM.grid())
        assert set(page.layer("uncertainty/tylcv")[own].tolist()) == {round(254 * peak / scales[-1])}
    assert scales == pytest.approx([0.005, 0.5, 0.5])


def fine_farm() -> Farm:
    """Miniberry-100 with cells of a quarter: several tiles of the page and of estimators on each side."""
    farm = get_farm("miniberry-100")
    side = farm.cell_size_m / 4
    return replace(
        farm, width_cells=4 * farm.width_cells, height_cells=4 * farm.height_cells, cell_size_m=side
    )


def flat_arrays(farm: Farm) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return values, uncertainties, and of the tiles of estimators none."""
    value = np.ones((3, farm.width_cells, farm.height_cells), np.float32)
    return value, np.zeros_like(value), np.zeros(tile_shape((farm.width_cells, farm.height_cells)), np.bool_)


def test_only_tiles_that_changed_are_sent_again() -> None:
    farm = fine_farm()
    value, uncertainty, _ = flat_arrays(farm)
    seen = View(share=1.0)
    seen.take(begun(farm))
    seen.take(estimated(InformationModel(value, uncertainty)))
    _, cursor = seen.update(None)
    # The estimator says that much changed; what looks as before is not sent.
    x, y = np.argwhere(PAPER_FIELDS["tylcv"].mask(farm.grid()))[-1]
    value[0, x, y] = 0.25
    seen.take(estimated(InformationModel(value, uncertainty, revision=1)))
    update, cursor = seen.update(cursor)
    assert [(one.layer, one.x, one.y) for one in update.tiles] == [("value/tylcv", x // 128, y // 128)]
    seen.take(estimated(InformationModel(value, uncertainty, revision=2)))
    assert seen.update(cursor)[0].tiles is msgspec.UNSET


def test_what_changed_while_estimates_were_left_out_is_drawn_in_the_end() -> None:
    farm = fine_farm()
    value, uncertainty, nothing = flat_arrays(farm)
    own = np.argwhere(PAPER_FIELDS["soil"].mask(farm.grid()))
    seen = View(share=1e-9)
    seen.take(begun(farm))
    seen.take(estimated(InformationModel(value, uncertainty, nothing)))
    for revision, (x, y) in enumerate(own[:: len(own) // 9], 1):
        changed = nothing.copy()
        changed[x // 64, y // 64] = True
        value[2, x, y] = 0.5
        seen.take(estimated(InformationModel(value, uncertainty, changed, revision)))
    assert (shown(seen).layer("value/soil")[tuple(own.T)] == 254).all()
    seen.take(FlightEnded(9.0, 1, 1, 1, "completed", ""))
    page = shown(seen)
    np.testing.assert_array_equal(page.layer("value/soil"), expected_bytes(farm, value[2], "soil", 1, 1.0))
    assert page.said[-1]["text"] == "flight 1: completed"


@pytest.mark.parametrize("why", ["another estimator", "a revision that nobody told of"])
def test_what_changed_counts_only_from_the_estimate_before(why: str) -> None:
    farm = fine_farm()
    value, uncertainty, nothing = flat_arrays(farm)
    seen = View(share=1.0)
    seen.take(begun(farm))
    seen.take(estimated(InformationModel(value, uncertainty, nothing)))
    if why == "another estimator":
        value = value.copy()
    value[:] = 0.5
    revision = 1 if why == "another estimator" else 2
    seen.take(estimated(InformationModel(value, uncertainty, nothing, revision)))
    np.testing.assert_array_equal(
        shown(seen).layer("value/soil"), expected_bytes(farm, value[2], "soil", 1, 1.0)
    )


def test_the_layers_begin_anew_with_another_farm() -> None:
    seen, follower = View(share=1.0), Viewer()
    seen.take(begun())
    seen.take(DayBegun(0.0, 1, random_model(SHAPE).value))
    update, cursor = seen.update(None)
    follower.take(update.json())
    seen.take(begun(seed=4))  # The same farm: the layers stay
    update, cursor = seen.update(cursor)
    follower.take(update.json())
    assert follower.tiles and follower.tiles == shown(seen).tiles
    seen.take(begun(replace(FARM, name="another")))
    follower.take(seen.update(cursor)[0].json())
    assert follower.tiles == shown(seen).tiles == {} and follower.scales == {}


def test_the_view_keeps_no_estimate_of_another() -> None:
    model = random_model(SHAPE)
    seen = View(share=1.0)
    seen.take(begun())
    seen.take(estimated(model))
    before = shown(seen).layer("value/soil")
    model.value[:] = 0.0
    np.testing.assert_array_equal(shown(seen).layer("value/soil"), before)


@pytest.mark.parametrize("rotation_deg", [0.0, 33.0, -120.0])
def test_the_georeference_is_that_of_the_farm(rotation_deg: float) -> None:
    farm = get_farm("miniberry-100")
    farm = replace(farm, frame=LocalFrame(28.05, -82.15, rotation_deg=rotation_deg))
    seen = View()
    seen.take(begun(farm))
    page = shown(seen)
    assert page.run is not None
    shape = page.run["farm"]
    known = shape["georeference"]
    for x, y in ((0.0, 0.0), (shape["width_m"], 0.0), (shape["width_m"], shape["height_m"]), (5.0, 7.0)):
        lat, lon = farm.frame.to_wgs84(x, y)
        off_lat = known["lat"] + known["lat_x"] * x + known["lat_y"] * y - lat
        off_lon = known["lon"] + known["lon_x"] * x + known["lon_y"] * y - lon
        assert math.hypot(off_lat, off_lon * math.cos(math.radians(28.0))) * 111_000 < 0.01


def test_a_plan_has_its_path_its_fence_and_its_items_in_words() -> None:
    lat, lon = FARM.frame.to_wgs84(np.array([0.0, 3.0, 3.0]), np.array([0.0, 0.0, 2.0]))
    fence = GeoFence(
        [Polygon(list(zip(lat.tolist(), lon.tolist(), strict=True)))],
        [Circle(CircleShape((float(lat[1]), float(lon[1])), 1.5), inclusion=False)],
    )
    items = (MissionItem.waypoint(28.05, -82.15, 12.0), MissionItem(178, param2=3.0), MissionItem(12345))
    seen = View()
    seen.take(begun())
    path = np.array([[0.0, 1.0], [2.0, 3.125]])
    mission = Mission(items, fence=fence_items(fence))
    seen.take(Planned(3.0, 2, 1, 1, mission, path, 60.0, 100.0, 0.5))
    (plan,) = shown(seen).plans
    assert plan["path"] == [0.0, 1.0, 2.0, 3.12]
    assert plan["items"] == ["waypoint, 12 m", "change speed, 3 m/s", "command 12345"]
    polygon, circle = plan["fence"]
    assert polygon["inclusion"] and not circle["inclusion"]
    assert polygon["rings"][0] == pytest.approx([0, 0, 3, 0, 3, 2], abs=0.02)
    around = np.array(circle["rings"][0]).reshape(-1, 2) - (3.0, 0.0)
    assert np.hypot(*around.T) == pytest.approx(1.5, abs=0.03)


def test_many_states_thin_out_and_viewers_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(view, "MAX_STATES", 100)
    monkeypatch.setattr(view, "MAX_SAID", 10)
    seen, follower, cursor = View(), Viewer(), None
    for k in range(1000):
        seen.take(VehicleMoved(float(k), 1, 1, 7, float(k), 0.0, 5.0, 1.0))
        seen.take(VehicleSaid(float(k), 7, 6, f"line {k}"))
        if k % 7 == 0:
            update, cursor = seen.update(cursor)
            follower.take(update.json())
    update, cursor = seen.update(cursor)
    follower.take(update.json())
    page = shown(seen)
    assert page.states == follower.states and page.said == follower.said
    times = page.states["7"]["time_s"]
    assert (
        len(times) <= 100 and times == sorted(times) and times[-20:] == [float(k) for k in range(980, 1000)]
    )
    assert [one["text"] for one in page.said][-3:] == ["line 997", "line 998", "line 999"]


def test_many_vehicles_are_shown_with_fewer_states_each(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(view, "MAX_ALL_STATES", 200)
    seen, follower, cursor = View(), Viewer(), None
    for k in range(2000):
        seen.take(VehicleMoved(float(k), 1, 1, 1 + k % (2 + k // 100), 1.0, 0.0, 5.0, 1.0))
        if k % 97 == 0:
            update, cursor = seen.update(cursor)
            follower.take(update.json())
    follower.take(seen.update(cursor)[0].json())
    page = shown(seen)
    assert page.states == follower.states and len(page.states) == 21
    assert sum(len(states["time_s"]) for states in page.states.values()) <= 200


def test_what_cannot_be_shown_ends_no_flight() -> None:
    seen = View()
    seen.take(begun())
    seen.take(DayBegun(0.0, 1, np.zeros((3, 2, 2), np.float32)))  # Of another farm
    (said,) = shown(seen).said
    assert said["text"].startswith("the page cannot show DayBegun: ") and said["severity"] == 4


def test_what_is_not_finite_is_null_and_no_place_no_state() -> None:
    seen = View()
    nan = float("nan")
    seen.take(VehicleMoved(1.0, 1, 1, 1, nan, 0.0, 1.0, 1.0))
    seen.take(VehicleMoved(2.0, 1, 1, 1, 1.0, 2.0, nan, float("inf"), heading_rad=math.pi, battery=nan))
    states = shown(seen).states["1"]
    assert states["time_s"] == [2.0] and states["heading_deg"] == [180.0]
    assert states["height_m"] == states["speed_m_s"] == states["battery"] == [None]


def test_work_that_is_done_is_not_shown_as_under_way() -> None:
    seen, follower = View(), Viewer()
    seen.take(begun())
    seen.take(RunEnded(9.0, "completed", ""))
    seen.take(Progressed("writing results", 5, 6))
    update, cursor = seen.update(None)
    follower.take(update.json())
    assert follower.status["progress"] == {"what": "writing results", "done": 5, "total": 6}
    seen.take(Progressed("writing results", 6, 6))
    follower.take(seen.update(cursor)[0].json())
    assert follower.status.get("progress") is None


def test_the_outcome_of_a_decision_is_told_when_it_changes() -> None:
    change = PathChange(1, (0.0, 0.0), np.array([[1.0, 2.0]]), 5.0)
    thought = (Alternative(1, np.array([[1.0, 2.0]]), 3.0, 5.0),)
    record = DecisionRecord(1, 1, 4.0, "start", 0, "because", changes=[change], alternatives=thought)
    seen, follower = View(), Viewer()
    seen.take(begun())
    seen.take(Decided(604.0, record))  # In the second flight: the record counts from its start
    update, cursor = seen.update(None)
    follower.take(update.json())
    assert follower.decisions[1]["changes"][0]["outcome"] == "sent"
    assert follower.decisions[1]["candidates"] == [
        {"system_id": 1, "path": [1.0, 2.0], "value": 3.0, "cost": 5.0}
    ]
    change.outcome = "flown"
    assert seen.cursor > cursor
    follower.take(seen.update(cursor)[0].json())
    assert follower.decisions[1]["changes"][0]["outcome"] == "flown"
    assert follower.decisions[1]["time_s"] == 604.0
    assert shown(seen).decisions == follower.decisions


def test_an_acquisition_map_is_a_layer() -> None:
    values = np.array([[0.0, 7.0, 3.5], [1.0, 2.0, 7.0]], np.float32)
    blocks = AcquisitionMap(values, 4 * FARM.cell_size_m)
    seen = View()
    seen.take(begun())
    seen.take(Decided(4.0, DecisionRecord(1, 1, 4.0, "start", 0), blocks))
    page = shown(seen)
    assert page.scales["acquisition"] == 10.0
    layer = page.layer("acquisition")
    assert (layer[:4, :4] == 255).all() and (layer[:4, 4:8] == 178).all() and (layer[4:8, :4] == 25).all()
    assert (layer[4:, 8:] == 178).all()


def test_readings_are_at_the_middle_of_their_cells_and_keep_their_fields() -> None:
    tomatoes, strawberries = (PAPER_FIELDS[name].hosts(FARM.grid()) for name in ("tylcv", "ccr"))
    assert tomatoes[3, 8] and strawberries[3, 4]
    seen = View()
    seen.take(begun())
    nan = float("nan")
    both = Observations([3, 3], [8, 4], [0.5, 0.6], [1, 1], [[1.0, 1.0, 0.25], [0.5, 0.0, nan]])
    seen.take(Seen(10.0, both))
    seen.take(Seen(10.0, Observations([1], [2], [1.5], [1], [[0.125]], ("ndvi",))))
    readings = shown(seen).readings
    cell = FARM.cell_size_m
    assert readings["time_s"] == [10.5, 10.6, 11.5]
    assert readings["x"] == pytest.approx([3.5 * cell, 3.5 * cell, 1.5 * cell], abs=1e-3)
    assert readings["y"] == pytest.approx([8.5 * cell, 4.5 * cell, 2.5 * cell], abs=1e-3)
    # A disease has readings where its crop grows.
    assert readings["values"] == {
        "tylcv": [1.0, None, None],
        "ccr": [None, 0.0, None],
        "soil": [0.25, None, None],
        "ndvi": [None, None, 0.125],
    }


def test_what_is_no_text_is_told_all_the_same() -> None:
    seen = View()
    seen.take(Noted("a file named \udcff"))
    assert shown(seen).said[0]["text"] == "a file named ?"


_times = st.floats(0, 1e4)
_ids = st.integers(1, 3)
_words = st.text(max_size=8)
_models = st.builds(random_model, st.just(SHAPE), st.integers(0, 5))
_records = st.lists(
    st.builds(
        DecisionRecord,
        *(st.just(1), st.just(1), _times, _words, st.just(0)),
        changes=st.lists(
            st.builds(PathChange, _ids, st.just((0.0, 0.0)), st.just(np.ones((2, 2))), _times, _words),
            max_size=2,
        ),
    ),
    min_size=1,
    max_size=2,
)
_scores = st.none() | st.just(Score(0.5, (0.1, 0.2, 0.3), *([(0.0,) * 3] * 3), 0.0, PAPER_FIELDS.names))


def _events(records: list[DecisionRecord]) -> st.SearchStrategy[list[Event]]:
    seen = st.builds(
        Observations,
        *([st.just([1, 2])] * 2),
        st.just([0.5, 1.5]),
        st.just([1, 1]),
        st.just([[1, 0.5, 0]] * 2),
    )
    one: st.SearchStrategy[Event] = st.one_of(
        st.sampled_from(
            [begun(), begun(replace(FARM, name="another")), begun(seed=3), RunBegun("watched", None, None)]
        ),
        st.builds(DayBegun, _times, st.integers(1, 9), st.none() | _models.map(lambda model: model.value)),
        st.builds(Planned, _times, _ids, _ids, _ids, st.just(Mission(())), st.just(np.ones((2, 2)))),
        st.builds(
            VehicleMoved, _times, _ids, _ids, _ids, _times, _times, _times, _times, battery=st.none() | _times
        ),
        st.builds(VehicleSaid, _times, _ids, st.integers(0, 7), _words),
        st.builds(Seen, _times, seen),
        st.builds(Estimated, _times, _ids, _ids, st.none() | _models, _scores),
        st.builds(Decided, _times, st.sampled_from(records)),
        st.builds(FlightEnded, _times, _ids, _ids, _ids, _words, _words),
        st.builds(Progressed, _words, _times, _times),
        st.builds(Noted, _words, st.booleans()),
        st.builds(Orderable, st.just(("hold",))),
        st.builds(Asked, _words, st.just(("y", "n"))),
        st.builds(RunEnded, _times, _words, _words),
    )
    return st.lists(one, max_size=30)


@sweep(few=40, many=200)
@given(_records.flatmap(_events), st.data())
def test_who_joins_late_sees_what_who_followed_sees(events: list[Event], data: st.DataObject) -> None:
    limits = ("MAX_STATES", "MAX_ALL_STATES", "MAX_PLANS", "MAX_DECISIONS", "MAX_SAID")
    with pytest.MonkeyPatch.context() as patch:
        for name in limits:
            patch.setattr(view, name, 4)
        seen, follower, cursor = View(share=0.5), Viewer(), None
        for event in events:
            seen.take(event)
            if data.draw(st.booleans()):
                update, cursor = seen.update(cursor)
                follower.take(update.json())
        update, cursor = seen.update(cursor)
        follower.take(update.json())
        assert vars(follower) == vars(shown(seen))
        assert not [one for one in follower.said if "cannot show" in one["text"]]
        assert seen.cursor == cursor
        assert json.loads(seen.update(cursor)[0].json()) == {"time_s": follower.time_s}


@pytest.mark.parametrize("simulated", [False, True])
def test_what_a_vehicle_told_gets_old_but_not_in_a_simulation(simulated: bool) -> None:
    now_s = [50.0]
    view = View(clock=lambda: now_s[0])
    assert view.silent_s() == {}
    view.take(RunBegun("", None, None, simulated=simulated))
    view.take(VehicleMoved(1.0, 1, 1, 7, 0.0, 0.0, 0.0, 0.0, silent_s=1.0))
    now_s[0] += 20.0
    assert view.silent_s() == ({} if simulated else {"7": 21.0})
