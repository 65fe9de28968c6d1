"""MCAP files for Foxglove: read back with another reader, each message held against the published schemas."""

import base64
import importlib
import json
import math
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
from google.protobuf import json_format
from jsonschema import Draft7Validator
from mcap.reader import make_reader

from sim_vehicle.execution.state import EPOCH_UNIX_S
from wbf_mission.addons.export import scene
from wbf_mission.addons.export.formats import export
from wbf_mission.flight import fly
from wbf_mission.results.result import Result, load_result
from wbf_mission.scenario import Scenario


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    options = {"policy": "greedy", "budget": "45s", "estimator": "adaptive-disk", "seed": 1, "fence_m": 10.0}
    flown = fly(Scenario(farm="miniberry-10", vehicles=2, days=2, **options))
    return load_result(flown.save(tmp_path_factory.mktemp("run") / "run", plots=False))


@pytest.fixture(scope="module")
def file(result: Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path, _ = export(result, tmp_path_factory.mktemp("mcap") / "run.mcap", "mcap", estimates=5)
    return path


def messages(path: Path) -> dict[str, list[tuple[int, dict]]]:
    found = defaultdict(list)
    with path.open("rb") as stream:
        for _, channel, message in make_reader(stream, validate_crcs=True).iter_messages():
            found[channel.topic].append((message.log_time, json.loads(message.data)))
    return found


def test_the_file_is_whole_indexed_and_compressed(file: Path) -> None:
    with file.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None and summary.statistics is not None
    assert summary.statistics.message_count > 1000
    assert summary.statistics.chunk_count == len(summary.chunk_indexes) > 0
    assert {one.compression for one in summary.chunk_indexes} == {"zstd"}
    assert summary.statistics.message_start_time == EPOCH_UNIX_S * 1e9
    assert {one.message_encoding for one in summary.channels.values()} == {"json"}


def published(value: object) -> object:
    """A message as protobuf's JSON has it: times as texts."""
    if isinstance(value, list):
        return [published(one) for one in value]
    if not isinstance(value, dict):
        return value
    if set(value) == {"sec", "nsec"}:
        whole = math.fsum((value["sec"], value["nsec"] / 1e9))
        return (
            f"{whole:.9f}s" if whole < 1e9 else np.datetime_as_string(np.datetime64(value["sec"], "s")) + "Z"
        )
    return {name: published(one) for name, one in value.items()}


def test_messages_are_as_their_schemas_and_foxglove_s_own_definitions_say(file: Path) -> None:
    """Of each topic and length; an unknown field, or a value of another type, is an error."""
    seen = set()
    validators: dict[str, Draft7Validator] = {}
    with file.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            assert schema is not None and schema.encoding == "jsonschema"
            if (channel.topic, len(message.data) // 100) in seen:
                continue
            seen.add((channel.topic, len(message.data) // 100))
            if schema.name not in validators:
                written = json.loads(schema.data)
                Draft7Validator.check_schema(written)
                assert written["title"] == schema.name
                validators[schema.name] = Draft7Validator(written)
            validators[schema.name].validate(json.loads(message.data))
            package, _, name = schema.name.partition(".")
            if package == "foxglove":
                kind = getattr(importlib.import_module(f"foxglove_schemas_protobuf.{name}_pb2"), name)
                json_format.ParseDict(published(json.loads(message.data)), kind())
    assert len(validators) == 10


def test_vehicles_are_where_they_were(result: Result, file: Path) -> None:
    found = messages(file)
    fixes = found["/vehicle/2/fix"]
    flights = [one for one in result.flights if one.system_id == 2]
    assert len(fixes) == len(found["/vehicle/2/state"]) == sum(len(one.track.time_s) for one in flights)
    flight = flights[-1]
    at_ns, last = fixes[-1]
    assert at_ns == round((EPOCH_UNIX_S + flight.begun_s + flight.track.time_s[-1]) * 1e9)
    assert last["latitude"] == pytest.approx(flight.track.latitude_deg[-1], abs=2e-8)
    assert last["longitude"] == pytest.approx(flight.track.longitude_deg[-1], abs=2e-8)
    assert last["altitude"] == pytest.approx(
        result.farm.frame.altitude_m + flight.track.altitude_m[-1], abs=1e-3
    )
    moved = [one for _, one in found["/tf"] if one["child_frame_id"] == "vehicle 2"]
    assert moved[-1]["translation"]["x"] == pytest.approx(flight.track.x_m[-1], abs=1e-3)
    assert moved[-1]["parent_frame_id"] == "farm"
    # What is drawn of the vehicle moves with its frame.
    ((_, body),) = found["/vehicle/2/body"]
    assert body["entities"][0]["frame_id"] == "vehicle 2"
    line = found["/vehicle/2/track/scene"][-1][1]["entities"][0]["lines"][0]
    assert line["points"][-1]["x"] == pytest.approx(flight.track.x_m[-1], abs=1e-3)


def cells_of(grid: dict) -> np.ndarray:
    """The cells of a foxglove.Grid, rows from the bottom up."""
    kinds = {1: "u1", 7: "<f4"}
    layout = np.dtype(
        {
            "names": [one["name"] for one in grid["fields"]],
            "formats": [kinds[one["type"]] for one in grid["fields"]],
            "offsets": [one["offset"] for one in grid["fields"]],
            "itemsize": grid["cell_stride"],
        }
    )
    assert grid["row_stride"] == grid["column_count"] * grid["cell_stride"]
    return np.frombuffer(base64.b64decode(grid["data"]), layout).reshape(-1, grid["column_count"])


def test_layers_hold_truth_and_estimate(result: Result, file: Path) -> None:
    found = messages(file)
    assert result.model is not None and result.truth is not None
    for k, field in enumerate(result.fields):
        mask = field.mask(result.farm.grid())
        for what, values in (
            ("truth", result.truth),
            ("estimate", result.model.value),
            ("uncertainty", result.model.uncertainty),
        ):
            grids = found[f"/layers/{field.name}/{what}"]
            assert len(grids) in ((2,) if what == "truth" else (5, 6))
            cells = cells_of(grids[-1][1]).T
            np.testing.assert_allclose(cells["value"][mask], values[k][mask], atol=1e-6)
            assert np.isnan(cells["value"][~mask]).all()
            assert (cells["alpha"][mask] == 255).all() and not cells["alpha"][~mask].any()
    size_m = grids[-1][1]["cell_size"]["x"]
    assert size_m == pytest.approx(result.farm.cell_size_m)


def test_readings_scores_texts_and_decisions_are_there(result: Result, file: Path) -> None:
    found = messages(file)
    cloud = found["/readings"][-1][1]
    last_day = result.observations[result.observations.day == result.observations.day[-1]]
    points = np.frombuffer(
        base64.b64decode(cloud["data"]),
        np.dtype([*((name, "<f4") for name in "xyztcs"), ("colour", "u1", 4)]),
    )
    assert cloud["point_stride"] == points.itemsize and len(points) == len(last_day)
    np.testing.assert_allclose(points["x"], (last_day.x + 0.5) * result.farm.cell_size_m, rtol=1e-6)
    np.testing.assert_array_equal(points["t"], last_day.values[:, 0])
    assert [one["score"] for _, one in found["/score"]] == result.history.scores
    assert set(found["/score"][0][1]["losses"]) == set(result.fields.names)
    assert len(found["/decision"]) == len(result.decisions) > 4
    said = [one["message"] for _, one in found["/log"]]
    assert {text for flight in result.flights for _, _, text in flight.texts} <= set(said)
    assert said[-1] == "completed"
    farm = json.loads(found["/farm/map"][0][1]["geojson"])
    assert len(farm["features"]) == len(result.farm.patches) + len(result.farm.obstacles) + 1
    plan = json.loads(found["/vehicle/1/plan/map"][0][1]["geojson"])
    assert [one["properties"]["name"] for one in plan["features"]] == ["plan of vehicle 1", "fence"]


def test_equal_runs_give_equal_files(result: Result, file: Path, tmp_path: Path) -> None:
    again, _ = export(result, tmp_path / "again.mcap", "mcap", estimates=5)
    assert again.read_bytes() == file.read_bytes()


def test_large_farms_are_shown_in_blocks(
    result: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scene, "LONGEST", 4)
    path, _ = export(result, tmp_path / "run.mcap", "mcap")
    assert result.model is not None
    grid = messages(path)["/layers/soil/estimate"][-1][1]
    assert grid["cell_size"]["x"] == pytest.approx(3 * result.farm.cell_size_m)
    cells, soil = cells_of(grid).T, list(result.fields.names).index("soil")
    mask = result.fields[soil].mask(result.farm.grid())
    for x, y in ((0, 0), (2, 3), (3, 1)):
        block = slice(3 * x, 3 * x + 3), slice(3 * y, 3 * y + 3)
        inside = result.model.value[soil][block][mask[block]]
        if len(inside):
            assert cells["value"][x, y] == pytest.approx(inside.mean(), abs=1e-5)
        else:
            assert math.isnan(cells["value"][x, y])


def test_nothing_is_left_of_an_export_that_is_broken_off(result: Result, tmp_path: Path) -> None:
    def break_off(what: str, done: float, total: float) -> None:
        if what == "estimates" and done > 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export(result, tmp_path / "run.mcap", "mcap", estimates=20, progress=break_off)
    assert not list(tmp_path.iterdir())
