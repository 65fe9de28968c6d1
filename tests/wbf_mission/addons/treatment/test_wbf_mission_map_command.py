"""``wbf-mission map``: from the files of a flight to the map, and to the next flight."""

import csv
import json
import sys
from pathlib import Path

import numpy as np
import pytest
import rasterio
import rasterio.warp
from flight_logs import UTC_S, write_picture, write_ulog

from geo import get_farm, load_farm, save_farm
from mission.errors import PlanningError
from mission.files import read_mission
from sensors.observations import Observations
from wbf_mission import load_result, scenario_with
from wbf_mission.addons.treatment.flights import treatment_of_result
from wbf_mission.addons.treatment.logs import read_track
from wbf_mission.addons.treatment.next_flight import plan_next
from wbf_mission.cli.app import main

FIELDS = ("tylcv", "ccr", "soil")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The folder of a short flight over a small farm."""
    folder = tmp_path_factory.mktemp("flown") / "run"
    line = (
        "fly --farm miniberry-30 --planner lawnmower --estimator gp --budget 1min --seed 4 --no-plots --quiet"
    )
    assert main([*line.split(), "--out", str(folder)]) == 0
    return folder


@pytest.fixture
def mapped(capsys):
    """Run the command and return what it prints as JSON."""

    def run_it(*arguments, code=0):
        capsys.readouterr()
        assert main(["map", *map(str, arguments), "--json", "--quiet"]) == code
        told = capsys.readouterr()
        return json.loads(told.out) if code == 0 else told.err

    return run_it


def values_at(folder, farm):
    """The values in the GeoTIFFs at the middles of the cells, NaN where there are none: [n, W, H]."""
    found = np.full((3, *farm.grid().shape), np.nan, np.float32)
    x, y = np.indices(farm.grid().shape).reshape(2, -1)
    latitude, longitude = farm.frame.to_wgs84(*farm.cell_centre(x, y))
    for k, name in enumerate(FIELDS):
        with rasterio.open(folder / f"map_{name}.tif") as file:
            places = np.column_stack(rasterio.warp.transform("EPSG:4326", file.crs, longitude, latitude))
            read = np.array([one[0] for one in file.sample(places)])
            found[k, x, y] = np.where(read == file.nodata, np.nan, read)
    return found


def expected(run):
    result = load_result(run)
    masks = result.fields.masks(result.farm.grid())
    return np.where(masks, result.model.value, np.nan), result


def test_a_telemetry_log_of_a_flight_gives_the_flights_own_estimate(run, mapped, tmp_path):
    told = mapped("--log", run / "flight.tlog", "--farm", "miniberry-30", "--estimator", "gp", "--seed", 4,
                  "--out", tmp_path / "map")  # fmt: skip
    wanted, result = expected(run)
    assert told["observations"] == len(result.observations)
    assert np.allclose(values_at(tmp_path / "map", result.farm), wanted, atol=1e-5, equal_nan=True)
    seen = Observations.load(tmp_path / "map" / "observations.parquet")
    assert np.array_equal(seen.x, result.observations.x)
    assert np.array_equal(seen.values, result.observations.values, equal_nan=True)
    assert json.loads((tmp_path / "map" / "map.json").read_text()).keys() == told.keys() - {"files"}
    assert all(Path(name).is_file() for name in told["files"])


def write_table(path, keys, observations):
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([*keys, *FIELDS])
        for row, key in enumerate(zip(*keys.values(), strict=True)):
            writer.writerow([*key, *observations.values[row].tolist()])
    return path


@pytest.mark.parametrize("kind", ["image", "place", "ulg", "pictures"])
def test_a_table_and_any_log_give_the_same_map(kind, run, mapped, tmp_path):
    wanted, result = expected(run)
    seen, farm = result.observations, result.farm
    places = list(zip(*farm.frame.to_wgs84(*farm.cell_centre(seen.x, seen.y)), strict=True))
    time_s = 100.0 + 0.5 * np.arange(len(seen))
    fixes = [(when, *place) for when, place in zip(time_s, places, strict=True)]
    log, table = tmp_path / "log", tmp_path / "readings.csv"
    numbers = range(len(seen))
    if kind == "image":
        log = run / "flight.tlog"
        track = read_track(log)
        # Milliseconds in one message, microseconds in the other.
        boot_s = track.images.boot_s
        image = [int(track.images.index[np.argmin(np.abs(boot_s - one))]) for one in seen.time_s]
        write_table(table, {"image": image}, seen)
    elif kind == "place":
        log = None
        write_table(table, dict(zip(("latitude", "longitude"), zip(*places, strict=True), strict=True)), seen)
    elif kind == "ulg":
        write_ulog(log, fixes)
        write_table(table, {"time": (UTC_S + time_s).tolist()}, seen)
    else:
        log.mkdir()
        for number, place in zip(numbers, places, strict=True):
            write_picture(log / f"{number:04}.jpg", *place)
        write_table(table, {"name": [f"{number:04}.jpg" for number in numbers]}, seen)
    given = ["--log", log] if log else []
    told = mapped(
        *given, "--observations", table, "--estimator", "gp", "--seed", 4, "--out", tmp_path / "map"
    )
    assert told["observations"] == len(seen)
    assert np.allclose(values_at(tmp_path / "map", farm), wanted, atol=1e-4, equal_nan=True)


def test_a_farm_of_ones_own_and_a_footprint(mapped, tmp_path):
    farm = get_farm("miniberry-10")
    save_farm(farm, tmp_path / "mine.geojson")
    latitude, longitude = load_farm(tmp_path / "mine.geojson").frame.to_wgs84(*farm.cell_centre(5, 5))
    (tmp_path / "r.csv").write_text(
        f"latitude,longitude,tylcv,soil\n{latitude},{longitude},0.5,0.25\n1,1,1,1\n"
    )
    line = ["--observations", tmp_path / "r.csv", "--farm", tmp_path / "mine.geojson", "--estimator", "point"]
    told = mapped(*line, "--camera-footprint", 3, "--out", tmp_path / "map", "--day", 9, "--rate", "75kg/ha")
    assert (told["observations"], told["day"]) == (9, 9)
    outside, unread = told["notes"]
    assert outside == f"1 of 2 readings lie outside the farm {farm.name}"
    assert unread.startswith(
        "charcoal rot (strawberry) was not read anywhere: its map shows only assumptions of the"
    )
    assert told["fields"]["tylcv"]["rate_unit"] == "kg/ha"
    assert told["source"] == "r.csv"


def test_the_next_flight_is_planned_on_the_map(run, mapped, tmp_path):
    told = mapped("--log", run, "--out", tmp_path / "map", "--next", tmp_path / "n.plan", "--budget", "1min",
                  "--policy", "greedy")  # fmt: skip
    mission = read_mission(tmp_path / "n.plan")
    assert len(mission.items) > 3
    following = told["next"]
    assert following["policy"] == "greedy"
    assert 0.0 < following["gain"] <= following["gain_of_all"]
    assert following["plan"]["predicted_time_s"] < 75.0


def test_the_next_flight_goes_where_a_look_is_worth_most(run, tmp_path):
    result = load_result(run)
    farm, model = result.farm, result.model
    x = np.arange(farm.width_cells)[:, None]
    # Only a corner of the tomatoes is in doubt.
    doubt = (x > 20) & (np.arange(farm.height_cells)[None, :] > 22)
    model.uncertainty[:] = 0.0
    for classes in model.probabilities.values():
        classes[:] = np.array([1.0, 0.0, 0.0])[:, None, None]
    model.probabilities["tylcv"][:2, doubt] = np.array([0.88, 0.12])[:, None]
    of = treatment_of_result(result)
    gains = []
    with pytest.raises(PlanningError, match="on which a new look would save anything"):
        plan_next(of, scenario_with(result.scenario, {"budget": "60s"}))
    for budget in ("90s", "120s"):
        found = plan_next(of, scenario_with(result.scenario, {"budget": budget}))
        path = found.plan.path_m / farm.cell_size_m
        inside = (path[:, 0] > 17) & (path[:, 1] > 19)
        assert inside.mean() > 0.7
        gains.append(found.gain)
    assert 0.0 < gains[0] < gains[1] < found.gain_of_all
    assert gains[1] > 0.6 * found.gain_of_all


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("", "there is nothing to map: give --log, --observations or both"),
        ("--log RUN/nothing.tlog", "nothing.tlog: cannot be read: no such file"),
        ("--log RUN/flight.tlog --farm miniberry-100", "has no observations of a leaf camera on the farm"),
        ("--log RUN/flight.tlog --fields soil,tylcv", "the camera senses other fields"),
        ("--log RUN/flight.tlog --observations HERE/none.csv", "none.csv: cannot be read: no such file"),
        (
            "--log RUN/flight.tlog --observations HERE/late.csv",
            "late.csv: no reading is left: 1 of 1 readings",
        ),
        ("--observations HERE/late.csv", "late.csv: the table gives the time of each reading, not its"),
        ("--observations RUN/observations.parquet --farm miniberry-10", "lies outside the farm of 10 x 10"),
        ("--observations HERE/old.csv", "old.csv: the days -3 to 6 are not within 0 to 126"),
        ("--log RUN --estimator gp", "--estimator has no effect, as the results of a run"),
        ("--log RUN --budget 1min", "--budget has an effect only with --next"),
        ("--log RUN --block 0", "--block 0 is out of range: give 0.01 to 1000 metres"),
        ("--log RUN --next RUN/summary.json", "this existing file is no .plan"),
        ("--log RUN --next HERE/n.plan --policy nobody", "nobody"),
        ("--log RUN --next HERE/n.plan --budget 1s", "finds nothing worth another flight"),
        ("--log RUN/flight.tlog --out RUN --overwrite", "flight.tlog; give another folder"),
        ("--log RUN --out HERE", "holds other files already; give another folder, or add --overwrite"),
    ],
)
def test_what_cannot_be_mapped_is_told_in_a_line(line, told, run, tmp_path, capsys):
    (tmp_path / "late.csv").write_text("time,soil\n9e5,1\n")
    (tmp_path / "no.csv").write_text("x,y,time_s,day,tylcv,ccr,soil\n")
    (tmp_path / "old.csv").write_text("x,y,time_s,day,tylcv,ccr,soil\n1,1,0,-3,1,1,1\n1,1,0,6,1,1,1\n")
    before = sorted(tmp_path.iterdir()), sorted(run.iterdir())
    line = line if "--out" in line else f"{line} --out HERE/map"
    words = line.replace("RUN", str(run)).replace("HERE", str(tmp_path)).split()
    assert main(["map", *words, "--quiet"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert told in err.splitlines()[-1]
    assert err.splitlines()[-1].startswith("error: ")
    assert (sorted(tmp_path.iterdir()), sorted(run.iterdir())) == before


def test_an_older_map_is_replaced_only_if_that_is_said(run, mapped, tmp_path):
    out = tmp_path / "map"
    mapped("--log", run, "--out", out)
    (out / "notes.txt").write_text("mine")
    (out / "orthophoto.tif").write_text("mine, too")
    assert "holds a map already" in mapped("--log", run, "--out", out, code=2)
    mapped("--log", run, "--out", out, "--overwrite", "--rate", "1L/ha")
    assert (out / "notes.txt").read_text() == "mine"
    assert (out / "orthophoto.tif").read_text() == "mine, too"
    assert json.loads((out / "map.json").read_text())["fields"]["soil"]["rate"] == 1.0


def test_without_the_extra_it_says_how_to_install_it(run, mapped, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "rasterio", None)
    told = mapped("--log", run, "--out", tmp_path / "map", code=2)
    assert told == 'error: treatment maps need rasterio; install it with: pip install "wbf-mission[gis]"\n'
    line = "fly --farm miniberry-10 --vehicle ideal --budget 20steps --treatment-map --quiet"
    assert main([*line.split(), "--out", str(tmp_path / "run")]) == 2
    assert capsys.readouterr().err == told
    assert list(tmp_path.iterdir()) == []


def test_fly_writes_the_same_beside_its_results(mapped, tmp_path, capsys):
    line = "fly --farm miniberry-10 --vehicle ideal --estimator gp --no-plots --quiet --treatment-map --out"
    assert main([*line.split(), str(tmp_path / "run")]) == 0
    mapped("--log", tmp_path / "run", "--out", tmp_path / "map")
    names = sorted(one.name for one in (tmp_path / "run" / "treatment").iterdir())
    assert names == sorted(one.name for one in (tmp_path / "map").iterdir())
    for name in ("map_tylcv.tif", "prescription_soil.zip", "zones.geojson", "observations.parquet"):
        same = [(tmp_path / folder / name).read_bytes() for folder in ("run/treatment", "map")]
        assert same[0] == same[1], name
    load_result(tmp_path / "run")
    # A newer result without a map does not keep the older one's.
    assert main([*line.replace(" --treatment-map", "").split(), str(tmp_path / "run")]) == 0
    assert not (tmp_path / "run" / "treatment").exists()
    assert "--treatment-map writes files" in _refused("fly --treatment-map --no-files", capsys)


def _refused(line, capsys):
    capsys.readouterr()
    assert main(line.split()) == 2
    return capsys.readouterr().err
