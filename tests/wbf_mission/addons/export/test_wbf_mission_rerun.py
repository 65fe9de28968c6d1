"""Recordings of Rerun: verified by its own program, and read back."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exported_runs import fleet_run

from sim_vehicle.execution.state import EPOCH_UNIX_S
from wbf_mission.addons.export.formats import export
from wbf_mission.cli.app import main
from wbf_mission.results.result import Result, load_result


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    options = ("--policy", "greedy", "--budget", "45s", "--estimator", "adaptive-disk")
    return fleet_run(tmp_path_factory.mktemp("runs") / "mine", *options)


@pytest.fixture(scope="module")
def result(folder: Path) -> Result:
    return load_result(folder)


@pytest.fixture(scope="module")
def file(folder: Path, result: Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("rerun") / "run.rrd"
    assert export(result, path, "rerun", estimates=5, log=folder / "flight.tlog") == (path,)
    return path


Rows = dict[str, list[tuple[np.datetime64 | None, dict[str, Any]]]]


def reader_of(file: Path) -> Any:
    """Read a recording; a module that takes a second is imported only where this is done."""
    from rerun.chunk import RrdReader

    return RrdReader(file)


@pytest.fixture(scope="module")
def rows(file: Path) -> Rows:
    """The rows of each entity in the order of their times; those that hold for all times have none."""
    found: Rows = {}
    for chunk in reader_of(file).stream().to_chunks():
        batch = chunk.to_record_batch()
        times = None if chunk.is_static else batch.column("time").to_numpy(zero_copy_only=False)
        for k, row in enumerate(batch.to_pylist()):
            values = {name.rpartition(":")[2]: value for name, value in row.items() if value is not None}
            found.setdefault(chunk.entity_path, []).append((None if times is None else times[k], values))
    for each in found.values():
        each.sort(key=lambda one: np.datetime64(0, "ns") if one[0] is None else one[0])
    return found


def moving(rows: Rows, entity: str) -> list[tuple[np.datetime64, dict[str, Any]]]:
    return [(time, values) for time, values in rows[entity] if time is not None]


def seconds(time: np.datetime64) -> float:
    return float((time - np.datetime64(int(EPOCH_UNIX_S), "s")) / np.timedelta64(1, "ns")) / 1e9


def test_rerun_itself_finds_nothing_wrong(file: Path, tmp_path: Path) -> None:
    program = Path(sys.executable).with_name("rerun")
    done = subprocess.run(
        [program, "rrd", "verify", str(file)],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "HOME": str(tmp_path)},
    )
    assert (done.returncode, "1 file verified without error" in done.stdout + done.stderr) == (0, True)
    reader = reader_of(file)
    assert [one.application_id for one in reader.recordings()] == ["wbf-mission"]
    assert len(reader.blueprints()) == 1


def test_vehicles_move_on_map_and_scene(result: Result, rows: Rows) -> None:
    flights = [one for one in result.flights if one.system_id == 2]
    fixes, bodies = moving(rows, "/map/vehicle_2/fix"), moving(rows, "/scene/vehicle_2/body")
    assert len(fixes) == len(bodies) == sum(len(one.track.time_s) for one in flights)
    last = flights[-1]
    time, fix = fixes[-1]
    assert seconds(time) == pytest.approx(last.begun_s + last.track.time_s[-1], abs=1e-6)
    (place,) = fix["positions"]
    assert place == pytest.approx([last.track.latitude_deg[-1], last.track.longitude_deg[-1]], abs=1e-8)
    (where,) = bodies[-1][1]["translation"]
    expected = [last.track.x_m[-1], last.track.y_m[-1], last.track.altitude_m[-1]]
    assert where == pytest.approx(expected, abs=1e-4)
    (quaternion,) = bodies[-1][1]["quaternion"]
    assert np.linalg.norm(quaternion) == pytest.approx(1.0, abs=1e-6)
    (track,) = moving(rows, "/scene/vehicle_2/track")[-1][1]["strips"]
    assert track[-1] == pytest.approx(expected, abs=1e-4)
    (line,) = moving(rows, "/map/vehicle_2/track")[-1][1]["line_strings"]
    assert line[-1] == pytest.approx(place, abs=1e-8)
    assert {"/map/farm", "/map/home", "/scene/farm", "/map/vehicle_1/plan", "/scene/vehicle_1/plan"} <= set(
        rows
    )
    battery = [values["scalars"][0] for _, values in moving(rows, "/plots/battery/vehicle_2")]
    assert len(battery) == len(fixes) and 0.8 < min(battery) < max(battery) <= 1.0


def test_layers_are_pictures_with_north_on_top(result: Result, rows: Rows) -> None:
    height, width = result.farm.height_cells, result.farm.width_cells
    for k, field in enumerate(result.fields):
        mask = field.mask(result.farm.grid())
        for what in ("truth", "estimate", "uncertainty"):
            pictures = moving(rows, f"/layers/{field.name}/{what}")
            assert len(pictures) == 2 if what == "truth" else len(pictures) in (5, 6)
            pixels = np.array(pictures[-1][1]["buffer"][0], np.uint8).reshape(height, width, 4)
            assert ((pixels[::-1, :, 3].T == 255) == mask).all()
        worst = np.unravel_index(np.argmin(np.where(mask, result.truth[k], np.inf)), mask.shape)
        best = np.unravel_index(np.argmax(np.where(mask, result.truth[k], -np.inf)), mask.shape)
        truth = np.array(moving(rows, f"/layers/{field.name}/truth")[-1][1]["buffer"][0], np.uint8)
        of_cells = truth.reshape(height, width, 4)[::-1].transpose(1, 0, 2)
        if field.kind == "disease" and result.truth[k][worst] == 0.0:
            assert of_cells[worst][:3].tolist() == [0x5A, 0x0F, 0x14]
        if field.kind == "disease" and result.truth[k][best] == 1.0:
            assert of_cells[best][:3].tolist() == [0x4F, 0x9D, 0x5D]


def test_scores_readings_and_texts_are_there(result: Result, rows: Rows) -> None:
    assert [values["scalars"][0] for _, values in moving(rows, "/plots/score")] == result.history.scores
    last_day = result.observations[result.observations.day == result.observations.day[-1]]
    _, points = moving(rows, "/scene/readings")[-1]
    assert len(points["positions"]) == len(points["colors"]) == len(last_day)
    expected = [
        (last_day.x[-1] + 0.5) * result.farm.cell_size_m,
        (last_day.y[-1] + 0.5) * result.farm.cell_size_m,
    ]
    assert points["positions"][-1][:2] == pytest.approx(expected, abs=1e-4)
    said = [values["text"][0] for _, values in moving(rows, "/log/vehicle_1")]
    assert [text for one in result.flights if one.system_id == 1 for *_, text in one.texts] == [
        text for text in said if text != "completed"
    ]
    assert moving(rows, "/log/run")[-1][1]["text"] == ["completed"]


def test_without_the_library_one_line_says_what_to_install(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    assert main(["export", str(folder), "--to", "rerun", "--out", str(tmp_path / "run.rrd")]) == 2
    assert (
        'error: recordings of Rerun need rerun; install it with: pip install "wbf-mission[rerun]"\n'
        in capsys.readouterr().err
    )
    assert not list(tmp_path.iterdir())
