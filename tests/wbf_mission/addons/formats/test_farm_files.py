"""Farms from files of other programs: one farm in every format and many coordinate systems, and bad files."""

from __future__ import annotations

import sqlite3
import zipfile
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio.raw
import pyproj
import pytest
import shapely
from hypothesis import HealthCheck, given
from hypothesis import strategies as st
from packages import install
from sweeps import sweep

from geo import Farm, FarmError, LocalFrame, get_farm, load_farm
from geo.features import MAX_FEATURES
from wbf_mission.addons.base.archive import archive_of

FLORIDA = LocalFrame(28.05, -82.15)
NAMES = ("North", "South, two parts", "Silo")
CROPS = ("Maize", "Kale", None)
KINDS = (None, None, "obstacle")
HEIGHTS = (np.nan, np.nan, 8.5)


def shapes(scale: float = 1.0) -> list[shapely.Geometry]:
    """Return a field with a hole, one of two parts, and an obstacle, in metres."""
    holed = shapely.Polygon(
        [(0, 0), (300, 10), (290, 200), (5, 190)],
        [[(50, 50), (90, 50), (90, 95)], [(150, 50), (170, 50), (160, 90)]],
    )
    parts = shapely.MultiPolygon([shapely.box(310, 0, 400, 200), shapely.box(0, 210, 100, 300)])
    return [
        shapely.transform(one, lambda xy: xy * scale) for one in (holed, parts, shapely.box(50, 110, 60, 120))
    ]


def placed(geometries: list[shapely.Geometry], frame: LocalFrame, crs: str) -> list[shapely.Geometry]:
    """Return geometries in metres of a frame, in a coordinate system, x before y."""
    to_crs = pyproj.Transformer.from_crs("EPSG:4326", crs, always_xy=True)

    def moved(xy: np.ndarray) -> np.ndarray:
        latitude, longitude = frame.to_wgs84(xy[:, 0], xy[:, 1])
        return np.column_stack(to_crs.transform(longitude, latitude))

    return [shapely.transform(one, moved) for one in geometries]


def written(path: Path, geometries: list[shapely.Geometry], crs: str | None, **options: Any) -> Path:
    """Write features through GDAL."""
    count = len(geometries)
    pyogrio.raw.write(
        path,
        np.array([shapely.to_wkb(one) for one in geometries], object),
        [
            np.array(one[:count], kind)
            for one, kind in ((NAMES, object), (CROPS, object), (KINDS, object), (HEIGHTS, float))
        ],
        np.array(["Name", "CROP_NAME", "kind", "height"]),
        geometry_type=options.pop("geometry_type", "Unknown"),
        crs=crs,
        **options,
    )
    return path


def zipped(source: Path, target: Path) -> Path:
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for one in sorted(source.parent.glob(f"{source.stem}.*")):
            if one != target:
                archive.write(one, f"farm/{one.name}" if target.suffix == ".zip" else "doc.kml")
    return target


def same_land(
    farm: Farm, frame: LocalFrame, geometries: list[shapely.Geometry], within_m: float = 0.01
) -> None:
    """Check that a farm's polygons are the geometries, corner by corner."""
    wanted = [part for one in geometries for part in shapely.get_parts(one)]
    found = [*(one.polygon for one in farm.patches), *(one.polygon for one in farm.obstacles)]
    assert len(found) == len(wanted)
    for mine, other in zip(found, wanted, strict=True):

        def back(xy: np.ndarray) -> np.ndarray:
            return np.column_stack(frame.from_wgs84(*farm.frame.to_wgs84(xy[:, 0], xy[:, 1])))

        assert shapely.hausdorff_distance(shapely.transform(mine, back), other) < within_m
        assert len(mine.interiors) == len(other.interiors)


PLACES = {
    "EPSG:32617": FLORIDA,
    "EPSG:3857": FLORIDA,
    "EPSG:4326": FLORIDA,
    "EPSG:26917": FLORIDA,  # NAD83
    "EPSG:32723": LocalFrame(-22.9, -47.06),  # a zone of the south
    "EPSG:2193": LocalFrame(-43.6, 172.4),  # New Zealand's grid, whose axes are north, east
    "EPSG:2154": LocalFrame(48.1, 2.3),  # France
    "EPSG:27700": LocalFrame(52.2, 0.1),  # Great Britain, another datum
    "EPSG:32760": LocalFrame(-17.0, 179.998),  # across the date line
}


@pytest.mark.parametrize("crs", PLACES)
@pytest.mark.parametrize("kind", [".shp", ".gpkg", ".geojson", ".zip"])
def test_one_farm_in_every_coordinate_system(kind: str, crs: str, tmp_path: Path) -> None:
    frame = PLACES[crs]
    geometries = placed(shapes(), frame, crs)
    if kind == ".geojson":
        path = written(tmp_path / "farm.geojson", geometries, crs, driver="GeoJSON", RFC7946="NO")
    elif kind == ".gpkg":
        path = written(tmp_path / "farm.gpkg", geometries, crs)
    else:
        path = written(
            tmp_path / "farm.shp", geometries, crs, geometry_type="MultiPolygon", promote_to_multi=True
        )
        if kind == ".zip":
            path = zipped(path, tmp_path / "farm.zip")
    farm = load_farm(path)
    same_land(farm, frame, shapes())
    assert farm.name == "farm"
    assert [(one.name, one.crop, one.owner) for one in farm.patches] == [
        ("North", "maize", "owner"),
        ("South, two parts 1", "kale", "owner"),
        ("South, two parts 2", "kale", "owner"),
    ]
    assert [(one.name, one.height_m) for one in farm.obstacles] == [("Silo", 8.5)]
    inexact = [one for one in farm.notes if "is converted to WGS 84 with an error of up to" in one]
    assert bool(inexact) == (crs in ("EPSG:27700", "EPSG:26917")), farm.notes


@pytest.mark.parametrize("kind", [".shp", ".gpkg", ".kml"])
def test_names_in_capitals(kind: str, tmp_path: Path) -> None:
    options = {"driver": "LIBKML"} if kind == ".kml" else {}
    crs = "EPSG:4326" if kind == ".kml" else "EPSG:32617"
    written(tmp_path / f"farm{kind}", placed(shapes()[:1], FLORIDA, crs), crs, **options)
    for one in list(tmp_path.iterdir()):
        one.rename(tmp_path / one.name.upper())
    same_land(load_farm(tmp_path / f"FARM{kind.upper()}"), FLORIDA, shapes()[:1])


def test_layers_of_a_geopackage(tmp_path: Path) -> None:
    path = tmp_path / "farm.gpkg"
    field, parts, silo = placed(shapes(), FLORIDA, "EPSG:32617")
    written(path, [field], "EPSG:32617", layer="fields 2026")
    written(path, [parts], "EPSG:32617", layer="fields|old", append=True)
    written(path, [silo], "EPSG:32617", layer="No-fly zones", append=True)
    home, other = (shapely.Point(*field.exterior.coords[k]) for k in (0, 1))
    written(path, [home], "EPSG:32617", layer="home", append=True)
    written(path, [other, other], "EPSG:32617", layer="samples", append=True)
    farm = load_farm(path)
    assert [one.name for one in farm.patches] == ["North", "North 1", "North 2"]
    assert [one.height_m for one in farm.obstacles] == [None]
    assert farm.home_m == pytest.approx(
        farm.frame.from_wgs84(FLORIDA.latitude_deg, FLORIDA.longitude_deg), abs=0.01
    )
    why = "points that are neither home nor rally"
    assert farm.notes == (f"layer 'samples', 2 features left out ({why}): North, South, two parts",)
    assert len(load_farm(f"{path}|layername=fields 2026").patches) == 1
    assert len(load_farm(f"{path}|fields 2026").patches) == 1
    with pytest.raises(FarmError, match="there is no layer 'field'; its layers are 'fields 2026', "):
        load_farm(f"{path}|field")
    with pytest.raises(FarmError, match="GeoJSON has no layers"):
        load_farm(f"{tmp_path}/farm.geojson|x")
    assert sorted(one.name for one in tmp_path.iterdir()) == ["farm.gpkg"]


GOOGLE_EARTH = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2">
<Document><name>My farm.kml</name><Style id="s"><PolyStyle><color>7f00ff00</color></PolyStyle></Style>
<Schema name="F" id="F"><SimpleField type="string" name="Crop"/></Schema>
<Folder><name>Farm</name><open>1</open>
 <Folder><name>Fields</name>
 <Placemark><name>Lower &amp; upper</name><styleUrl>#s</styleUrl>
  <ExtendedData><SchemaData schemaUrl="#F"><SimpleData name="Crop">Sweet Potato</SimpleData></SchemaData>
  </ExtendedData>
  <Polygon><tessellate>1</tessellate><altitudeMode>relativeToGround</altitudeMode>
  <outerBoundaryIs><LinearRing>
  <coordinates>-82.150,28.050,12 -82.149,28.050,12 -82.149,28.051,9 -82.150,28.051,9 {last}</coordinates>
  </LinearRing></outerBoundaryIs></Polygon></Placemark>
 <Placemark><name>walked</name><ExtendedData><Data name="crop"><value>kale</value></Data></ExtendedData>
  <LineString><coordinates>-82.148,28.05,0 -82.147,28.05,0 -82.147,28.051,0 -82.148,28.05001,0</coordinates>
  </LineString></Placemark>
 <Placemark><name>road</name>
 <LineString><coordinates>-82.148,28.05,0 -82.14,28.05,0</coordinates></LineString></Placemark></Folder>
 <Folder><name>Obstacles</name><Placemark><name>mast</name>
  <ExtendedData><Data name="height_m"><value>30</value></Data>
  <Data name="margin_m"><value>5</value></Data></ExtendedData>
  <Polygon><outerBoundaryIs><LinearRing><coordinates>
  -82.1495,28.0505 -82.1494,28.0505 -82.1494,28.0506 -82.1495,28.0505
  </coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark></Folder>
</Folder>
<Placemark><name>Home</name><Point><coordinates>-82.15,28.05,3</coordinates></Point></Placemark>
<Placemark><name>Rally 1</name><Point><coordinates>-82.149,28.05,3</coordinates></Point></Placemark>
</Document></kml>
"""


def test_kml_as_google_earth_writes_it(tmp_path: Path) -> None:
    path = tmp_path / "farm.kml"
    path.write_text(GOOGLE_EARTH.format(last="-82.150,28.050,12"), encoding="utf-8")
    farm = load_farm(path)
    assert [(one.name, one.crop) for one in farm.patches] == [
        ("Lower & upper", "sweet potato"),
        ("walked", "kale"),
    ]
    assert [(one.name, one.height_m, one.margin_m) for one in farm.obstacles] == [("mast", 30.0, 5.0)]
    assert farm.home_m == pytest.approx((0.0, 0.0), abs=0.01)
    assert farm.rally_m == (pytest.approx((98.35, 0.0), abs=0.05),)
    assert farm.notes == (
        "layer 'Fields', feature 2 ('walked'): a line, closed over 1.1 m",
        "layer 'Fields', 1 feature left out (lines that are open by more than 5 m): road",
    )


GPX = """<?xml version="1.0"?>
<gpx version="1.1" creator="{creator}" xmlns="http://www.topografix.com/GPX/1/1"><metadata><name>x</name></metadata>
<wpt lat="28.0500" lon="-82.1500"><ele>3</ele><name>Home</name></wpt>
<wpt lat="28.0505" lon="-82.1505"><name>Rally 2</name><sym>Flag, Blue</sym></wpt>
<wpt lat="28.0505" lon="-82.1505"><name>gate</name></wpt>
<rte><name>by hand</name>{route}</rte>
<trk><name>2026-05-01_10-00</name><extensions><osmand:activity xmlns:osmand="https://osmand.net">x</osmand:activity>
</extensions><trkseg>{first}</trkseg><trkseg>{second}</trkseg></trk></gpx>
"""


def test_an_open_ring_in_one_of_several_parts_is_named(tmp_path: Path) -> None:
    point = "<Point><coordinates>-82.15,28.05</coordinates></Point>"
    polygon = POLYGON[len("<Placemark>") : -len("</Placemark>")]
    opened = polygon.replace(" -82.15,28.05</coord", "</coord").replace(
        "-82.149,28.051", "-82.149,28.051 -82.15,28.051"
    )
    text = f"<Placemark><name>x</name><MultiGeometry>{polygon}{point}{opened}</MultiGeometry></Placemark>"
    path = tmp_path / "farm.kml"
    path.write_text(f'<kml xmlns="http://www.opengis.net/kml/2.2"><Document>{text}</Document></kml>')
    farm = load_farm(path)
    assert "feature 1 ('x'), part 2: an open ring was closed over 110.82 m" in farm.notes
    assert [one.polygon.area for one in farm.patches] == pytest.approx(
        [98.36 * 110.82 / 2, 98.36 * 110.82], rel=1e-3
    )


def test_gpx_of_garmin_and_osmand(tmp_path: Path) -> None:
    def points(kind: str, *places: tuple[float, float]) -> str:
        return "".join(
            f'<{kind} lat="{28.05 + y}" lon="{-82.15 + x}"><ele>3.1</ele><time>2026-05-01T10:00:00Z</time>'
            f"</{kind}>"
            for x, y in places
        )

    path = tmp_path / "farm.gpx"
    first, second = [(0, 0), (0.001, 0)], [(0.001, 0.001), (0, 0.001), (0, 0.00002)]
    route = points("rtept", (0.002, 0), (0.003, 0), (0.003, 0.001), (0.002, 0))
    text = GPX.format(
        creator="OsmAnd~", route=route, first=points("trkpt", *first), second=points("trkpt", *second)
    )
    path.write_text(text, encoding="utf-8")
    farm = load_farm(path, crop="maize")
    assert [(one.name, one.crop) for one in farm.patches] == [
        ("by hand", "maize"),
        ("2026-05-01_10-00", "maize"),
    ]
    assert farm.patches[1].polygon.area == pytest.approx(98.36 * 110.82, rel=1e-3)
    assert farm.home_m == pytest.approx((0.0, 0.0), abs=0.01)
    assert len(farm.rally_m) == 1
    assert farm.notes == (
        "layer 'tracks', feature 1 ('2026-05-01_10-00'): a line, closed over 2.2 m",
        "layer 'waypoints', 1 feature left out (points that are neither home nor rally): gate",
    )


@pytest.mark.filterwarnings("ignore:'crs' was not provided")
def test_shapefiles_of_other_encodings_and_without_prj(tmp_path: Path) -> None:
    path = written(
        tmp_path / "felder.shp", placed(shapes(), FLORIDA, "EPSG:32617"), "EPSG:32617",
        geometry_type="MultiPolygon", promote_to_multi=True, encoding="cp1252",
    )  # fmt: skip
    data = (tmp_path / "felder.dbf").read_bytes()
    (tmp_path / "felder.dbf").write_bytes(data.replace(b"Kale", "Rübe".encode("cp1252")))
    (tmp_path / "felder.cpg").write_text("1252")
    assert load_farm(path).patches[1].crop == "rübe"
    (tmp_path / "felder.prj").unlink()
    with pytest.raises(
        FarmError, match=r"has no coordinate system .* are not degrees: give it with --farm-crs"
    ):
        load_farm(path)
    same_land(load_farm(path, crs="EPSG:32617"), FLORIDA, shapes())
    with pytest.raises(FarmError, match="'utm 17' is not a coordinate system"):
        load_farm(path, crs="utm 17")
    undefined = written(tmp_path / "u.gpkg", placed(shapes(), FLORIDA, "EPSG:32617"), None)
    with closing(sqlite3.connect(undefined)) as base:
        base.execute("UPDATE gpkg_geometry_columns SET srs_id = -1")
        base.commit()
    with pytest.raises(FarmError, match="has no coordinate system"):
        load_farm(undefined)
    same_land(load_farm(undefined, crs="EPSG:32617"), FLORIDA, shapes())
    degrees = written(
        tmp_path / "d.shp", placed(shapes(), FLORIDA, "EPSG:4326"), None,
        geometry_type="MultiPolygon", promote_to_multi=True,
    )  # fmt: skip
    farm = load_farm(degrees)
    same_land(farm, FLORIDA, shapes())
    assert farm.notes == ("no coordinate system is given: read as longitudes and latitudes of WGS 84",)


POLYGON = (
    "<Placemark><Polygon><outerBoundaryIs><LinearRing><coordinates>-82.15,28.05 -82.149,28.05 -82.149,28.051 "
    "-82.15,28.05</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark>"
)
VRT = (
    '<OGRVRTDataSource><OGRVRTLayer name="a"><SrcDataSource>/vsicurl/http://x/a.kml</SrcDataSource>'
    "</OGRVRTLayer></OGRVRTDataSource>"
)
BOMB = '<!DOCTYPE k [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]><kml><name>&b;</name></kml>'


def test_kmz_is_read_from_its_main_kml_and_names_the_others(tmp_path: Path) -> None:
    path = tmp_path / "a.kmz"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a.kml", "<kml/>")
        archive.writestr("doc.kml", f"<kml><Document>{POLYGON}</Document></kml>")
    assert "read from doc.kml; left out: a.kml" in load_farm(path).notes


@pytest.mark.parametrize(
    ("name", "content", "text"),
    [
        ("a.kml", b"", "is not XML (line 1: no element found)"),
        ("a.kml", b'<?xml version="1.0" encoding="ZTF-8"?><kml/>', "is not XML (unknown encoding: ZTF-8)"),
        ("a.kml", b"<gpx/>", "is no KML: it begins with <gpx>"),
        ("a.kml", BOMB.encode(), "document type with entities"),
        ("a.kml", b"<kml>" + b"<Folder>" * 200, "is nested too deeply"),
        ("a.kml", b"<kml><NetworkLink/></kml>", "has a NetworkLink"),
        ("a.kml", b'<kml xmlns="http://www.opengis.net/kml/2.2"><Document/></kml>', "has no "),
        ("a.kml", f"<kml><Document>{POLYGON}{POLYGON[:-30]}".encode(), "is not XML"),
        ("a.gpx", b'<gpx version="1.1" creator="x"/>', "holds no "),
        ("a.gpkg", VRT.encode(), "is no GeoPackage"),
        ("a.gpkg", b"SQLite format 3\0" + b"\xff" * 3000, "cannot be read: "),
        ("a.shp", VRT.encode(), "is no Shapefile"),
        ("a.shp", b"\0\0\x27\x0a" + b"\0" * 200, "its .shx is missing"),
        ("a.zip", b"PK no", "cannot be unpacked"),
        ("a.kmz", b"<kml/>", "is no archive"),
        ("a.kmz", {"x.txt": b""}, "holds 0 files .kml"),
        ("a.kmz", {"doc.kml": BOMB.encode()}, "document type with entities"),
        ("a.kmz", {"doc.kml": b" " * (33 * 2**20)}, "unpacks to more than 32 MiB"),
        ("a.kmz", {f"{k}.txt": b"" for k in range(1001)}, "holds 1001 files, more than 1000"),
        ("a.zip", {"a.shp": b"", "b.shp": b""}, "holds 2 files .shp (a.shp, b.shp); give an archive with"),
        ("a.zip", {"../a.shp": VRT.encode(), "../a.shx": b""}, "is no Shapefile"),
    ],
)
def test_hostile_and_broken_files(name: str, content: Any, text: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else archive_of(content))
    with pytest.raises(FarmError) as caught:
        load_farm(path)
    message = str(caught.value)
    assert text in message
    assert message.startswith(f"farm file {path}: ")
    assert "\n" not in message and len(message) < 500
    assert not list(tmp_path.parent.glob("a.sh*"))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a farm in several formats."""
    folder = tmp_path_factory.mktemp("whole")
    for kind, crs, options in (
        (".shp", "EPSG:32617", {"geometry_type": "MultiPolygon", "promote_to_multi": True}),
        (".gpkg", "EPSG:32617", {}),
        (".kml", "EPSG:4326", {"driver": "LIBKML"}),
    ):
        written(folder / f"f{kind}", placed(shapes(), FLORIDA, crs), crs, **options)
    zipped(folder / "f.shp", folder / "f.zip")
    return folder


@given(data=st.data())
@sweep(few=20, many=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damaged_files_load_or_are_refused_in_one_line(
    data: st.DataObject, whole: Path, tmp_path: Path
) -> None:
    for one in whole.iterdir():
        (tmp_path / one.name).write_bytes(one.read_bytes())
    name = data.draw(st.sampled_from(sorted(one.name for one in whole.iterdir())))
    content = bytearray((whole / name).read_bytes())
    for _ in range(data.draw(st.integers(1, 9))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    (tmp_path / name).write_bytes(content)
    main = name if name[-4:] in ("gpkg", ".kml", ".zip") else "f.shp"
    try:
        load_farm(tmp_path / main, crop="maize", repair=data.draw(st.booleans()))
    except FarmError as error:
        assert "\n" not in str(error)
    assert {one.name for one in tmp_path.iterdir()} == {one.name for one in whole.iterdir()}


def test_views_and_too_many_features(tmp_path: Path) -> None:
    path = written(tmp_path / "f.gpkg", placed(shapes(), FLORIDA, "EPSG:32617"), "EPSG:32617")
    with closing(sqlite3.connect(path)) as base:
        base.execute("ALTER TABLE f RENAME TO g")
        base.execute(
            "CREATE VIEW f AS WITH RECURSIVE r(n) AS (SELECT 1 UNION ALL SELECT n FROM r) SELECT * FROM g, r"
        )
        base.execute("UPDATE gpkg_contents SET table_name = 'f'")
        base.commit()
    with pytest.raises(FarmError, match="has no layer with features"):
        load_farm(path)
    many = [shapely.Point(k, k) for k in range(MAX_FEATURES + 1)]
    pyogrio.raw.write(
        tmp_path / "m.gpkg", shapely.to_wkb(many).astype(object), [], np.array([]), geometry_type="Point",
        crs="EPSG:32617",
    )  # fmt: skip
    with pytest.raises(FarmError, match="more than 10000 features"):
        load_farm(tmp_path / "m.gpkg")


@pytest.mark.parametrize(
    "name", ["/vsicurl/http://127.0.0.1:9/a.kml", "http://127.0.0.1:9/a.gpkg", "WFS:x.shp", "a\0.kmz"]
)
def test_addresses_are_no_files(name: str) -> None:
    with pytest.raises(FarmError, match="cannot be read"):
        load_farm(name)


def test_without_gdal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "pyogrio", None)
    monkeypatch.setitem(sys.modules, "pyogrio.raw", None)
    with pytest.raises(FarmError, match=r'\.kml files need pyogrio; .* pip install "wbf-mission\[gis\]"'):
        load_farm(tmp_path / "a.kml")


THEIRS = """
from geo.features import Document, Entry

def read(path, layer, crs):
    corners = [[10.0, 50.0], [10.001, 50.0], [10.001, 50.001], [10.0, 50.0]]
    geometry = {"type": "Polygon", "coordinates": [corners]}
    return Document({}, [Entry(1, {"name": f"{layer}, {crs}"}, geometry)])
"""


def test_packages_add_farm_formats_and_geojson_stays_the_cores(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "their_fields.py").write_text(THEIRS)
    entries = "".join(f"{name} = their_fields:read\n" for name in ("fields", "json"))
    install(tmp_path, "their-fields", f"[wbf_mission.farm_formats]\n{entries}")
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("a.fields", "b.json"):
        (tmp_path / name).write_text("[]")
    farm = get_farm(f"{tmp_path / 'a.FIELDS'}|north", crs="EPSG:32632")
    assert [patch.name for patch in farm.patches] == ["north, EPSG:32632"]
    with pytest.raises(FarmError, match=r"unknown farm 'c\.field': .*\.geojson, .*\.poly, \.fields\)"):
        get_farm("c.field")
    with pytest.raises(FarmError, match=r"b\.json: "):
        get_farm(tmp_path / "b.json")
