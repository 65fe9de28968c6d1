"""Farms as other programs leave them: what of a file is the farm, and what is left out or refused."""

import json
import math
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from geo import FarmError, get_farm

FOREIGN = Path(__file__).parents[1] / "data" / "foreign"
LON, LAT = 10.0, 50.0
CROP_NOTE = "no patch names its crop: the crop is called 'crop'; --crop gives a name"


def square(x=0.0):
    corners = [(x, 0.0), (x + 0.001, 0.0), (x + 0.001, 0.001), (x, 0.001), (x, 0.0)]
    return [[LON + dx, LAT + dy] for dx, dy in corners]


def feature(geometry, **properties):
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def polygon(x=0.0):
    return {"type": "Polygon", "coordinates": [square(x)]}


def loaded(text, name="farm.geojson", **how):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return get_farm(path, **how)


def areas(farm):
    return [(one.name, str(one.crop), round(one.polygon.area, 3)) for one in farm.patches]


@pytest.mark.parametrize(
    ("name", "area_ha", "told"),
    [
        ("macos.zip", 3.00, CROP_NOTE),
        ("dji_mapping.kmz", 4.12, "feature 1 ('patch 1'): an open ring was closed over 221.83 m"),
        ("label.geojson", 3.19, "1 feature left out (points that are neither home nor rally): Silo"),
        ("tramline.geojson", 3.19, "1 feature left out (lines): tramline"),
        ("bare_feature.geojson", 4.12, CROP_NOTE),
        ("missionplanner.poly", 4.12, CROP_NOTE),
    ],
)
def test_files_of_other_programs(name, area_ha, told):
    farm = get_farm(FOREIGN / name)
    assert farm.owner_area.area / 1e4 == pytest.approx(area_ha, abs=0.01)
    assert told in farm.notes


LABELS = [
    feature({"type": "Point", "coordinates": [LON, LAT]}, name="Silo"),
    feature({"type": "Point", "coordinates": []}, name="nowhere"),
    feature({"type": "MultiPoint", "coordinates": [[LON, LAT]]}),
    feature({"type": "LineString", "coordinates": square()}, name="tramline"),
    feature({"type": "MultiLineString", "coordinates": [square()]}, name="tramlines"),
    feature({"type": "Polygon", "coordinates": []}, name="deleted"),
    feature({"type": "GeometryCollection", "geometries": [{"type": "Point", "coordinates": [LON, LAT]}]}),
    feature({"type": "GeometryCollection", "geometries": []}),
    feature(None, name="without", crop="rye"),
    {"type": "Feature", "properties": None, "geometry": None},
]


def test_what_is_no_land_is_left_out_and_told():
    both = {"type": "GeometryCollection", "geometries": [LABELS[0]["geometry"], polygon(0.002)]}
    fields = [feature(polygon(), name="a", crop="wheat"), feature(both, name="b", crop="rye")]
    document = {"type": "FeatureCollection", "features": [*LABELS[:5], *fields, *LABELS[5:]]}
    farm = loaded(json.dumps(document))
    assert [name for name, *_ in areas(farm)] == ["a", "b"]
    assert farm.notes == (
        "3 features left out (points that are neither home nor rally): Silo, feature 3, feature 9",
        "5 features left out (without geometry): nowhere, deleted, feature 10, without, feature 12",
        "2 features left out (lines): tramline, tramlines",
    )
    with pytest.raises(FarmError, match=r"holds no polygons: 3 features left out .*; draw the fields as pol"):
        loaded(json.dumps({"type": "FeatureCollection", "features": LABELS}))


def test_multipoints_are_places_and_obstacles_without_area_are_named():
    """GIS tools store points as MultiPoint; heights of fields are not read as those of obstacles."""
    corners = [[LON, LAT], [LON + 0.0005, LAT]]
    features = [
        feature(polygon(), name="a", crop="wheat", height=1520, margin="wide"),
        feature({"type": "MultiPoint", "coordinates": corners[:1]}, kind="home"),
        feature({"type": "MultiPoint", "coordinates": corners}, name="rally points"),
        feature({"type": "Point", "coordinates": corners[0]}, name="mast", obstacle=True, height=30),
        feature({"type": "LineString", "coordinates": corners}, name="cable", kind="no-fly zone"),
    ]
    farm = loaded(json.dumps({"type": "FeatureCollection", "features": features}))
    assert farm.home_m == pytest.approx(farm.frame.from_wgs84(LAT, LON))
    assert np.array(farm.rally_m) == pytest.approx(
        np.array([farm.frame.from_wgs84(latitude, longitude) for longitude, latitude in corners])
    )
    assert farm.notes == ("2 features left out (obstacles that are not polygons): mast, cable",)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\n\n"])
@pytest.mark.parametrize("begin", ["", "\ufeff"])
def test_features_one_after_the_other_are_a_farm(begin, end):
    named = [("a", "wheat", ""), ("m\u00fc\u4e2d", "rye", "\u2028"), ("c", "wheat", " ")]
    features = [
        feature(polygon(0.002 * k), name=name, crop=crop, remark=remark)
        for k, (name, crop, remark) in enumerate(named)
    ]
    whole = areas(loaded(json.dumps({"type": "FeatureCollection", "features": features})))
    lines = begin + end.join(json.dumps(one, ensure_ascii=False) for one in features) + end
    assert areas(loaded(lines, "farm.geojsonl")) == whole
    for indent in (None, 2):
        parted = "".join(f"\x1e{json.dumps(one, indent=indent)}{end}" for one in features)
        assert areas(loaded(begin + parted, "farm.geojsons")) == whole
    collections = [{"type": "FeatureCollection", "features": [one]} for one in features]
    assert areas(loaded("\n".join(map(json.dumps, collections)), "farm.json")) == whole


@pytest.mark.parametrize(
    "geometry",
    [
        polygon(),
        {"type": "MultiPolygon", "coordinates": [[square()], [square(0.002)]]},
        {
            "type": "GeometryCollection",
            "geometries": [
                {"type": "GeometryCollection", "geometries": [polygon()]},
                {"type": "MultiPolygon", "coordinates": [[square(0.002)]]},
            ],
        },
    ],
)
def test_a_geometry_alone_is_a_farm(geometry):
    bare = loaded(json.dumps(geometry, indent=1), crop="wheat")
    assert areas(bare) == areas(loaded(json.dumps(feature(geometry)), crop="wheat"))
    several = "\n".join(map(json.dumps, (geometry, polygon(0.004))))
    assert areas(loaded(several, crop="wheat"))[:-1] == areas(bare)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (json.dumps(feature(polygon())) + '\n{"type": "Feature",\n', "is not JSON (line 2: it ends in"),
        (json.dumps(feature(polygon())) + "\n\n{]\n", "is not JSON (line 3, column 2: "),
        ("\x1e{}\n\x1e{}", 'is not a GeoJSON "FeatureCollection", "Feature" or geometry'),
        ('{"type": "Feature", "properties": {}}', 'feature 1: has no "geometry"; write null'),
        ('{"type": "Feature", "properties": [], "geometry": null}', 'feature 1: its "properties" are []'),
        ((json.dumps(feature(None)) + "\n") * 10_001, "has more than 10000 features"),
        ("[" * 100_000, "is n"),
        (json.dumps(feature(polygon())).encode("utf-16"), "cannot be read: it is not UTF-8 text (byte 0)"),
        ('{"type": "Polygon", "coordinates": [[[1e308, 1], [1, 1e999], [2, 2]]]}', "is not "),
    ],
)
def test_sequences_that_are_none(text, told):
    with pytest.raises(FarmError) as caught:
        loaded(text)
    message = str(caught.value)
    assert told in message
    assert "\n" not in message and len(message) < 500


@st.composite
def rings(draw):
    count = draw(st.integers(3, 12))
    size, lat, lon = draw(st.floats(0.0005, 0.002)), draw(st.floats(-60, 60)), draw(st.floats(-179, 179))
    angles = [2 * math.pi * k / count for k in range(count)]
    return [(lat + size * math.sin(one), lon + size * math.cos(one)) for one in angles]


@example(
    [(-6.0, 0.0005), (-5.999566987298108, -0.00025), (-6.000433012701892, -0.00025)], " ", "\n", False, False
)
@settings(max_examples=40)
@given(
    rings(), st.sampled_from([" ", "\t", "  "]), st.sampled_from(["\n", "\r\n"]), st.booleans(), st.booleans()
)
def test_a_polygon_of_mission_planner(ring, space, end, comma, closed):
    corners = ring + ring[:1] * closed
    lines = ["#saved by Mission Planner 1.3.80", *(f"{lat:.14f}{space}{lon:.14f}" for lat, lon in corners)]
    text = end.join(lines) + end
    farm = loaded(text.replace(".", ",") if comma else text, "field.poly", crop="wheat")
    (patch,) = farm.patches
    found = np.column_stack(farm.frame.to_wgs84(*np.array(patch.polygon.exterior.coords).T.copy()))
    assert np.allclose(found[:-1], ring, atol=1e-8, rtol=0)  # a millimetre: PROJ rounds about the origin
    assert len(farm.notes) == (not closed)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("Name:a\nColor:b\n", "has no corners"),
        ("50 10\n50 10.001\n", "a ring has fewer than three corners"),
        (
            "australia_v\n1\n   0.1446E+03   -0.3825E+02\nEND\nEND\n",
            "line 1: 'australia_v' is not a latitude and",
        ),
        ("50 10 3\n", "line 1: '50 10 3' is not a latitude and a longitude"),
        ("500 10\n501 10\n501 11\n", "latitude 500 is outside"),
        ("inf nan\n1 2\n3 4\n", "is not a position"),
        ("50 10\n" * 100_001, "line 100001: more than 100000 corners"),
        ("Name:\n" * 10_001, "line 10001: more than"),
        ("50 10\n".encode("utf-16"), "it is not UTF-8 text"),
    ],
)
def test_what_is_no_polygon_of_mission_planner(text, told):
    with pytest.raises(FarmError) as caught:
        loaded(text, "a.poly")
    message = str(caught.value)
    assert told in message
    assert "\n" not in message and len(message) < 500
    with pytest.raises(FarmError, match=r"a \.poly is in degrees of WGS 84; leave out"):
        loaded(text, "a.poly", crs="EPSG:32617")


SEEDS = [path.read_bytes() for path in sorted(FOREIGN.iterdir()) if path.suffix in (".geojson", ".poly")]
NAMES = ["a.geojson", "a.geojsonl", "a.poly", "a.kml", "a.kmz", "a.zip"]


@st.composite
def damaged(draw):
    """Return a file that is cut off, has bytes changed, is in another encoding, or says a part many times."""
    data = draw(st.sampled_from(SEEDS))
    at = draw(st.integers(0, len(data)))
    text = data.decode()
    kind = draw(st.integers(0, 5))
    if kind == 0:
        return data[:at]
    if kind == 1:
        return data[:at] + draw(st.binary(max_size=8)) + data[at:]
    if kind == 2:
        return text.encode(draw(st.sampled_from(["utf-16", "utf-16-be", "utf-32", "cp500"])))
    if kind == 3:
        return data[:at] + data[at : at + 20] * draw(st.integers(2, 2000)) + data[at:]
    if kind == 4:
        number = draw(
            st.sampled_from(["1e999", "-1e308", "9" * 400, "NaN", "0x10", "1_0", "\u0661", "null", "[]"])
        )
        return text.replace("50", number).replace("33", number).encode()
    return draw(st.sampled_from([b"[", b'{"a":', b"\x1e", b"\n", b"<a>", b"PK\3\4"])) * draw(
        st.integers(1, 5000)
    )


@settings(max_examples=60)
@given(damaged(), st.sampled_from(NAMES))
def test_whatever_a_file_holds_the_answer_is_a_farm_or_a_line(data, name):
    try:
        loaded(data, name)
    except FarmError as error:
        message = str(error)
        assert message.startswith("farm file ") and name in message
        assert "\n" not in message and len(message) < 600
