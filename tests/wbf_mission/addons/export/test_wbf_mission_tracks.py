"""Tracks of a run in GPX, KML, GeoJSON and CSV, as GDAL and our own readers of missions read them."""

import csv
import json
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np
import pyogrio
import pytest
import shapely
from exported_runs import fleet_run
from mcap.reader import make_reader
from pyogrio.raw import read

from geo import load_farm
from mission.files import open_mission
from mission.link.codec.dialect import mavlink as m
from mission.link.tlog import TlogWriter
from sim_vehicle.execution.state import EPOCH_UNIX_S
from wbf_mission import Scenario, fly
from wbf_mission.addons.export.formats import export
from wbf_mission.cli.app import main
from wbf_mission.results.result import Result, load_result


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of two vehicles over two days, with its log."""
    options = ("--planner", "lawnmower", "--budget", "60s", "--estimator", "point")
    return fleet_run(tmp_path_factory.mktemp("runs") / "mine", *options)


@pytest.fixture(scope="module")
def result(folder: Path) -> Result:
    return load_result(folder)


def exported(folder: Path, result: Result, tmp_path: Path, to: str) -> Path:
    (path,) = export(result, tmp_path / f"run.{to}", to, log=folder / "flight.tlog")
    return path


def test_gpx_has_tracks_with_times_and_heights(folder: Path, result: Result, tmp_path: Path) -> None:
    path = exported(folder, result, tmp_path, "gpx")
    assert {"waypoints", "routes", "tracks", "route_points", "track_points"} == {
        name for name, _ in pyogrio.list_layers(path)
    }
    meta, _, geometry, columns = read(path, layer="track_points")
    points = dict(zip(meta["fields"], columns, strict=True))
    assert len(geometry) == sum(len(one.track.time_s) for one in result.flights)
    first = result.flights[0].track
    places = shapely.from_wkb(geometry[: len(first.time_s)])
    np.testing.assert_allclose(shapely.get_y(places), first.latitude_deg, atol=2e-8)
    np.testing.assert_allclose(shapely.get_x(places), first.longitude_deg, atol=2e-8)
    heights = points["ele"][: len(first.time_s)] - result.farm.frame.altitude_m
    np.testing.assert_allclose(heights, first.altitude_m, atol=2e-3)
    took = np.array(points["time"][: len(first.time_s)], "datetime64[ms]")
    expected = np.datetime64(int(EPOCH_UNIX_S), "s") + np.round(1e3 * first.time_s).astype("timedelta64[ms]")
    assert (took == expected).all()
    meta, _, geometry, columns = read(path, layer="tracks")
    names = columns[list(meta["fields"]).index("name")]
    assert list(names)[:2] == ["day 6, flight 1, vehicle 1 (quad)", "day 6, flight 1, vehicle 2 (quad)"]
    assert len(names) == len(result.flights) == 4
    # A ground station can fly again what was flown.
    mission, _ = open_mission(path, altitude_m=10.0, drawn_path=names[0])
    assert len(mission.items) > 10


def test_kml_has_tracks_that_google_earth_plays(folder: Path, result: Result, tmp_path: Path) -> None:
    path = exported(folder, result, tmp_path, "kml")
    assert [name for name, _ in pyogrio.list_layers(path)] == ["miniberry-10", "Planned", "Flown"]
    _, _, geometry, _ = read(path, layer="Flown")
    tracks = shapely.from_wkb(geometry)
    assert len(tracks) == 4
    for line, flight in zip(tracks, result.flights, strict=True):
        places = shapely.get_coordinates(line, include_z=True)
        np.testing.assert_allclose(places[:, 2], flight.track.altitude_m, atol=2e-3)
        np.testing.assert_allclose(places[:, 0], flight.track.longitude_deg, atol=2e-8)
    text = path.read_text(encoding="utf-8")
    assert text.count("<gx:Track>") == 4 and text.count("<when>") == text.count("<gx:coord>")
    assert "<when>2026-06-01T12:00:00.100Z</when>" in text
    _, _, areas, _ = read(path, layer="miniberry-10")
    assert len(areas) == len(result.farm.patches)
    # Colours are written blue first: #0072b2.
    assert "<color>ffb27200</color>" in text


def test_geojson_has_farm_plan_tracks_and_readings(folder: Path, result: Result, tmp_path: Path) -> None:
    path = exported(folder, result, tmp_path, "geojson")
    document = json.loads(path.read_text(encoding="utf-8"))
    by_kind: dict[str, list[dict]] = {}
    for feature in document["features"]:
        by_kind.setdefault(feature["properties"]["kind"], []).append(feature)
    assert {kind: len(found) for kind, found in by_kind.items() if kind != "waypoint"} == {
        "patch": len(result.farm.patches),
        "track": 4,
        "reading": len(result.observations),
    }
    track = by_kind["track"][3]
    last = result.flights[3]
    assert len(track["geometry"]["coordinates"]) == len(track["properties"]["coordTimes"])
    ended = datetime.fromisoformat(track["properties"]["end"]).timestamp() - EPOCH_UNIX_S
    assert ended == pytest.approx(last.begun_s + last.track.time_s[-1], abs=1e-3)
    assert track["properties"]["outcome"] == "completed"
    reading, seen = by_kind["reading"][-1], result.observations
    cell_m = result.farm.cell_size_m
    place = result.farm.frame.from_wgs84(*reversed(reading["geometry"]["coordinates"]))
    np.testing.assert_allclose(place, [(seen.x[-1] + 0.5) * cell_m, (seen.y[-1] + 0.5) * cell_m], atol=2e-3)
    assert reading["properties"]["soil"] == pytest.approx(float(seen.values[-1, 2]), abs=1e-6)
    assert reading["properties"]["day"] == 7
    _, _, geometry, _ = read(path)
    assert len(geometry) == len(document["features"])


@pytest.fixture(scope="module")
def fiji(tmp_path_factory: pytest.TempPathFactory) -> Result:
    """A run on a farm at 180 degrees longitude."""
    ring = [[179.9999, -17.0], [-179.9999, -17.0], [-179.9999, -16.9999], [179.9999, -16.9999]]
    area = {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}
    file = tmp_path_factory.mktemp("fiji") / "fiji.geojson"
    file.write_text(json.dumps({"type": "Feature", "properties": {"crop": "strawberry"}, "geometry": area}))
    return fly(Scenario(farm=str(file), budget="90m", estimator="point"))


def assert_cut(shape: shapely.Geometry) -> None:
    parts = [part.bounds for part in shapely.get_parts(shape)]
    assert len(parts) > 1 and all(180.0 in (-west, east) for west, _, east, _ in parts)
    assert all(east - west < 2e-4 for west, _, east, _ in parts)


def test_geojson_is_cut_at_180_degrees(fiji: Result, tmp_path: Path) -> None:
    (path,) = export(fiji, tmp_path / "run.geojson", "geojson")
    features = json.loads(path.read_text(encoding="utf-8"))["features"]
    found = {one["properties"]["kind"]: one for one in features}
    shapes = {kind: shapely.from_geojson(json.dumps(found[kind]["geometry"])) for kind in ("patch", "track")}
    assert [shape.geom_type for shape in shapes.values()] == ["MultiPolygon", "MultiLineString"]
    for shape in shapes.values():
        assert_cut(shape)
    assert "coordTimes" not in found["track"]["properties"]


def test_kml_and_maps_of_foxglove_are_cut_at_180_degrees(fiji: Result, tmp_path: Path) -> None:
    (path,) = export(fiji, tmp_path / "run.kml", "kml")
    for layer in ("fiji", "Planned"):
        _, _, geometry, _ = read(path, layer=layer)
        assert_cut(shapely.from_wkb(geometry[0]))
    path, _ = export(fiji, tmp_path / "run.mcap", "mcap")
    with path.open("rb") as stream:
        maps = make_reader(stream).iter_messages(topics=["/farm/map", "/vehicle/1/plan/map"])
        texts = [json.loads(message.data)["geojson"] for _, _, message in maps]
    shapes = [json.loads(text)["features"][0]["geometry"] for text in texts]
    assert [shape["type"] for shape in shapes] == ["MultiPolygon", "MultiLineString"]
    for shape in shapes:
        assert_cut(shapely.from_geojson(json.dumps(shape)))


def test_a_saved_farm_is_cut_at_180_degrees_and_read_back(fiji: Result, tmp_path: Path) -> None:
    first, saved = fiji.scenario.farm.name, tmp_path / "saved.geojson"
    assert main(["farm", "save", first, "--out", str(saved), "--quiet"]) == 0
    assert_cut(shapely.from_geojson(saved.read_text(encoding="utf-8")).geoms[0])
    again = load_farm(saved).grid()
    np.testing.assert_array_equal(again.crop, fiji.farm.grid().crop)
    np.testing.assert_array_equal(again.owned, fiji.farm.grid().owned)


def test_csv_has_what_the_log_told(folder: Path, result: Result, tmp_path: Path) -> None:
    with exported(folder, result, tmp_path, "csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == sum(len(one.track.time_s) for one in result.flights)
    assert {row["mode"] for row in rows} >= {"MISSION", "RTL"}
    assert 0.5 < float(rows[len(result.flights[0].track.time_s) - 1]["battery"]) < 1.0
    assert {(row["day"], row["vehicle"]) for row in rows} == {("6", "1"), ("6", "2"), ("7", "1"), ("7", "2")}


@pytest.mark.parametrize("to", ["gpx", "kml", "geojson", "csv"])
def test_hostile_names_are_text(result: Result, tmp_path: Path, to: str) -> None:
    farm = replace(result.farm, name='<b>&"\x1b[31m')
    vehicle = replace(result.flights[0].plan.vehicle, name="</name>\x00<script>")
    flights = [replace(one, plan=replace(one.plan, farm=farm, vehicle=vehicle)) for one in result.flights]
    (path,) = export(replace(result, flights=tuple(flights)), tmp_path / f"run.{to}", to)
    if to != "csv":
        assert pyogrio.list_layers(path) is not None
        assert "<script>" not in path.read_text(encoding="utf-8") or to == "geojson"


def test_the_command_writes_beside_the_folder_and_refuses_what_is_there(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", str(folder), "--to", "gpx", "--json"]) == 0
    path = folder.with_name("mine.gpx")
    assert json.loads(capsys.readouterr().out)["files"] == [str(path)]
    path.write_text("mine", encoding="utf-8")
    assert main(["export", str(folder), "--to", "gpx"]) == 2
    assert "mine.gpx: already exists; give another name (--out), or --overwrite" in capsys.readouterr().err
    assert path.read_text(encoding="utf-8") == "mine"
    assert main(["export", str(folder), "--to", "gpx", "--overwrite", "-q"]) == 0
    assert path.read_text(encoding="utf-8") != "mine"


def test_a_layout_that_is_there_is_refused_too(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    layout = tmp_path / "run.foxglove.json"
    layout.write_text("{}", encoding="utf-8")
    assert main(["export", str(folder), "--to", "mcap", "--out", str(tmp_path / "run.mcap")]) == 2
    assert "run.foxglove.json: already exists" in capsys.readouterr().err
    assert [one.name for one in tmp_path.iterdir()] == [layout.name]


def test_a_real_flight_is_shown_when_it_was_flown(result: Result, tmp_path: Path) -> None:
    log, begun_s = tmp_path / "flight.tlog", 1_790_000_000.25
    with TlogWriter(log) as writer:
        writer.write(heartbeat(), begun_s)
    (path,) = export(result, tmp_path / "run.csv", "csv", log=log)
    with path.open(encoding="utf-8", newline="") as stream:
        row = next(csv.DictReader(stream))
    first = datetime.fromisoformat(row["time"]).timestamp()
    assert first == pytest.approx(begun_s + result.flights[0].track.time_s[0], abs=1e-3)
    assert row["mode"] == "" and row["battery"] == ""


def heartbeat() -> bytes:
    frame: bytes = m.MAVLink_heartbeat_message(2, 12, 81, 0, 4, 3).pack(m.MAVLink(None, 1, 1))
    return frame


def test_what_cannot_be_exported_is_told_in_one_line(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", str(tmp_path), "--to", "gpx"]) == 2
    assert "holds no result (result.json is missing)" in capsys.readouterr().err
    assert main(["export", str(folder), "--to", "gpx", "--estimates", "3"]) == 2
    assert "--estimates has an effect only with --to mcap or rerun: leave it out" in capsys.readouterr().err
    assert main(["export", str(folder), "--to", "gpx", "--out", str(folder / "flight.tlog")]) == 2
    assert "this is an input file" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
