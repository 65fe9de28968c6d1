"""Files of other programs: paths that were drawn or recorded, odd ones, broken ones, hostile ones."""

import io
import json
import zipfile

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from mission.errors import MissionFileError
from mission.files import open_mission
from mission.model import Command, Frame
from wbf_mission.addons.formats import geojson as geojson_file

HEAD = '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2"><Document>'
TAIL = "</Document></kml>"


def line(name="Path", mode="relativeToGround", coordinates="-82.15,28.05,10 -82.151,28.051,20"):
    altitude = f"<altitudeMode>{mode}</altitudeMode>" if mode else ""
    shape = f"<LineString>{altitude}<coordinates>{coordinates}</coordinates></LineString>"
    return f"<Placemark><name>{name}</name>{shape}</Placemark>\n"


def kml(*marks):
    return HEAD + "".join(marks) + TAIL


def gpx(body):
    return f'<gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1">{body}</gpx>'


def points(tag, *places, ele="<ele>30</ele>"):
    return "".join(f'<{tag} lat="{lat}" lon="{lon}">{ele}</{tag}>\n' for lat, lon in places)


def geojson(*geometries, **properties):
    features = [{"type": "Feature", "properties": properties, "geometry": one} for one in geometries]
    return json.dumps({"type": "FeatureCollection", "features": features})


LINE = {"type": "LineString", "coordinates": [[-82.15, 28.05], [-82.151, 28.051]]}
AREA = {
    "type": "Polygon",
    "coordinates": [[[-82.15, 28.05], [-82.151, 28.051], [-82.15, 28.051], [-82.15, 28.05]]],
}
PLACES = ((28.05, -82.15), (28.051, -82.151))
NESTED = '{"type": "GeometryCollection", "geometries": ['
SEGMENT = f"<trkseg>{points('trkpt', *PLACES)}</trkseg>"


@pytest.fixture
def made(tmp_path):
    """Read a file of this ending and content, and return the mission and what was said of it."""

    def read(suffix, content, **how):
        path = tmp_path / f"mine{suffix}"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return open_mission(path, **how)

    return read


@pytest.fixture
def refusal(made):
    def refused(suffix, content, **how):
        with pytest.raises(MissionFileError) as caught:
            made(suffix, content, **how)
        text = str(caught.value)
        assert text.isprintable()
        assert len(text) <= 600
        return text

    return refused


def as_text(mission):
    return [(item.command, item.frame, item.param4, item.x, item.y, item.z) for item in mission.items]


def waypoints(frame, *altitudes_m):
    pairs = zip(PLACES, altitudes_m, strict=True)
    return [(Command.NAV_WAYPOINT, frame, None, *place, altitude_m) for place, altitude_m in pairs]


TRACK = """<Placemark
xmlns:gx="http://www.google.com/kml/ext/2.2"><gx:Track><altitudeMode>absolute</altitudeMode>
<when>2026-01-01T00:00:00Z</when><gx:coord>-82.15 28.05 40</gx:coord>
<when>2026-01-01T00:00:01Z</when><gx:coord>-82.151 28.051 41</gx:coord></gx:Track></Placemark>"""
MULTI_TRACK = TRACK.replace(
    "<gx:Track><altitudeMode>absolute</altitudeMode>",
    "<gx:MultiTrack><altitudeMode>absolute</altitudeMode><gx:Track>",
).replace("</gx:Track>", "</gx:Track></gx:MultiTrack>")


@pytest.mark.parametrize(
    ("suffix", "content", "frame", "altitudes_m"),
    [
        (".kml", kml(line()), Frame.GLOBAL_RELATIVE_ALT, (10, 20)),
        (".kml", kml(line(mode="absolute")), Frame.GLOBAL, (10, 20)),
        (".kml", kml(line(coordinates="\n -82.15, 28.05, 10\n\t-82.151 ,28.051,20 \n")), 3, (10, 20)),
        (".kml", kml(MULTI_TRACK), Frame.GLOBAL, (40, 41)),
        (".gpx", gpx(f"<rte><name>R</name>{points('rtept', *PLACES)}</rte>"), Frame.GLOBAL, (30, 30)),
        (".gpx", gpx(f"<trk><trkseg>{points('trkpt', *PLACES)}</trkseg></trk>"), Frame.GLOBAL, (30, 30)),
        (".gpx", gpx(f"<trk><trkseg/></trk>{points('wpt', *PLACES)}"), Frame.GLOBAL, (30, 30)),
        (".csv", "\ufeffName;Längengrad;lng;Latitude (deg);AMSL [m]\r\na;1;-82,15;28,05;10,5\r\n"
                 "b;1;-82,151;28,051;20\r\n", 0, (10.5, 20)),
        (".csv", "# mine\nAltitude(m)\tlongitude\tlat\n10\t-82.15\t28.05\n\n20\t-82.151\t28.051\n", 3,
         (10, 20)),
        (".csv", "lat,lon,height\n28.05,-82.15,10\n28.051,-82.151,20\n".encode("utf-16"), 3, (10, 20)),
        (".csv", '"lat","lon","elevation"\n"28.05","-82.15","10"\n28.051,-82.151,20', 0, (10, 20)),
    ],
)  # fmt: skip
def test_paths_of_others_are_waypoints(made, suffix, content, frame, altitudes_m):
    mission, (note, *_) = made(suffix, content)
    assert as_text(mission) == waypoints(frame, *altitudes_m)
    assert note.startswith("the 2 points of ")
    above = "above home" if frame == Frame.GLOBAL_RELATIVE_ALT else "above sea level"
    assert note.endswith(f" are waypoints, altitudes {above}; no take-off, landing, speed or home is added")
    assert (mission.home, mission.fence, mission.rally) == (None, (), ())


@pytest.mark.parametrize(
    ("suffix", "content", "reason"),
    [
        (".kml", kml(line(mode="clampToGround")), "altitudeMode is clampToGround"),
        (".kml", kml(line(coordinates="-82.15,28.05 -82.151,28.051")), "Path, line 2, point 1: no altitude"),
        (
            ".gpx",
            gpx(f"<rte>{points('rtept', *PLACES, ele='')}</rte>"),
            "line 1, rtept: no altitude to fly at",
        ),
        (".geojson", geojson(LINE), "above the ellipsoid, which no autopilot uses"),
        (
            ".geojson",
            geojson({"type": "MultiPoint", "coordinates": LINE["coordinates"]}),
            "above the ellipsoid",
        ),
        (".csv", "y,x\n28.05,-82.15\n28.051,-82.151\n", "there is no column of altitudes"),
        (".csv", "lat,lon,alt\n28.05,-82.15,\n28.051,-82.151,NaN\n", "line 2: no altitude to fly at"),
    ],
)
def test_a_path_without_altitudes_needs_one(made, refusal, suffix, content, reason):
    assert reason in (text := refusal(suffix, content))
    assert "give an altitude above home (convert --altitude METRES)" in text
    mission, _ = made(suffix, content, altitude_m=25.0)
    assert as_text(mission) == waypoints(Frame.GLOBAL_RELATIVE_ALT, 25.0, 25.0)


@pytest.mark.parametrize(
    ("suffix", "content", "names"),
    [
        (".kml", kml(line("north"), line("south")), ("north", "south")),
        (".gpx", gpx(f"<rte><name>north</name>{points('rtept', *PLACES)}</rte>"
                     f"<trk><name>south</name><trkseg>{points('trkpt', *PLACES)}</trkseg></trk>"),
         ("north", "south")),
        (".gpx", gpx("<trk><name>T</name>" + SEGMENT * 2 + "</trk>"),
         ("T, segment 1", "T, segment 2")),
        (".kml", kml("<Placemark><name>M</name><MultiGeometry>"
                     + line().partition("</name>")[2].replace("</Placemark>", "") * 2
                     + "</MultiGeometry></Placemark>"), ("M, part 1", "M, part 2")),
    ],
)  # fmt: skip
def test_one_of_several_paths_is_chosen(made, refusal, suffix, content, names):
    text = refusal(suffix, content)
    assert f"2 paths: {names[0]!r}, {names[1]!r}; choose one (convert --path NAME)" in text
    assert len(made(suffix, content, drawn_path=names[1])[0].items) == 2
    assert "'east' is not there; the paths are" in refusal(suffix, content, drawn_path="east")


def test_paths_of_one_name_and_very_many_are_refused(refusal):
    twice = kml(line("a"), line("a"))
    assert "the path 'a' is there more than once" in refusal(".kml", twice, drawn_path="a")
    text = refusal(".kml", kml(*(line(f"path {k}") for k in range(500))))
    assert "500 paths" in text
    assert "and 492 more" in text


def test_areas_are_sent_to_the_planner(made, refusal):
    area = '<Placemark><Polygon><outerBoundaryIs><LinearRing><coordinates>1,2 2,2 2,3 1,2</coordinates>' \
        "</LinearRing></outerBoundaryIs></Polygon></Placemark>"  # fmt: skip
    for text in (refusal(".kml", kml(area)), refusal(".geojson", geojson(AREA))):
        assert "1 areas (polygons), but no path" in text
        assert "wbf-mission plan --farm" in text
    assert "this is a farm file" in refusal(".geojson", geojson(AREA, crop="tomato", owner="me"))
    _, notes = made(".kml", kml(area, line()))
    assert notes[1] == "1 polygons are left out"


def test_a_long_track_is_taken_up_to_what_mavlink_numbers(made, refusal):
    assert len(made(".csv", "lat,lon,alt\n" + "28,-82.15,10\n" * 5000)[0].items) == 5000
    table = "lat,lon,alt\n" + "28,-82.15,10\n" * 65_536
    assert "65536 points, but MAVLink allows 65535 items; drop points" in refusal(".csv", table)


@pytest.mark.parametrize(
    ("suffix", "content", "part"),
    [
        (".kml", kml(line()).replace("UTF-8", "klingon"), "line 1: "),
        (".kml", kml(line("\xe9")).encode("latin-1"), "line 2: it is not XML (not well-formed"),
        (".kml", kml(line(coordinates="28.05,-182.15,10 1,2,3")), "latitude -182.15 is outside -90..90; the"),
        (".kml", kml(line(coordinates="1,2,3,4")), "line 2, point 1: '1,2,3,4' is not"),
        (".kml", kml(line(coordinates="1,1_0,3")), "'1,1_0,3' is not"),
        (".kml", kml(line(coordinates="1,2,1e9")), "altitude 1000000000.0"),
        (".kml", kml(line(coordinates="")), "line 2: the LineString has no coordinates"),
        (".kml", "", "an empty file"),
        (".kml", "<kml>" * 3000, "more than 100 nested elements"),
        (".kml", "<x><kml/></x>", "this is an XML file, not a KML file"),
        (".gpx", gpx("<rte><rtept lat='28.05'/></rte>"), "line 1, rtept: lon is ''; give a number"),
        (".gpx", gpx("<rte><rtept lat='9' lon='1'><ele>high</ele></rtept></rte>"), "ele is 'high'"),
        (".gpx", gpx(""), "the file has no path"),
        (".geojson", '{"type": "FeatureCollection", "features": [', "line 1: it ends in the middle"),
        (".geojson", geojson({"type": "LineString", "coordinates": [[1, 2], [1]]}),
         "feature 1, point 2: [1] is not"),
        (".geojson", geojson({"type": "LineString", "coordinates": None}),
         "feature 1: the geometry has no coordinates"),
        (".geojson", geojson(LINE).replace("-82.15,", "NaN,"), "NaN is not a number in JSON"),
        (".geojson", '{"type": "FeatureCollection", "features": [{"properties": []}]}',
         "feature 1, properties"),
        (".geojson", '{"type": "Feature", "geometry": ' + NESTED * 50 + "{}" + "]}" * 50 + "}",
         "a geometry is"),
        (".geojson", geojson(LINE)[:-1] + ', "crs": {"properties": {"name": "EPSG:3857"}}}',
         "crs is 'EPSG:3857'"),
        (".csv", "28.05,-82.15,10\n28.051,-82.151,10\n", "line 1: no columns of latitude and longitude"),
        (".csv", "lat,lon,alt\n28.05,-82.15,ten\n", "line 2: alt is 'ten'; give a number"),
        (".csv", "lat,lon,alt\n\n28,05,-82,15,10\n", "line 3: 5 columns, but the header names 3"),
        (".csv", "lat,lon,altitude(ft)\n1,2,3\n", "column 'altitude(ft)' is not in metres or degrees"),
        (".csv", "lat,lon,alt\n1,2,3,\n1,2,3,,4\n", "line 3: 5 columns, but the header names 3"),
        (".csv", 'lat,lon,alt\n1,2,"3\n', "line 2: unexpected end of data"),
        (".csv", "lat,lon,alt\n" + "1" * 200_000 + ",2,3\n", "line 2"),
        (".csv", b"lat,lon,alt\n1,2,\xff\n", "line 2: this is not UTF-8 text"),
        (".csv", "lat,lon,alt\n91,2,3\n", "the table, line 2: mission item (command 16): latitude 91.0"),
        (".csv", "lat,lon,alt,command\n1,2,3,16\n", "line 2: frame is missing; give a whole number"),
        (".csv", "lat,lon,alt,command,frame\n1,2,3,x,3\n", "line 2: command is 'x'"),
        (".csv", "role,command,frame\nitem,16,3\n", "no columns of latitude"),
        (".csv", "role,lat,lon,command,frame\nitem,,,16,3\n", "line 2: latitude of command 16 is missing"),
        (".csv", "role,lat,lon,command\ngoal,1,2,16\n", "line 2: role 'goal' is not one of"),
        (".csv", "role,lat,lon,command,frame,autocontinue\nitem,1,2,16,3,maybe\n",
         "line 2: autocontinue is 'maybe'"),
        (".csv", "role,lat,lon,command,frame,param1\nitem,,,177,2,9\n",
         "line 2: DO_JUMP to index 9, which does"),
        (".csv", "role,lat,lon,command,frame,index\nitem,1,2,16,3,1e999\n", "line 2: index is 'inf'; give"),
        (".gpx", gpx("<extensions><record role='item' command='177' index='inf'/></extensions>"),
         "index is 'inf'; give a finite number"),
        (".geojson", geojson(None, role="item", index=10**400), "feature 1: index is '1000000000000000000"),
        (".geojson", geojson({"type": "LineString", "coordinates": [[10**400, 2], [1, 2]]}),
         "feature 1, point 1: [1000000000000000"),
        (".csv", "role,lat,lon,command\nhome,,,\n", "line 2: home does not have exactly one point"),
        (".csv", "role,lat,lon,command,version\nmission,,,,2\n", "line 2: version 2 is unknown"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_told_in_a_line_with_its_place(refusal, suffix, content, part):
    assert part in refusal(suffix, content)


@pytest.mark.parametrize("name", ["altitudemode", "AltitudeMode"])
def test_altitudes_of_litchi_are_read_above_home_only(made, refusal, name):
    table = f"latitude,longitude,altitude(m),{name}\n28.05,-82.15,10,0\n28.051,-82.151,20,%s\n"
    assert [item.z for item in made(".csv", table % "0")[0].items] == [10.0, 20.0]
    assert "line 3: altitudemode is 1, not 0 (above home); give altitudes" in refusal(".csv", table % "1")
    assert "line 3: altitudemode is 'ground'; give a number" in refusal(".csv", table % "ground")


LAUGHS = '<!DOCTYPE kml [<!ENTITY a "ha">%s]>\n<kml><Document>&z;</Document></kml>'
HAS = "".join(f'<!ENTITY {chr(97 + k)} "{10 * ("&" + chr(96 + k) + ";")}">' for k in range(1, 26))
FILE = '<!DOCTYPE kml [<!ENTITY z SYSTEM "file:///etc/passwd">]>\n<kml><Document>&z;</Document></kml>'


@pytest.mark.parametrize("content", [LAUGHS % HAS, FILE, FILE.replace("ENTITY z", "ENTITY % z")])
@pytest.mark.parametrize("suffix", [".kml", ".gpx"])
def test_entities_are_refused(refusal, suffix, content):
    assert "line 1: the entity" in refusal(suffix, content.replace("kml", suffix[1:]))


def zipped(members, compression=zipfile.ZIP_DEFLATED):
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", compression) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return made.getvalue()


@pytest.mark.parametrize(
    ("main", "others"),
    [("doc.kml", ["../../evil.KML", "a.kml"]), ("b.kml", ["a/doc.kml"]), ("../../evil.KML", ["x/z.kml"])],
)
def test_kmz_is_read_from_its_main_kml_and_names_the_others(made, tmp_path, main, others):
    files = {"images/a.png": b"x", **dict.fromkeys(others, kml()), main: kml(line())}
    content = zipped(dict(reversed(files.items())) if main.startswith("..") else files)
    mission, notes = made(".kmz", content)
    assert len(mission.items) == 2 and [one.name for one in tmp_path.iterdir()] == ["mine.kmz"]
    assert notes[0].startswith(f"read from {main}; ") and all(other in notes[0] for other in others)


@pytest.mark.parametrize(
    ("content", "part"),
    [
        (zipped({"a.txt": "x"}), "the archive has no .kml file"),
        (zipped({"doc.kml": kml(line())})[:-40], "the archive cannot be unpacked"),
        (zipped({"doc.kml": kml(line())}).replace(b"doc.kml", b"doc.kmx", 1), "cannot be unpacked"),
        (zipped({"doc.kml": "<kml"}), "doc.kml: line 1: it is not XML"),
        (zipped({f"{k}.kml": "" for k in range(1001)}), "more than 1000 files"),
        (zipped({"doc.kml": bytes(65 * 2**20)}), "the archive unpacks to more than 64 MiB"),
        (zipped({"wpmz/template.kml": kml(), "wpmz/waylines.wpml": kml()}), "this is a DJI wayline file"),
        (kml(line()).encode(), "this is a KML file, not a KMZ archive; rename it to end in .kml"),
    ],
)
def test_archives_that_are_no_kmz_are_refused(refusal, content, part):
    assert part in refusal(".kmz", content)


def test_a_table_of_commands_needs_neither_order_nor_all_columns(made):
    table = (
        "command;frame;lat;lon;altitude_m;param1;index\n20;2;;;;;1\n22;3;28,05;-82,15;10;;0\n16;3;1;2;3;5;2\n"
    )
    mission, notes = made(".csv", table)
    assert notes == []
    assert [(item.command, item.param1, item.param2, item.z) for item in mission.items] == [
        (22, None, 0.0, 10.0),
        (20, None, 0.0, 0.0),
        (16, 5.0, 0.0, 3.0),
    ]


GEOMETRY = '{"type": "LineString", "coordinates": [[10, 50], [10.001, 50], [10.001, 50.001]]}'


@given(st.sampled_from(["\n", "\r\n"]), st.booleans(), st.booleans())
@example("\n", True, True)
def test_lines_of_geojson_one_after_the_other(end, separated, bom):
    feature = f'{{"type": "Feature", "properties": {{"name": "two"}}, "geometry": {GEOMETRY}}}'
    text = "".join(f"{chr(30) * separated}{shape}{end}" for shape in (GEOMETRY, feature))
    drawing = geojson_file.loads((chr(0xFEFF) * bom + text).encode())
    assert [path.name for path in drawing.paths] == ["feature 1", "two"]
    assert [len(path.points) for path in drawing.paths] == [3, 3]
    with pytest.raises(MissionFileError, match="line 3: it ends in the middle"):
        geojson_file.loads(f"{GEOMETRY}\n{GEOMETRY}\n{GEOMETRY[:-3]}".encode())
