"""Farm files: round trips, and files that are not what they claim."""

import copy
import json
import math
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from sweeps import sweep

from geo import FarmError, get_farm, load_farm, save_farm

LON, LAT = -82.15, 28.05


def ring(x=0.0, y=0.0, size=0.001):
    corners = [(x, y), (x + size, y), (x + size, y + size), (x, y + size), (x, y)]
    return [[LON + dx, LAT + dy] for dx, dy in corners]


def feature(coordinates=None, geometry="Polygon", **properties):
    return {
        "type": "Feature",
        "properties": {"crop": "tomato", "owner": "me", "name": "north field", **properties},
        "geometry": {"type": geometry, "coordinates": [ring()] if coordinates is None else coordinates},
    }


def document(*features, **members):
    return {"type": "FeatureCollection", "cell_size_m": 1.0, **members, "features": list(features)}


def write(path, content):
    file = path / "farm.geojson"
    file.write_bytes(content if isinstance(content, bytes) else json.dumps(content).encode())
    return file


def refused(path, content):
    with pytest.raises(FarmError) as caught:
        load_farm(write(path, content))
    text = str(caught.value)
    assert "\n" not in text
    assert len(text) < 600
    assert text.startswith("farm file ")
    return text


def same(a, b):
    assert (a.name, a.owner, a.cell_size_m, a.frame) == (b.name, b.owner, b.cell_size_m, b.frame)
    assert a.home_m == pytest.approx(b.home_m, abs=1e-6)
    assert [(p.name, p.crop, p.owner) for p in a.patches] == [(p.name, p.crop, p.owner) for p in b.patches]
    np.testing.assert_array_equal(a.grid().crop, b.grid().crop)
    np.testing.assert_array_equal(a.grid().owned, b.grid().owned)
    assert len(a.obstacles) == len(b.obstacles)
    for mine, other in zip(a.obstacles, b.obstacles, strict=True):
        assert mine.polygon.symmetric_difference(other.polygon).area < 1e-5
        assert (mine.height_m, mine.margin_m) == (other.height_m, other.margin_m)
        assert mine.name == other.name or not other.name
    assert np.allclose(a.rally_m, b.rally_m, atol=1e-6) and len(a.rally_m) == len(b.rally_m)


@pytest.mark.parametrize("name", ["miniberry-10", "waterberry"])
def test_built_in_farms_round_trip(name, tmp_path):
    path = tmp_path / "saved.geojson"
    save_farm(get_farm(name), path)
    same(load_farm(path), get_farm(name))
    for entry in json.loads(path.read_text())["features"]:
        exterior = shapely.LinearRing(entry["geometry"]["coordinates"][0])
        assert exterior.is_ccw and exterior.coords[0] == exterior.coords[-1]


def coordinates_of(farm):
    shapes = [*farm.patches, *farm.obstacles]
    return [farm.home_m, farm.rally_m, *(shapely.to_wkb(one.polygon) for one in shapes)]


@given(
    latitude=st.floats(-74, 74),
    longitude=st.floats(-179.9, 179.9),
    rotation=st.just(0.0) | st.floats(-360, 360),
    corners=st.lists(st.floats(0.3, 1.0), min_size=4, max_size=9),
    clockwise=st.booleans(),
    has_home=st.booleans(),
    has_origin=st.booleans(),
    digits=st.integers(6, 16),
)
@example(28.03, -82.11, 0.0, [1.0, 0.5, 0.8, 1.0], True, False, False, 16)
@example(0.0, 0.0, 0.0, [1.0, 0.5, 0.8, 1.0], False, False, False, 16)
@sweep(few=10, many=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_file_s_farm_saved_is_the_same_to_the_last_bit(
    tmp_path, latitude, longitude, rotation, corners, clockwise, has_home, has_origin, digits
):
    def around(size, *, backwards):
        turns = [2 * math.pi * k / len(corners) for k in range(len(corners))]
        found = [
            [
                round(longitude + size * far * math.cos(turn), digits),
                round(latitude + size * far * math.sin(turn), digits),
            ]
            for turn, far in zip(turns, corners, strict=True)
        ]
        return [*found, found[0]][:: -1 if backwards else 1]

    rings = [around(0.004, backwards=clockwise), around(0.001, backwards=clockwise)]
    ring = around(0.0003, backwards=clockwise)
    pole = feature([ring], obstacle=True, name="pole", height_m=6.5, margin_m=0.0)
    members = {
        "rotation_deg": rotation,
        "ground_altitude_m": 12.0,
        "rally": [[longitude + 0.0021, latitude - 0.0017]],
    }
    if has_home:
        members["home"] = [longitude - 0.0043, latitude + 0.0001]
    if has_origin:
        members["origin"] = [longitude - 0.0051, latitude - 0.0052]
        members["rotation_deg"] = 0.0
    first = load_farm(write(tmp_path, document(feature(rings), pole, **members)))
    save_farm(first, tmp_path / "saved.geojson")
    second = load_farm(tmp_path / "saved.geojson")
    assert coordinates_of(second) == coordinates_of(first)
    same(second, first)


def test_a_minimal_file(tmp_path):
    content = {"type": "FeatureCollection", "features": [feature()]}
    farm = load_farm(write(tmp_path, content))
    assert (farm.name, farm.owner, farm.cell_size_m) == ("farm", "me", 0.3048)
    width_m, height_m = farm.width_cells * 0.3048, farm.height_cells * 0.3048
    assert width_m == pytest.approx(0.001 * 111412 * math.cos(math.radians(LAT)), rel=0.003)
    assert height_m == pytest.approx(0.001 * 110805, rel=0.003)
    assert farm.home_m == pytest.approx((0.0, 0.0), abs=0.01)
    assert farm.owner_cells > 0.999 * farm.width_cells * farm.height_cells
    assert farm.patches[0].polygon.bounds[0] == pytest.approx(0.0, abs=1e-6)


def test_the_grid_is_the_bounding_box_of_all_patches(tmp_path):
    far = feature([ring(0.002, 0.003)], owner="neighbour", name="far")
    for rotation in (0.0, 30.0, -100.0):
        farm = load_farm(write(tmp_path, document(far, feature(), owner="me", rotation_deg=rotation)))
        bounds = shapely.total_bounds([patch.polygon for patch in farm.patches])
        assert bounds[:2] == pytest.approx([0.0, 0.0], abs=1e-6)
        assert (farm.width_cells, farm.height_cells) == (math.ceil(bounds[2]), math.ceil(bounds[3]))


def test_members_and_defaults(tmp_path):
    pond = {"type": "Feature", "properties": {"obstacle": True}, "geometry": feature()["geometry"]}
    farm = load_farm(
        write(
            tmp_path,
            document(
                feature(), pond, name="North", home=[LON, LAT], ground_altitude_m=31.5, size_cells=[200, 150]
            ),
        )
    )
    assert (farm.name, farm.frame.altitude_m, farm.width_cells, farm.height_cells) == (
        "North",
        31.5,
        200,
        150,
    )
    assert farm.home_m == pytest.approx((0.0, 0.0), abs=0.01)
    assert (len(farm.patches), len(farm.obstacles)) == (1, 1)


BOW_TIE = [[[LON, LAT], [LON + 0.001, LAT + 0.001], [LON + 0.001, LAT], [LON, LAT + 0.001], [LON, LAT]]]
NARROW = [[LON + 0.0001 * k, LAT + 0.0000001 * k * k] for k in range(11)]
SWAPPED = [[[lat, lon] for lon, lat in ring()]]


@pytest.mark.parametrize(
    ("bad", "text"),
    [
        (feature(BOW_TIE), "not valid: Self-intersection near ["),
        (feature(BOW_TIE), "]; --repair mends what is safe to mend"),
        (feature([[]]), "the polygon is empty"),
        (feature([ring()[:2]]), "fewer than three corners"),
        (feature([NARROW]), "a ring is open over 98.3 m, but its longest side is only 9.8 m long"),
        (feature([[[LON, LAT]] * 4]), "the polygon"),
        (feature([ring(), ring(0.1, 0.1, 0.001)]), "not valid: Hole lies outside"),
        (feature([[ring()], [NARROW]], "MultiPolygon"), "part 2: a ring is open"),
        (feature([[LON, LAT]], "Curve"), "geometry is 'Curve', not a Polygon or MultiPolygon"),
        (feature([[[LON, 95.0], *ring()[1:4], [LON, 95.0]]]), "latitude 95 is outside"),
        (
            feature([[[180.0001, LAT], *ring()[1:4], [180.0001, LAT]]]),
            "longitude 180.0001 is outside -180..180; write it as -179.9999",
        ),
        (feature([[[LON, 3e6], *ring()[1:4], [LON, 3e6]]]), "latitude] in degrees, or need --farm-crs"),
        (feature([ring(1.0, 0.0)]), "lies 98 km from the first feature"),
        (feature([[[True, False]] * 4]), "is not a position"),
        (feature([[7, 7, 7, 7]]), "is not a position"),
        (feature(obstacle=True, height_m=-1), 'property "height_m": -1 is not a number in 0..1000'),
        (feature(obstacle=True, margin_m="2"), "property \"margin_m\": '2' is not a number in 0..1000"),
        (feature(no_fly=1), 'property "no_fly" is not true or false'),
        (feature(no_fly=True, height_m=3), "is a no-fly zone, which has no height"),
        (feature(crop=None), 'property "crop" is missing'),
        (feature(owner=""), "\"owner\" is '', not a short line"),
        (feature(crop=[3]), '"crop" is [3], not a short line'),
        (feature(obstacle=True, Height=10**400), 'property "height_m": 100000'),
    ],
)
def test_the_bad_feature_is_named(bad, text, tmp_path):
    bad["properties"]["name"] = "the bad one"
    message = refused(tmp_path, document(feature(), bad))
    assert "feature 2 ('the bad one')" in message
    assert text in message


@pytest.mark.parametrize("bad", [None, 7, [], {"type": "Point"}, {"type": "Feature"}])
def test_what_is_no_feature_is_named_by_its_index(bad, tmp_path):
    assert "feature 2: " in refused(tmp_path, document(feature(), bad))


def test_wrong_axis_order(tmp_path):
    europe = feature(
        [[[lat, lon] for lat, lon in ((48.1, 11.5), (48.101, 11.5), (48.1, 11.501), (48.1, 11.5))]]
    )
    for content, told in (
        (document(feature(SWAPPED)), "feature 1 ('north field'): nothing grows at latitude -82.15"),
        (document(europe, home=[11.5, 48.1]), "latitude and longitude are swapped"),
        (document(feature(), feature(SWAPPED, name="turned"), home=[LON, LAT]), "feature 2 ('turned')"),
    ):
        message = refused(tmp_path, content)
        assert told in message and "swapped" in message


@pytest.mark.parametrize(
    ("members", "text"),
    [
        ({"owner": "nobody"}, "no feature belongs to the owner 'nobody'; the owners are 'me'"),
        ({"cell_size_m": 0}, "cell_size_m"),
        ({"rotation_deg": 1e9}, "rotation_deg"),
        ({"home": [0, 0]}, 'from the farm\'s "home"'),
        ({"origin": "here"}, '"origin"'),
        ({"origin": [0, 0]}, 'from the farm\'s "origin"'),
        ({"origin": [LON + 0.0005, LAT]}, "south or west"),
        ({"rally": [[LON, LAT]] * 101}, "has 101 rally points; give at most 100"),
        ({"size_cells": [5]}, "size_cells"),
        ({"size_cells": [10, 10]}, "less than the patches need"),
        ({"size_cells": [10**7, 10**7]}, "more than"),
        ({"name": "\t"}, '"name"'),
    ],
)
def test_bad_members(members, text, tmp_path):
    assert text in refused(tmp_path, document(feature(), **members))


@pytest.mark.parametrize(
    "name", ["urn:ogc:def:crs:OGC:1.3:CRS84", "http://www.opengis.net/def/crs/OGC/1.3/CRS84", "EPSG:4326"]
)
def test_the_ways_to_write_wgs84(name, tmp_path):
    crs = {"type": "name", "properties": {"name": name}}
    same(
        load_farm(write(tmp_path, document(feature(), crs=crs))),
        load_farm(write(tmp_path, document(feature()))),
    )


@pytest.mark.parametrize(
    ("crs", "text"),
    [
        ({"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::43260"}}, "cannot be used: "),
        ({"type": "name", "properties": {"name": "+proj=utm +zone=17"}}, "is not a coordinate system"),
        ({"type": "link", "properties": {"href": "http://example.com/crs/42"}}, "names no coordinate system"),
        ("EPSG:4326 or so", "names no coordinate system"),
    ],
)
def test_what_is_no_coordinate_system_is_refused(crs, text, tmp_path):
    message = refused(tmp_path, document(feature(), crs=crs))
    assert 'the file: member "crs"' in message
    assert text in message
    one = {**feature(), "crs": crs}
    assert "feature 1 ('north field'): member \"crs\"" in refused(tmp_path, document(one))
    inside = feature()
    inside["geometry"]["crs"] = crs
    assert "feature 1 ('north field'): member \"crs\"" in refused(tmp_path, document(inside))


def test_positions_beyond_a_coordinate_system(tmp_path):
    crs = {"type": "name", "properties": {"name": "EPSG:32617"}}
    far = feature([[[1e9, 1e9], [1e9, 2e9], [2e9, 2e9], [1e9, 1e9]]])
    assert "is not a place in WGS 84 / UTM zone 17N" in refused(tmp_path, document(far, crs=crs))


def test_parts_places_and_names_of_other_programs(tmp_path):
    both = feature([[ring()], [ring(0.002)]], "MultiPolygon", name="two")
    collection = feature(name="one", crop=115)
    collection["geometry"] = {
        "type": "GeometryCollection",
        "geometries": [feature([ring(0.004)])["geometry"]],
    }
    foreign = feature([ring(0.006)])
    foreign["properties"] = {"Crop_Name": "Maize (silage)", "GROWER": "me", "Label": "far", "type": "arable"}
    home = feature([LON, LAT, 3.0], "Point", name="Home")
    rally = feature([LON + 0.001, LAT], "Point", name="behind the barn", kind="rally point")
    shed = feature([ring(0.0082, 0.0, 0.0001)], kind="Obstacle", height_m=4)
    zone = feature([ring(0.0086, 0.0, 0.0001)], kind="no-fly")
    farm = load_farm(write(tmp_path, document(both, collection, foreign, home, rally, shed, zone)))
    assert [(one.name, one.crop) for one in farm.patches] == [
        ("two 1", "tomato"),
        ("two 2", "tomato"),
        ("one", "crop 115"),
        ("far", "maize silage"),
    ]
    assert [one.height_m for one in farm.obstacles] == [4.0, None]
    assert farm.home_m == pytest.approx(farm.frame.from_wgs84(LAT, LON))
    assert farm.rally_m == (pytest.approx(farm.frame.from_wgs84(LAT, LON + 0.001)),)
    text = refused(tmp_path, document(feature(), home, home=[LON, LAT]))
    assert "feature 2 ('Home'): is a second home" in text


def test_names_of_any_length_and_characters_survive_a_round_trip(tmp_path):
    both = feature([[ring()], [ring(0.002)]], "MultiPolygon", name="x" * 199, owner="M\u00fcller\u00a0KG")
    odd = feature([ring(0.004)], name="north\u00a0field\n2", owner="M\u00fcller\tKG", crop="sweet\u00a0Corn")
    numbered = feature([ring(0.006)], name=12, owner="o" * 300)
    shed = feature([[ring(0.0082, 0.0, 1e-4)]], "MultiPolygon", name="s" * 300, obstacle=True)
    farm = load_farm(write(tmp_path, document(both, odd, numbered, shed, name="n" * 198 + " \u200bnn")))
    assert farm.name == "n" * 198 + " n"
    assert [(one.name, one.crop, one.owner) for one in farm.patches] == [
        ("x" * 198 + " 1", "tomato", "M\u00fcller KG"),
        ("x" * 198 + " 2", "tomato", "M\u00fcller KG"),
        ("north field 2", "sweet corn", "M\u00fcller KG"),
        ("12", "tomato", "o" * 200),
    ]
    save_farm(farm, tmp_path / "saved.geojson")
    again = load_farm(tmp_path / "saved.geojson")
    same(farm, again)
    assert [one.name for one in again.obstacles] == [one.name for one in farm.obstacles] == ["s" * 200]


@pytest.mark.parametrize(
    ("stem", "name"),
    [("north\u00a0field", "north field"), ("f" * 230, "f" * 200), ("\u00a0", "farm"), ("a\udcffb", "a b")],
)
def test_a_farm_named_after_its_file_can_be_read_again(stem, name, tmp_path):
    farm = load_farm(write(tmp_path, document(feature())).rename(tmp_path / f"{stem}.geojson"))
    assert farm.name == name
    save_farm(farm, tmp_path / "saved.geojson")
    same(farm, load_farm(tmp_path / "saved.geojson"))


def test_a_file_without_crops_or_owners(tmp_path):
    bare = [feature([ring(0.002 * k)], name=None, crop=None, owner=None) for k in range(2)]
    farm = load_farm(write(tmp_path, document(*bare)))
    assert [(one.name, one.crop, one.owner) for one in farm.patches] == [
        ("patch 1", "crop", "owner"),
        ("patch 2", "crop", "owner"),
    ]
    assert farm.owner == "owner"
    assert farm.notes == ("no patch names its crop: the crop is called 'crop'; --crop gives a name",)
    named = load_farm(tmp_path / "farm.geojson", crop="sugar beet")
    assert ({one.crop for one in named.patches}, named.notes) == ({"sugar beet"}, ())
    with pytest.raises(FarmError, match="'Oats' is not a crop name"):
        load_farm(tmp_path / "farm.geojson", crop="Oats")


def test_large_farms_get_larger_cells_unless_the_file_says_otherwise(tmp_path):
    large = {"type": "FeatureCollection", "features": [feature([ring(size=0.008)])]}
    farm = load_farm(write(tmp_path, large))
    assert farm.cell_size_m == 0.5
    assert farm.width_cells * farm.height_cells <= 4_000_000
    assert farm.notes == ("cells are 0.5 m wide; one foot would give 7.5 million cells",)
    said = load_farm(write(tmp_path, {**large, "cell_size_m": 0.3048}))
    assert (said.cell_size_m, said.notes) == (0.3048, ())


def test_absurd_sizes(tmp_path):
    wide = document(feature(), feature([ring(0.09, 0.09)]), cell_size_m=0.05)
    assert "more than" in refused(tmp_path, wide)
    zigzag = [[LON + 0.01 * (k % 2), LAT + 1e-6 * k] for k in range(3000)]
    comb = [*zigzag, [LON + 0.02, LAT + 0.003], [LON + 0.02, LAT], zigzag[0]]
    assert "too detailed" in refused(tmp_path, document(feature([comb]), cell_size_m=0.1))
    long = [[LON, LAT]] * 100_001
    assert "simplify" in refused(tmp_path, document(feature([long])))


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (b"", "is not JSON"),
        (b'{"type": NaN}', "is not JSON"),
        (b"\xff\xfe{}", "is not UTF-8"),
        (b"[" * 200_000, "nested too deeply"),
        (b"[]", 'is not a GeoJSON "FeatureCollection"'),
        (b'{"type": "FeatureCollection", "features": []}', 'has no "features"'),
        (b" " * (33 * 2**20), "it is larger than 32 MiB"),
    ],
)
def test_files_that_are_something_else(content, text, tmp_path):
    assert text in refused(tmp_path, content)


def test_numbers_beyond_floats(tmp_path):
    text = json.dumps(document(feature()))
    for number in ("1e400", "9" * 400, "9" * 5000, "-1e999"):
        refused(tmp_path, text.replace(str(LON), number, 1).encode())


def test_only_obstacles(tmp_path):
    assert "only obstacles" in refused(tmp_path, document(feature(obstacle=True)))


def test_paths_that_are_no_files(tmp_path):
    for path in (tmp_path, tmp_path / "missing.geojson", Path("a\0b.json")):
        with pytest.raises(FarmError, match="farm file"):
            load_farm(path)
    with pytest.raises(FarmError, match="cannot be written"):
        save_farm(get_farm("miniberry-10"), tmp_path / "no" / "such" / "folder.geojson")


JUNK = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=8,
)


def places(node, path=()):
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    found = [path] if path else []
    for key, value in items:
        found += places(value, (*path, key))
    return found


GOOD = document(
    feature(),
    feature([ring(0.002)]),
    name="n",
    owner="me",
    home=[LON, LAT],
    rotation_deg=10,
    size_cells=[900, 900],
)


@given(data=st.data())
@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_mutated_files_load_or_are_refused_in_one_line(data, tmp_path):
    mutant = copy.deepcopy(GOOD)
    for _ in range(data.draw(st.integers(1, 3))):
        path = data.draw(st.sampled_from(places(mutant)))
        node = mutant
        for key in path[:-1]:
            node = node[key]
        node[path[-1]] = data.draw(JUNK)
    try:
        load_farm(write(tmp_path, mutant))
    except FarmError as error:
        assert "\n" not in str(error)


def test_a_field_that_is_split_at_the_date_line_is_one(tmp_path):
    south, north = -16.8, -16.797
    halves = [
        [[[west, south], [east, south], [east, north], [west, north], [west, south]]]
        for west, east in ((179.998, 180.0), (-180.0, -179.998))
    ]
    farm = load_farm(write(tmp_path, document(feature(halves, "MultiPolygon"))))
    assert farm.owner_area.geom_type == "Polygon"
    assert farm.width_cells == pytest.approx(426, abs=2)
    x, y = shapely.get_coordinates(farm.owner_area).T
    latitude, longitude = farm.frame.to_wgs84(x, y)
    assert np.abs(longitude).max() <= 180.0
    assert all(abs(farm.frame.to_wgs84(*map(float, place))[1]) <= 180.0 for place in zip(x, y, strict=True))
    assert np.unique(np.sign(longitude)).tolist() == [-1.0, 1.0]
    assert latitude.min() == pytest.approx(south, abs=1e-6)
