"""The folder of a run: complete or untouched, and loaded as it was."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from geo import get_farm, save_farm
from mission.files import read_mission, write_mission
from mission.ground.link_state import LinkReport
from mission.link.tlog import read_tlog
from mission.model import Command, Frame, MissionItem
from mission.outcome import Outcome
from sensors.lazy_fields import LazyFields
from sensors.observations import Observations
from wbf_mission.flight import Simulated, fly
from wbf_mission.results import writing
from wbf_mission.results.files import FORMAT
from wbf_mission.results.products import PICTURES, product
from wbf_mission.results.result import load_result
from wbf_mission.results.storage import ArrayFileError, ResultError
from wbf_mission.results.writing import ResultFolder, run_name
from wbf_mission.scenario import Scenario, scenario_with

SMALL = Scenario(farm="miniberry-10", planner="lawnmower", vehicle="ideal", seed=3, estimator="adaptive-disk")


@pytest.fixture(scope="module")
def result():
    return fly(scenario_with(SMALL, {"vehicle": "quad", "gps_noise_m": 0.5, "budget": "60m"}))


def test_a_lazy_result_reads_truth_and_estimate_at_each_access(result, tmp_path):
    result.save(tmp_path / "run", plots=False)
    again = load_result(tmp_path / "run", lazy=True)
    assert again == result
    assert again.model is not None and isinstance(again.truth, LazyFields)
    assert isinstance(again.model.value, LazyFields) and isinstance(again.model.uncertainty, LazyFields)
    (tmp_path / "run" / "value.zarr.zip").unlink()
    np.testing.assert_array_equal(again.truth, result.truth)
    with pytest.raises(ArrayFileError, match=r"value.zarr.zip: cannot be read"):
        again.model.value[0]


def test_what_is_loaded_is_what_was_saved(result, tmp_path):
    result.save(tmp_path / "run", plots=False)
    again = load_result(tmp_path / "run")
    assert again == result
    assert dataclasses.replace(again, frames=again.frames + 1) != result
    assert dataclasses.replace(again, truth=None) != result
    for name in ("value", "uncertainty"):
        np.testing.assert_array_equal(getattr(again.model, name), getattr(result.model, name))
    np.testing.assert_array_equal(again.plan.path_m, result.plan.path_m)
    np.testing.assert_array_equal(again.plan.prediction.track_m, result.plan.prediction.track_m)
    assert again.summary() == result.summary()


def test_a_real_flight_keeps_how_good_its_link_was(result, tmp_path):
    link = LinkReport(1200, 30, 0.05, 4.0, 9.5)
    flights = tuple(dataclasses.replace(one, link=link, missing_images=3) for one in result.flights)
    real = dataclasses.replace(result, flights=flights)
    assert load_result(real.save(tmp_path / "run", plots=False)) == real


def test_a_mission_that_no_plan_can_hold_is_saved_as_json(result, tmp_path):
    mission = result.plan.mission
    there = mission.items[2]
    rally = MissionItem(Command.NAV_RALLY_POINT, Frame.GLOBAL, x=there.x, y=there.y, z=90.0)
    mission = dataclasses.replace(mission, home=None, rally=(rally,))
    write_mission(mission, tmp_path / "own.json")
    flown = fly(scenario_with(Scenario(farm="miniberry-10"), {"mission": str(tmp_path / "own.json")}))
    flown.rest = mission
    told = []
    with ResultFolder(tmp_path / "run", warn=told.append) as folder:
        written = folder.write(flown)
    for name, line in zip(("plan", "rest"), told, strict=True):
        assert line.startswith(
            f"{name}.plan is left out, use {name}.json: a plan cannot hold the mission: rally"
        )
        assert not (tmp_path / "run" / f"{name}.plan").exists()
        assert tmp_path / "run" / f"{name}.json" in written
    assert all(path.is_file() for path in written)
    assert load_result(tmp_path / "run") == flown
    assert flown.plan.mission.home is None


def test_class_probabilities_are_kept_where_the_estimator_has_them(result, tmp_path):
    flown = fly(scenario_with(SMALL, {"estimator": "gp"}))
    flown.save(tmp_path / "run", plots=False)
    again = load_result(tmp_path / "run")
    assert flown.model is not None and again.model is not None
    told, kept = flown.model.probabilities, again.model.probabilities
    assert told is not None and kept is not None
    assert list(kept) == ["tylcv", "ccr"]
    for disease in kept:
        assert kept[disease].shape == (3, 10, 10)
        np.testing.assert_array_equal(kept[disease], told[disease])
    assert again.summary() == flown.summary()
    assert again.summary()["report"]["fields"]["ccr"]["may_be_sick"] > 0
    assert result.model is not None and result.model.probabilities is None
    without = load_result(tmp_path / "run", probabilities=False)
    assert without.model is not None and without.model.probabilities is None
    # An older result of the run is replaced by one without them.
    fly(SMALL).save(tmp_path / "run", plots=False, overwrite=True)
    assert not list((tmp_path / "run").glob("probabilities_*"))


def test_the_folder_holds_what_others_read(tmp_path):
    with ResultFolder(tmp_path / "run") as folder:
        result = fly(
            scenario_with(SMALL, {"vehicle": "quad", "budget": "60m"}), by=Simulated(tlog=folder.tlog)
        )
        assert not (tmp_path / "run").exists()
        written = folder.write(result, products=[PICTURES])
    assert [path.name for path in tmp_path.iterdir()] == ["run"]
    assert all(path.is_file() for path in written)
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["outcome"] == "completed"
    assert {"seed", "farm", "planner", "estimator", "vehicle", "score", "losses", "timings_s"} <= set(summary)
    assert len(Observations.load(tmp_path / "run" / "observations.parquet")) == summary["observations"]
    mission = read_mission(tmp_path / "run" / "plan.plan")
    assert len(mission.items) == len(result.plan.mission.items)
    kinds = {message.get_type() for _, message in read_tlog(tmp_path / "run" / "flight.tlog")}
    assert {"HEARTBEAT", "MISSION_ITEM_INT", "GLOBAL_POSITION_INT", "CAMERA_IMAGE_CAPTURED"} <= kinds
    assert {"DEBUG_FLOAT_ARRAY", "BATTERY_STATUS", "COMMAND_ACK"} <= kinds
    pictures = {path.name for path in written if path.suffix == ".png"}
    assert pictures == {"path.png", "score.png", "field_tylcv.png", "field_ccr.png", "field_soil.png"}


def test_a_result_of_a_farm_file_is_loaded_without_the_file(tmp_path):
    file = tmp_path / "mine.geojson"
    save_farm(get_farm("miniberry-10"), file)
    result = fly(scenario_with(SMALL, {"farm": str(file)}))
    result.save(tmp_path / "run", plots=False)
    file.unlink()
    again = load_result(tmp_path / "run")
    assert np.array_equal(again.farm.grid().crop, result.farm.grid().crop)
    assert again.scenario == result.scenario


def test_an_older_result_is_replaced_only_by_a_whole_one(result, tmp_path, monkeypatch):
    result.save(tmp_path / "run", plots=False)
    (tmp_path / "run" / "notes.txt").write_text("mine")
    before = {path.name: path.read_bytes() for path in (tmp_path / "run").iterdir()}

    def full(*_):
        raise OSError(28, "No space left on device", "value.zarr.zip")

    monkeypatch.setattr("wbf_mission.results.files.write_array", full)
    with pytest.raises(OSError, match="No space"):
        result.save(tmp_path / "run", plots=False)
    assert {path.name: path.read_bytes() for path in (tmp_path / "run").iterdir()} == before
    assert [path.name for path in tmp_path.iterdir()] == ["run"]
    monkeypatch.undo()
    result.save(tmp_path / "run", plots=False)
    assert (tmp_path / "run" / "notes.txt").read_text() == "mine"
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_what_is_not_ours_or_of_another_run_needs_overwrite(result, tmp_path):
    other = tmp_path / "other"
    other.mkdir()
    (other / "letter.txt").write_text("dear")
    with pytest.raises(ResultError, match="holds other files") as caught:
        result.save(other, plots=False)
    assert "(--overwrite, overwrite=True)" in str(caught.value)
    assert [path.name for path in other.iterdir()] == ["letter.txt"]
    result.save(other, plots=False, overwrite=True)
    assert (other / "letter.txt").read_text() == "dear"
    different = scenario_with(result.scenario, {"seed": 4}).to_dict()
    with pytest.raises(ResultError, match="another run"):
        ResultFolder(other, scenario=different)
    ResultFolder(other, scenario=different, overwrite=True)
    taken = tmp_path / "file"
    taken.write_text("x")
    with pytest.raises(ResultError, match="is a file"):
        result.save(taken, overwrite=True)


def test_the_rest_of_an_older_run_does_not_stay(result, tmp_path):
    run = tmp_path / "run"
    dataclasses.replace(result, rest=result.plan.mission).save(run, plots=False)
    for name in ("rest.plan", "rest.json"):
        with pytest.raises(ResultError, match="which the run reads"):
            ResultFolder(run, inputs=[run / name], overwrite=True)
    result.save(run, plots=False)
    assert not list(run.glob("rest.*"))
    assert load_result(run).rest is None


def test_the_folder_in_which_one_is(result, tmp_path, monkeypatch):
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    result.save(".", plots=False)
    (here / "path.png").write_text("of an older run")
    (here / "notes.txt").write_text("mine")
    result.save(".", plots=False)
    assert Path.cwd() == here
    assert load_result(".").score == result.score
    assert not Path("path.png").exists()
    assert Path("notes.txt").read_text() == "mine"
    assert [path.name for path in tmp_path.iterdir()] == ["here"]


def test_a_link_to_a_folder_stays_a_link(result, tmp_path):
    (tmp_path / "disk").mkdir()
    (tmp_path / "run").symlink_to(tmp_path / "disk")
    for _ in range(2):
        result.save(tmp_path / "run", plots=False)
    assert (tmp_path / "run").is_symlink()
    assert load_result(tmp_path / "disk").score == result.score
    assert sorted(path.name for path in tmp_path.iterdir()) == ["disk", "run"]


def test_an_interrupted_flight_goes_beside_an_older_result(result, tmp_path):
    result.save(tmp_path / "run", plots=False)
    stopped = dataclasses.replace(result.flights[0], outcome=Outcome.INTERRUPTED)
    broken = dataclasses.replace(result, flights=(stopped,))
    (tmp_path / "run.interrupted-2").mkdir()
    (tmp_path / "run.interrupted-2" / "letter.txt").write_text("dear")
    for name, seed in (("run.interrupted", 4), ("run.interrupted-3", 5)):
        other = dataclasses.replace(broken, scenario=scenario_with(result.scenario, {"seed": seed}))
        with ResultFolder(tmp_path / "run", scenario=result.scenario.to_dict()) as folder:
            folder.write(other)
        assert folder.path == tmp_path / name
    assert load_result(tmp_path / "run").outcome is Outcome.COMPLETED
    for name, seed in (("run.interrupted", 4), ("run.interrupted-3", 5)):
        again = load_result(tmp_path / name)
        assert (again.outcome, again.scenario.seed) == (Outcome.INTERRUPTED, seed)
    assert [path.name for path in (tmp_path / "run.interrupted-2").iterdir()] == ["letter.txt"]


@pytest.mark.parametrize(("written", "beside"), [(".", "../here.interrupted"), ("in", "in.interrupted")])
def test_an_interrupted_flight_is_kept_however_the_folder_is_written(
    result, tmp_path, monkeypatch, written, beside
):
    here = tmp_path / "runs" / "here"
    here.mkdir(parents=True)
    monkeypatch.chdir(here)
    result.save(written, plots=False, overwrite=True)
    stopped = dataclasses.replace(result.flights[0], outcome=Outcome.INTERRUPTED)
    with ResultFolder(Path(written), overwrite=True) as folder:
        folder.write(dataclasses.replace(result, flights=(stopped,)))
    assert folder.path == (Path(beside) if written == "in" else Path(beside).resolve())
    assert load_result(beside).outcome is Outcome.INTERRUPTED
    assert load_result(written).outcome is Outcome.COMPLETED


def test_ctrl_c_among_the_pictures_keeps_the_rest(result, tmp_path, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(product(PICTURES), "write", interrupted)
    with pytest.raises(KeyboardInterrupt):
        result.save(tmp_path / "run")
    assert load_result(tmp_path / "run").score == result.score
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_names_of_runs_that_differ():
    changes = [{}, {"budget": "30steps"}, {"day": 5}, {"seed": 4}, {"days": 3}, {"vehicles": 2}]
    changes += [{"planner": "lawnmower:direction=0.3"}, {"policy": "greedy"}, {"policy": "greedy:every=9"}]
    for key, file in (("farm", "field.geojson"), ("mission", "rows.plan"), ("vehicle", "mine.toml")):
        changes += [{key: f"a/{file}"}, {key: f"b/{file}"}]
    names = {run_name(scenario_with(SMALL, one)) for one in changes}
    assert len(names) == len(changes)
    assert not any(set(name) & set("/:= ") for name in names)
    assert run_name(SMALL) == run_name(SMALL)
    assert "_greedy_" in run_name(scenario_with(SMALL, {"policy": "greedy"}))


@pytest.mark.parametrize("damage", ["nothing", "record", "format"])
def test_damaged_results_are_refused_in_one_line(result, tmp_path, damage):
    folder = tmp_path / "run"
    if damage != "nothing":
        result.save(folder, plots=False)
    if damage == "record":
        (folder / "result.json").write_bytes(b"[" * 100_000)
    if damage == "format":
        text = (folder / "result.json").read_text().replace(f'"format": {FORMAT}', '"format": 99')
        (folder / "result.json").write_text(text)
    with pytest.raises(ResultError) as caught:
        load_result(folder)
    assert "\n" not in str(caught.value)
    assert str(tmp_path) in str(caught.value)


def test_products_that_need_the_estimate_come_first_and_one_that_is_broken_off_leaves_nothing(
    result, tmp_path, monkeypatch
):
    class Made:
        def __init__(self, needs_estimate):
            self.needs_estimate = needs_estimate

        def files(self, run):
            return [next(name for name, maker in made.items() if maker is self)]

        def write(self, run, path, progress):
            wrote.append((path.name, run.model is not None))
            path.mkdir()
            (path / "half").touch()
            if not self.needs_estimate:
                raise KeyboardInterrupt

    wrote = []
    made = {"late": Made(needs_estimate=False), "early": Made(needs_estimate=True)}
    monkeypatch.setattr(writing, "product", made.__getitem__)
    monkeypatch.setattr(writing, "product_names", lambda: frozenset(made))
    with pytest.raises(KeyboardInterrupt), ResultFolder(tmp_path / "run") as folder:
        folder.write(dataclasses.replace(result), products=list(made), release=True)
    assert wrote == [("early", True), ("late", False)]
    assert (tmp_path / "run" / "early" / "half").is_file() and not (tmp_path / "run" / "late").exists()
    assert load_result(tmp_path / "run") == result
