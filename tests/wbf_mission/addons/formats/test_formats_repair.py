"""Broken polygons: what is mended, by how much, and what is refused."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from geo import Farm, FarmError, LocalFrame, load_farm, save_farm

FRAME = LocalFrame(28.05, -82.15)
SQUARE = [(0, 0), (100, 0), (100, 100), (0, 100), (0, 0)]


def degrees(ring: Any) -> list[list[float]]:
    x, y = np.array(ring, float).T
    latitude, longitude = FRAME.to_wgs84(x, y)
    positions: list[list[float]] = np.column_stack([longitude, latitude]).tolist()
    if tuple(ring[0]) == tuple(ring[-1]):
        positions[-1] = positions[0]
    return positions


def field(*rings: Any, **properties: Any) -> dict[str, Any]:
    return {
        "type": "Feature",
        "properties": {"name": "acker", "crop": "kale", "owner": "me", **properties},
        "geometry": {"type": "Polygon", "coordinates": [degrees(ring) for ring in rings]},
    }


def write(path: Path, *features: Any, **members: Any) -> Path:
    file = path / "farm.geojson"
    file.write_text(
        json.dumps({"type": "FeatureCollection", "cell_size_m": 1, **members, "features": features})
    )
    return file


def hole(x: float, y: float, size: float = 10.0) -> list[tuple[float, float]]:
    return [(x, y), (x, y + size), (x + size, y + size), (x + size, y), (x, y)]


BREAKAGES: dict[str, tuple[list[list[tuple[float, float]]], int]] = {
    "a small crossing at a corner": (
        [[(0, 0), (100, 0), (100, 100), (99.5, 101), (100.5, 101), (0, 100), (0, 0)]],
        1,
    ),
    "a spike without width": (
        [[(0, 0), (100, 0), (100, 50), (150, 50), (100, 50), (100, 100), (0, 100), (0, 0)]],
        1,
    ),
    "holes that overlap": ([SQUARE, hole(20, 20), hole(25, 25)], 1),
    "a hole in a hole": ([SQUARE, hole(20, 20, 20), hole(25, 25, 5)], 1),
    "a hole across the border": ([SQUARE, hole(95, 20)], 1),
    "a hole of two positions": ([SQUARE, [(5, 5), (6, 6), (5, 5), (5, 5)]], 1),
    "two fields drawn as one, by a line back and forth": (
        [
            [
                *[(0, 0), (50, 0), (50, 50), (60, 50), (60, 0), (110, 0), (110, 100)],
                *[(60, 100), (60, 50), (50, 50), (50, 100), (0, 100), (0, 0)],
            ]
        ],
        2,
    ),
    "a ring that touches itself": (
        [[(0, 0), (50, 0), (30, 30), (70, 30), (50, 0), (100, 0), (100, 100), (0, 100), (0, 0)]],
        1,
    ),
}


@pytest.mark.parametrize("name", BREAKAGES)
def test_what_is_mended(name: str, tmp_path: Path) -> None:
    rings, parts = BREAKAGES[name]
    path = write(tmp_path, field(SQUARE + np.array([0, -200.0]), name="whole"), field(*rings))
    with pytest.raises(FarmError, match=r"feature 2 \('acker'\): "):
        load_farm(path)
    farm = load_farm(path, repair=True)
    assert len(farm.patches) == 1 + parts
    shell = shapely.make_valid(shapely.Polygon(rings[0]), method="structure", keep_collapsed=False)
    meant = shell.difference(shapely.union_all([shapely.Polygon(one) for one in rings[1:] if len(one) > 4]))
    found = shapely.union_all([one.polygon for one in farm.patches[1:]])
    assert found.area == pytest.approx(meant.area, rel=0.002)
    assert len(farm.notes) == 1
    said = re.fullmatch(
        r"feature 2 \('acker'\): mended \(.+\): ([\d.]+) -> ([\d.]+) m2( in 2 parts)?", farm.notes[0]
    )
    assert said is not None, farm.notes
    assert float(said[2]) == pytest.approx(found.area, abs=0.2)
    untouched, same = tmp_path / "saved.geojson", tmp_path / "again.geojson"
    save_farm(farm, untouched)
    again = load_farm(untouched, repair=True)
    assert again.notes == ()
    save_farm(again, same)
    assert [one.polygon.area for one in load_farm(same).patches] == pytest.approx(
        [one.polygon.area for one in farm.patches], rel=1e-9
    )


@pytest.mark.parametrize(
    ("rings", "text"),
    [
        (
            [[(0, 0), (100, 100), (100, 0), (0, 100), (0, 0)]],
            "it has 0.0 m2 as drawn, but its rings enclose 5000.0 m2",
        ),
        ([SQUARE + SQUARE[1:]], "it has 20000.0 m2 as drawn, but its rings enclose 10000.0 m2"),
        ([[(0, 0), (100, 0), (0, 0), (0, 0)]], "has no area"),
        ([[(0, 0), (50, 0), (100, 0), (0, 0)]], "has no area"),
        ([SQUARE, hole(-10, -10, 200)], "cannot be mended safely"),
        (
            [[(k, 10 * (k % 2)) for k in range(30)]],
            "a ring is open over 30.7 m, but its longest side is only 10.0 m long",
        ),
        ([[(0, 0), (100, 0)]], "fewer than three corners"),
    ],
)
def test_what_is_not_safe_is_refused(rings: Any, text: str, tmp_path: Path) -> None:
    path = write(tmp_path, field(*rings))
    with pytest.raises(FarmError) as caught:
        load_farm(path, repair=True)
    assert "feature 1 ('acker')" in str(caught.value)
    assert text in str(caught.value)


@pytest.mark.parametrize("repair", [False, True])
@pytest.mark.parametrize(
    ("ring", "gap"),
    [
        (SQUARE[:4], "100.00"),
        ([*SQUARE[:4], (0, 0.5)], "0.50"),
        ([(0, 0), (100, 0), (0, 100)], "100.00"),
        # The side that is missing is the longest by a bit: somebody began with a short one.
        ([(0, 0), (100, 0), (100, 400), (0, 401)], "401.00"),
    ],
)
def test_what_an_open_ring_lacks_is_added(ring: Any, gap: str, repair: bool, tmp_path: Path) -> None:
    farm = load_farm(write(tmp_path, field(ring)), repair=repair)
    assert farm.notes == (f"feature 1 ('acker'): an open ring was closed over {gap} m",)
    assert farm.patches[0].polygon.area == pytest.approx(shapely.Polygon(ring).area, rel=1e-6)
    save_farm(farm, tmp_path / "saved.geojson")
    assert load_farm(tmp_path / "saved.geojson").notes == ()


def turned(feature: dict[str, Any]) -> dict[str, Any]:
    rings = feature["geometry"]["coordinates"]
    geometry = {"type": "Polygon", "coordinates": [[[y, x] for x, y in ring] for ring in rings]}
    return {**feature, "geometry": geometry}


def europe(x: float) -> dict[str, Any]:
    made = field(SQUARE)
    (ring,) = made["geometry"]["coordinates"]
    made["geometry"]["coordinates"] = [[[lon + 82.15 + 11.5 + x, lat - 28.05 + 48.1] for lon, lat in ring]]
    return made


def test_latitude_and_longitude_are_turned_only_where_that_is_plain(tmp_path: Path) -> None:
    right = load_farm(write(tmp_path, field(SQUARE)))
    farm = load_farm(write(tmp_path, turned(field(SQUARE))), repair=True)
    assert farm.notes == ("feature 1 ('acker'): latitude and longitude were swapped",)
    assert farm.patches[0].polygon.equals(right.patches[0].polygon)
    most = [europe(0.0), turned(europe(0.002)), europe(0.004)]
    for order in ((0, 1, 2), (1, 0, 2), (2, 0, 1)):
        farm = load_farm(write(tmp_path, *(most[k] for k in order)), repair=True)
        assert len(farm.notes) == 1
        assert farm.frame.latitude_deg == pytest.approx(48.1, abs=0.01)
    farm = load_farm(write(tmp_path, turned(europe(0.0)), home=[11.5, 48.1]), repair=True)
    assert farm.notes == ("feature 1 ('acker'): latitude and longitude were swapped",)
    for unsure in ((most[0], most[1]), (most[1], most[0])):
        with pytest.raises(FarmError, match="latitude and longitude are swapped"):
            load_farm(write(tmp_path, *unsure), repair=True)


@st.composite
def scrambles(draw: st.DrawFn) -> list[list[tuple[float, float]]]:
    place = st.tuples(st.integers(0, 60), st.integers(0, 60))
    shell = draw(st.lists(place, min_size=3, max_size=8))
    holes = draw(st.lists(st.lists(place, min_size=3, max_size=5), max_size=2))
    return [[*ring, ring[0]] for ring in (shell, *holes)]


# Of these land is left that is thinner, where it ends, than positions are told apart.
@example(rings=[[(52, 36), (17, 37), (55, 29), (52, 36)], [(0, 29), (0, 33), (36, 33), (0, 29)]])
@example(rings=[[(52, 36), (17, 37), (55, 29), (52, 36)], [(0, 29), (0, 31), (36, 33), (0, 29)]])
@given(rings=scrambles())
@settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_what_comes_out_is_valid_and_stays_as_it_is(rings: Any, tmp_path: Path) -> None:
    path = write(
        tmp_path,
        field([(-99, -99), (-98, -99), (-98, -98), (-99, -99)], owner="you"),
        field(*rings),
        owner="me",
    )
    try:
        plain: Farm | None = load_farm(path)
    except FarmError:
        plain = None
    try:
        farm = load_farm(path, repair=True)
    except FarmError as error:
        assert plain is None
        assert "feature 2" in str(error)
        return
    if plain is not None:
        xy = shapely.Polygon(rings[0], rings[1:])

        # Those that only just are valid may not be so in another frame.
        def noisy(at: np.ndarray, k: int) -> np.ndarray:
            return at + 1e-7 * np.sin(k + 991.0 * at + 703.0 * at[:, ::-1])

        if all(shapely.transform(xy, lambda at, k=k: noisy(at, k)).is_valid for k in range(9)):
            assert farm.notes == ()
            assert [one.polygon for one in farm.patches] == [one.polygon for one in plain.patches]
        return
    assert all(one.polygon.is_valid for one in farm.patches)
    drawn, land = (float(one) for one in re.findall(r"([\d.]+) (?:->|m2)", farm.notes[-1]))
    outline = shapely.Polygon(rings[0])
    assert sum(one.polygon.area for one in farm.patches[1:]) == pytest.approx(land, abs=0.3)
    assert land <= outline.area * 1.011 + 0.1
    if len(rings) == 1:
        assert land == pytest.approx(drawn, rel=0.0102, abs=0.11)
    saved = tmp_path / "saved.geojson"
    save_farm(farm, saved)
    assert load_farm(saved, repair=True).notes == ()
