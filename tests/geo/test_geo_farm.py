"""Farms: the benchmark's, and the arithmetic of cells."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from geo import FOOT_M, Crop, Farm, FarmError, LocalFrame, Obstacle, Patch, farm_names, get_farm
from geo.farm import united

FRAME = LocalFrame(28.05, -82.15)


def field(name, crop, owner, *box):
    return Patch(name, crop, owner, shapely.box(*box))


def farm(*patches, width=10, height=10, cell_size_m=1.0):
    return Farm("f", FRAME, width, height, patches, "me", (0.5, 0.5), cell_size_m)


def test_names():
    assert farm_names() == ("miniberry-10", "miniberry-30", "miniberry-100", "waterberry")
    assert get_farm("WaterBerry") is get_farm("waterberry")
    with pytest.raises(FarmError, match="unknown farm 'blueberry': choose miniberry-10, "):
        get_farm("blueberry")


def test_waterberry():
    waterberry = get_farm("waterberry")
    grid = Farm(*(getattr(waterberry, name) for name in waterberry.__dataclass_fields__)).grid()
    assert grid.shape == (6000, 5000)
    assert grid.owned[1000:5000, 1000:4000].all()
    assert waterberry.owner_cells == 12_000_000
    assert grid.of_crops(set(Crop) - {Crop.NONE}).all()
    assert waterberry.cell_of(*waterberry.home_m) == (1000, 1000)
    # Slanted border x = 4000 - (y - 1000) / 3, in sixths of a cell; tomatoes are painted later.
    for iy in (1000, 1001, 1002, 2000, 2500, 3300):
        border_sixths = 24000 - (2 * iy + 1 - 2000)
        first_tomato = -((3 - border_sixths) // 6)
        row = [grid.crops[number] for number in grid.crop[:, iy]]
        assert row[first_tomato] == Crop.TOMATO, iy
        assert row[first_tomato - 1] == Crop.STRAWBERRY, iy
    pond = int(grid.of_crops([Crop.POND]).sum())
    assert pond == pytest.approx(0.5 * 24 * 200**2 * np.sin(np.pi / 12), rel=2e-3)
    assert grid.crops[grid.crop[4000, 3999]] == Crop.WETLAND
    assert grid.crops[grid.crop[4000, 4000]] == Crop.TOMATO
    assert grid.crops[grid.crop[3000, 500]] == Crop.STRAWBERRY
    assert grid.planted.sum() == 12_000_000 - pond - grid.of_crops([Crop.WETLAND]).sum()


def test_waterberry_areas():
    waterberry = get_farm("waterberry")
    # Arcs are rounded: another library of C has other last bits of sines.
    pond = waterberry.patches[2].polygon
    assert pond == shapely.Polygon(np.round(shapely.get_coordinates(pond) / FOOT_M, 6) * FOOT_M)
    corners = shapely.get_coordinates(waterberry.owner_area) / FOOT_M
    assert len(corners) == 5
    assert shapely.Polygon(corners).symmetric_difference(shapely.box(1000, 1000, 5000, 4000)).area < 0.1
    assert waterberry.crop_area(Crop.POND).within(waterberry.owner_area)
    whole = sum(waterberry.crop_area(crop).area for crop in Crop)
    assert whole == pytest.approx(waterberry.owner_area.area, rel=1e-9)


def test_what_is_made_of_an_area_is_not_rounded():
    """Planners ask whether a leg lies within the area and less than a micrometre beside it."""
    bank = shapely.LineString([(20, 20), (33, 47), (61, 52), (70, 81)]).buffer(7.0)
    for patches in ([bank], [bank, shapely.box(5, 5, 15, 15)]):
        one = farm(*(Patch(f"p{k}", Crop.TOMATO, "me", area) for k, area in enumerate(patches)))
        for area in (one.owner_area, one.crop_area(Crop.TOMATO)):
            wider = shapely.buffer(area, 5e-7, join_style="mitre", mitre_limit=2.0)
            assert wider.area - area.area == pytest.approx(5e-7 * area.length, rel=1e-3)


@given(
    st.lists(
        st.tuples(
            st.sampled_from([Crop.TOMATO, Crop.STRAWBERRY]),
            st.sampled_from(["me", "you"]),
            *(st.integers(0, 12) for _ in range(2)),
            *(st.integers(1, 6) for _ in range(2)),
        ),
        max_size=12,
    )
)
def test_areas_are_those_of_painting_one_patch_after_the_other(rectangles):
    patches = [
        field(str(number), crop, owner, x, y, x + width, y + height)
        for number, (crop, owner, x, y, width, height) in enumerate(rectangles)
    ]
    painted = farm(field("last", Crop.TOMATO, "me", 20, 20, 21, 21), *patches)
    for found, crops in (
        (painted.crop_area(Crop.TOMATO), {Crop.TOMATO}),
        (painted.crop_area(Crop.STRAWBERRY), {Crop.STRAWBERRY}),
        (painted.owner_area, {Crop.TOMATO, Crop.STRAWBERRY}),
    ):
        land = shapely.Polygon()
        for patch in painted.patches:
            is_part = patch.owner == "me" and patch.crop in crops
            land = (shapely.union if is_part else shapely.difference)(land, patch.polygon)
        assert found.symmetric_difference(land).area < 1e-9


@given(st.integers(0, 20000), st.sampled_from([FOOT_M, 1.0, 0.1]))
def test_every_multiple_of_the_cell_size_begins_its_cell(k, cell_size_m):
    some = farm(field("a", Crop.TOMATO, "me", 0, 0, 1, 1), cell_size_m=cell_size_m)
    assert some.cell_of(k * cell_size_m, k * cell_size_m) == (k, k)
    assert some.cell_of(*some.cell_centre(k, k)) == (k, k)
    ix, iy = some.cell_of(np.array([k * cell_size_m]), np.array([(k + 0.999) * cell_size_m]))
    assert (ix.dtype, int(ix[0]), int(iy[0])) == (np.int64, k, k)


def test_cells_outside_and_nowhere():
    some = farm(field("a", Crop.TOMATO, "me", 0, 0, 1, 1))
    assert some.cell_of(-0.5, 12.0) == (-1, 12)
    assert some.cell_of(float("inf"), float("nan")) == (-1, -1)
    ix, _ = some.cell_of(np.array([np.inf, np.nan, -3.5, 1e300]), np.zeros(4))
    assert ix.tolist() == [-1, -1, -4, -1]
    x_m, y_m = some.cell_centre(np.arange(3), np.arange(3))
    assert x_m.tolist() == y_m.tolist() == [0.5, 1.5, 2.5]


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"width_cells": 0}, "has no cells"),
        ({"width_cells": 10**6, "height_cells": 10**6}, "more than"),
        ({"cell_size_m": 0.0}, "is not positive"),
        ({"cell_size_m": float("nan")}, "is not positive"),
        ({"owner": "nobody"}, "no patch belongs to the owner 'nobody'"),
    ],
)
def test_impossible_farms_are_refused(change, text):
    arguments = {
        "name": "f",
        "frame": FRAME,
        "width_cells": 2,
        "height_cells": 2,
        "patches": (field("a", Crop.TOMATO, "me", 0, 0, 1, 1),),
        "owner": "me",
        "home_m": (0.0, 0.0),
    }
    with pytest.raises(FarmError, match=text):
        Farm(**{**arguments, **change})


# Corners of five parts of a field of 40 x 30 m. In this order GEOS 3.14 loses two parts: copies of a corner
# differ in the last digit.
CORNERS = [
    "0 0, 0 11.18006959650366, 18.42344728395126 13.08105884822156, 19.41547418006055 12.302495098376605, "
    "20.413147725754534 0, 0 0",
    "0 30, 16.914006357158637 30, 18.423447283951262 13.08105884822156, 0 11.18006959650366, 0 30",
    "40 0, 20.413147725754534 0, 19.415474180060553 12.302495098376609, "
    "29.169732490304465 17.082172494531093, 40 13.881547745275437, 40 0",
    "40 30, 40 13.881547745275437, 29.169732490304465 17.082172494531093, 28.482273773233857 30, 40 30",
    "28.482273773233857 30, 29.169732490304465 17.082172494531093, 19.41547418006055 12.302495098376607, "
    "18.423447283951262 13.081058848221561, 16.914006357158637 30, 28.482273773233857 30",
]


def test_no_area_is_lost_where_borders_differ_by_rounding():
    parts = [shapely.from_wkt(f"POLYGON (({corners}))") for corners in CORNERS]
    whole = united(parts)
    assert whole.area == pytest.approx(1200.0, abs=1e-3)
    assert shapely.get_precision(whole) == 0.0
    obstacles = tuple(map(Obstacle, parts))
    land = replace(farm(field("a", Crop.TOMATO, "me", -5, -5, 45, 35)), obstacles=obstacles)
    assert land.scouted_area.area == pytest.approx(2000.0 - 1200.0, abs=1e-3)


def test_no_obstacle_stays_in_the_land_where_borders_differ_by_rounding():
    land = shapely.from_wkt(
        "POLYGON ((0 0, 0 30, 40 30, 40 0, 0 0), (2.82932592299442 15.812685911159543, "
        "14.502774180177967 8.57380167719099, 23.462222568155326 15.90290315188339, "
        "13.499851080165444 28.38700112645987, 2.82932592299442 15.812685911159543))"
    )
    pond = shapely.from_wkt(
        "POLYGON ((0 0, 0 15.57760602359765, 2.829325922994407 15.812685911159551, "
        "14.502774180177969 8.57380167719099, 14.62916790175368 0, 0 0))"
    )
    left = replace(farm(field("a", Crop.TOMATO, "me", 0, 0, 40, 30)), obstacles=(Obstacle(pond),))
    assert left.without_obstacles(land).area == pytest.approx(land.area - pond.area, abs=1e-3)


def test_a_union_without_fault_is_geos_own():
    shapes = [shapely.box(0, 0, 1 / 3, 1), shapely.box(0.1, 0.1, 0.7, 0.7), shapely.box(5, 5, 6, 6)]
    assert united(shapes).wkb == shapely.union_all(shapes).wkb
