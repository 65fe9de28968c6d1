"""The report of a run: one file that holds what the result holds, shows it, and prints on one sheet."""

from __future__ import annotations

import base64
import json
import re
import webbrowser
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from live_page import page_at
from numpy.typing import NDArray
from playwright.sync_api import Browser, expect
from single_page import SinglePage

from geo import save_farm
from geo.farms import get_farm
from mission.outcome import Outcome
from wbf_mission.addons.web import report
from wbf_mission.addons.web.report import MOST_BYTES, ReportError, write_report
from wbf_mission.cli.app import main
from wbf_mission.flight import Simulated, fly
from wbf_mission.progress import silent
from wbf_mission.results.result import Result, load_result
from wbf_mission.scenario import Scenario

BAD = '<img src=x onerror="document.title=1"></script>&amp;'
NOTHING = 255
SMALL: dict[str, Any] = {"budget": "90s", "estimator": "adaptive-disk"}


def flown(folder: Path, **options: Any) -> Path:
    """Fly, and save with the log."""
    folder.mkdir(parents=True)
    made = fly(Scenario(**{**SMALL, **options}), by=Simulated(tlog=folder / "flight.tlog"))
    made.save(folder / "run", plots=False)
    (folder / "flight.tlog").rename(folder / "run" / "flight.tlog")
    return folder / "run"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return flown(tmp_path_factory.mktemp("one") / "a", farm="miniberry-10", seed=3)


@pytest.fixture(scope="module")
def other(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return flown(tmp_path_factory.mktemp("two") / "b", farm="miniberry-10", policy="greedy", vehicles=2)


@pytest.fixture(scope="module")
def result(folder: Path) -> Result:
    return load_result(folder)


@pytest.fixture(scope="module")
def file(folder: Path, result: Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "report.html"
    write_report(path, [result], logs=[folder / "flight.tlog"])
    return path


@pytest.fixture(scope="module")
def recording(file: Path) -> dict[str, Any]:
    (held,) = SinglePage(file).held("recording")
    return dict(held)


def layers_at_the_end(held: dict[str, Any]) -> dict[str, NDArray[np.float64]]:
    """Put the tiles of all moments together: values float64[width, height] by layer."""
    raster = held["run"]["raster"]
    side, shape = raster["tile"], (raster["width"], raster["height"])
    found: dict[str, NDArray[np.float64]] = {}
    for moment in held["moments"]:
        for tile in moment["tiles"]:
            values = found.setdefault(tile["layer"], np.full(shape, np.nan))
            x, y = (slice(side * tile[axis], side * (tile[axis] + 1)) for axis in ("x", "y"))
            part = np.frombuffer(zlib.decompress(base64.b64decode(tile["data"])), np.uint8)
            pixels = part.reshape(values[x, y].shape[::-1]).T
            scaled = pixels / 254.0 * moment["scales"][tile["layer"]]
            values[x, y] = np.where(pixels == NOTHING, np.nan, scaled)
    return found


def check_layers(held: dict[str, Any], result: Result) -> None:
    """Compare the layers at the end with the means of the model's cells, within half a step of a byte."""
    layers, cells = layers_at_the_end(held), held["run"]["raster"]["cells"]
    model, grid, scales = result.model, result.farm.grid(), held["moments"][-1]["scales"]
    assert model is not None
    for k, field in enumerate(result.fields):
        mask = field.mask(grid)
        for name, values in (("value", model.value[k]), ("uncertainty", model.uncertainty[k])):
            shown = layers[f"{name}/{field.name}"]
            sums = np.zeros((2, *(cells * n for n in shown.shape)))
            sums[:, : mask.shape[0], : mask.shape[1]] = np.where(mask, values, 0.0), mask
            blocks = sums.reshape(2, shown.shape[0], cells, shown.shape[1], cells).sum(axis=(2, 4))
            means = np.divide(blocks[0], blocks[1], out=np.full(shown.shape, np.nan), where=blocks[1] > 0)
            step = scales.get(f"{name}/{field.name}", 1.0) / 254.0
            np.testing.assert_allclose(shown, means, atol=0.51 * step)
            assert np.isfinite(shown).any()


def test_it_is_whole_in_itself(file: Path) -> None:
    page = SinglePage(file)
    page.check()
    assert page.tags.count("script") == 2
    assert file.stat().st_size < MOST_BYTES


def test_tracks_are_those_of_the_result(recording: dict[str, Any], result: Result) -> None:
    track, states = result.flights[0].track, recording["states"]["1"]
    times_s = np.array(states["time_s"])
    assert len(times_s) < 0.7 * len(track.time_s)
    for name, column, reach in (
        ("x", track.x_m, 0.03),
        ("y", track.y_m, 0.03),
        ("height_m", track.altitude_m, 0.06),
    ):
        between = np.interp(track.time_s, times_s, states[name])
        assert np.abs(between - column).max() < reach
    battery = [one for one in states["battery"] if one is not None]
    assert battery[0] == pytest.approx(1.0, abs=0.02)
    assert result.battery_used == pytest.approx(battery[0] - battery[-1], abs=0.02)
    assert "AUTO" in "".join(states["mode"]).upper() or "MISSION" in "".join(states["mode"]).upper()


def test_readings_and_scores_are_those_of_the_result(recording: dict[str, Any], result: Result) -> None:
    seen, cell_m, readings = result.observations, result.farm.cell_size_m, recording["readings"]
    np.testing.assert_allclose(readings["x"], (seen.x + 0.5) * cell_m, atol=1e-3)
    np.testing.assert_allclose(readings["y"], (seen.y + 0.5) * cell_m, atol=1e-3)
    for k, name in enumerate(seen.fields):
        told = np.array(readings["values"][name], np.float64)
        hosts = result.fields[name].hosts(result.farm.grid())[seen.x, seen.y]
        np.testing.assert_allclose(told, np.where(hosts, seen.values[:, k], np.nan), atol=1e-3)
    assert recording["scores"]["score"] == [one.score for one in result.history.entries]
    assert recording["status"]["outcome"] == "completed"


def test_the_layers_at_the_end_are_the_model(recording: dict[str, Any], result: Result) -> None:
    assert len(recording["moments"]) > 3
    assert sorted(one["time_s"] for one in recording["moments"]) == [
        one["time_s"] for one in recording["moments"]
    ]
    check_layers(recording, result)
    assert result.truth is not None
    truth = layers_at_the_end(recording)["truth/tylcv"]
    known = np.isfinite(truth)
    np.testing.assert_allclose(truth[known], result.truth[0][known], atol=0.51 / 254.0)


def test_the_same_run_gives_the_same_bytes(folder: Path, file: Path, tmp_path: Path) -> None:
    write_report(tmp_path / "again.html", [load_result(folder)], logs=[folder / "flight.tlog"])
    assert (tmp_path / "again.html").read_bytes() == file.read_bytes()


def test_what_is_too_large_is_reduced_and_said(result: Result, tmp_path: Path) -> None:
    whole = write_report(tmp_path / "whole.html", [result])
    half = write_report(tmp_path / "half.html", [result], most_bytes=whole.size)
    assert half.size < whole.size
    assert half.moments[0] < whole.moments[0]
    (held,) = SinglePage(tmp_path / "half.html").held("recording")
    check_layers(held, result)
    assert half.notes == (f"The layers are shown at {half.moments[0]} of {whole.moments[0]} moments",)
    assert half.notes[0] in " ".join(SinglePage(tmp_path / "half.html").words)
    least = write_report(tmp_path / "least.html", [result], most_bytes=1)
    assert least.notes[-1] == "Every 64th reading of healthy plants is kept"
    (held,) = SinglePage(tmp_path / "least.html").held("recording")
    sick = (result.observations.values[:, :2] < 0.75).any(axis=1)
    times_s = np.array(held["readings"]["time_s"])
    kept = sick | (np.arange(len(sick)) % 64 == 0)
    assert 0 < sick.sum() <= kept.sum() == len(times_s) < len(sick)
    assert np.isin(np.round(result.observations.time_s[sick], 3), np.round(times_s, 3)).all()


def test_an_estimator_that_is_gone_is_said(
    result: Result, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    from sensors.errors import EstimatorError

    def gone(*_: Any, **__: Any) -> None:
        raise EstimatorError("estimator Mine: it was given as an object")

    monkeypatch.setattr("wbf_mission.addons.base.replay.fresh_estimator", gone)
    made = write_report(tmp_path / "r.html", [result])
    assert made.moments == (1,)
    assert made.notes == ("Layers show only the end of the run: estimator Mine: it was given as an object",)


def test_the_summary_tells_what_the_result_tells(file: Path, result: Result) -> None:
    words = " ".join(" ".join(SinglePage(file).words).split())
    assert "miniberry-10: what the flight found" in words
    assert result.report is not None
    for field in result.report.fields:
        assert field.title in words
        for block in field.blocks:
            assert f"{block.latitude_deg:.5f}, {block.longitude_deg:.5f}" in words
    assert f"{result.score:.5f} over the run" in words
    assert f"{len(result.observations):,} readings" in words
    looked = {one.name: f"{one.seen:,} of {one.cells:,}" for one in result.report.fields}
    assert f"{looked['ccr']} plants were looked at" in words
    assert f"{looked['soil']} cells were looked at" in words


def test_outcomes_are_told_in_words(result: Result, tmp_path: Path) -> None:
    flight = replace(result.flights[0], outcome=Outcome.BATTERY_DEPLETED, reason="at 40 s", battery_used=1.0)
    write_report(tmp_path / "r.html", [replace(result, flights=(flight,))])
    page = SinglePage(tmp_path / "r.html")
    words = " ".join(" ".join(page.words).split())
    assert "battery empty in the air: at 40 s" in words and "100 % of one" in words
    assert "battery_depleted" not in words
    (held,) = page.held("recording")
    assert held["said"][-1]["text"] == "flight 1: battery empty in the air: at 40 s"


def test_names_of_files_and_vehicles_are_text(tmp_path: Path) -> None:
    save_farm(replace(get_farm("miniberry-10"), name=BAD), tmp_path / "farm.geojson")
    hostile = fly(
        Scenario(farm=str(tmp_path / "farm.geojson"), vehicle="ideal", budget="60steps", estimator="point")
    )
    assert hostile.farm.name == BAD
    hostile.flights[0].texts.append((1.0, 4, BAD))
    hostile.flights[0].warnings.append(BAD)
    write_report(tmp_path / "r.html", [hostile])
    page = SinglePage(tmp_path / "r.html")
    page.check()
    assert "img" not in page.tags
    assert page.source.count("</script>") == 2
    assert BAD in " ".join(page.words)
    assert BAD in [one["text"] for one in page.held("recording")[0]["said"]]


def test_it_opens_at_its_summary_and_ends_with_a_vehicle_that_is_disarmed(
    browser: Browser, file: Path, recording: dict[str, Any], result: Result
) -> None:
    states = recording["states"]["1"]
    assert True in states["armed"] and states["armed"][-1] is False
    with page_at(browser, file.as_uri()) as page:
        for _ in range(2):
            expect(page.get_by_role("heading", name="what the flight found")).to_be_in_viewport()
            card = page.locator(".card")
            expect(card).to_contain_text(f"{states['mode'][-1]} · disarmed")
            assert card.locator(".heard dd").inner_text() == "\N{EN DASH}", "nobody hears it now"
            expect(page.locator(".top .connection")).to_have_text("Recording")
            expect(page.locator(".top .outcome")).to_have_attribute("data-state", "good")
            page.locator(".card").scroll_into_view_if_needed()
            page.reload()
        page.get_by_label("Time of the run").fill("30")
        expect(card).to_contain_text("· armed")


def test_the_farm_lies_beside_the_layers_from_the_beginning(browser: Browser, file: Path) -> None:
    """The panel of the layers gets its width after the map is drawn first."""
    place = "document.querySelector('.vehicle').getBoundingClientRect().x"
    for _ in range(3):
        with page_at(browser, file.as_uri()) as page:
            page.get_by_role("checkbox", name="Trails").wait_for()
            page.wait_for_timeout(200)
            begun_px = page.evaluate(place)
            page.get_by_role("button", name="Show all").click()
            assert page.evaluate(place) == pytest.approx(begun_px, abs=1.0)


def test_layers_are_those_of_the_moment(browser: Browser, file: Path, recording: dict[str, Any]) -> None:
    """With nothing else on the map, it is the same before and after a time without a moment, else another."""
    first, second = (recording["moments"][k]["time_s"] for k in (0, -1))
    with page_at(browser, file.as_uri()) as page:
        page.locator("#app").scroll_into_view_if_needed()
        for label in ("Crops", "Plans and fences", "Trails", "Camera readings", "Decisions"):
            page.get_by_role("checkbox", name=label).uncheck()
        page.evaluate("document.querySelectorAll('.vehicle').forEach(one => one.hidden = true)")
        canvas = "[...document.querySelectorAll('.map canvas')].map(one => one.toDataURL()).join()"
        pictures = []
        for time_s in (first + 0.2, first + 0.4, second):
            page.get_by_label("Time of the run").fill(f"{time_s:.1f}")
            page.wait_for_timeout(500)
            pictures.append(page.evaluate(canvas))
        assert pictures[0] == pictures[1] != pictures[2]


@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (390, "dark")])
def test_it_fits_and_can_be_used_by_all(browser: Browser, file: Path, width: int, scheme: str) -> None:
    size = {"width": width, "height": 800}
    with page_at(browser, file.as_uri(), viewport=size, color_scheme=scheme, bypass_csp=True) as page:
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        found = Axe().run(page).response["violations"]
        assert [(one["id"], [node["html"][:80] for node in one["nodes"]]) for one in found] == []


@pytest.mark.parametrize("count", [1, 2])
def test_it_prints_on_one_sheet(
    browser: Browser, folder: Path, other: Path, tmp_path: Path, count: int
) -> None:
    runs = [load_result(one) for one in (folder, other)[:count]]
    for number in range(12):
        runs[0].flights[0].warnings.append(f"warning {number}: " + "something is not as it should be " * 9)
    write_report(tmp_path / "r.html", runs)
    with page_at(browser, (tmp_path / "r.html").as_uri()) as page:
        printed = page.pdf(prefer_css_page_size=True)
    assert len(re.findall(rb"/Type\s*/Page\b(?!s)", printed)) == 1
    assert (b"/Image" in printed) and len(printed) > 20_000


def test_two_runs_stand_side_by_side(browser: Browser, folder: Path, other: Path, tmp_path: Path) -> None:
    runs = [load_result(one) for one in (folder, other)]
    write_report(tmp_path / "two.html", runs, logs=[one / "flight.tlog" for one in (folder, other)])
    held = SinglePage(tmp_path / "two.html").held("recording")
    for one, run in zip(held, runs, strict=True):
        check_layers(one, run)
    with page_at(browser, (tmp_path / "two.html").as_uri()) as page:
        rows = {row.locator("th").inner_text(): row for row in page.locator("#summary tr").all()[1:]}
        assert rows["path"].locator("td").all_inner_texts() == ["spiral", "greedy"]
        scores = rows["score"].locator("td").all_inner_texts()
        assert [text.split()[0] for text in scores] == [f"{run.score:.5f}" for run in runs]
        classes = {name: row.get_attribute("class") for name, row in rows.items()}
        assert (classes["path"], classes["estimator"]) == ("differs", None)
        expect(page.locator(".map")).to_have_count(2)
        expect(page.locator(".card")).to_have_count(3)
        page.get_by_label("Time of the run").fill("30")
        expect(page.locator(".clock")).to_contain_text("0:30")


def test_two_farms_are_refused(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    away = flown(tmp_path / "away", farm="miniberry-30", vehicle="ideal", budget="90steps")
    with pytest.raises(ReportError, match="different farms, miniberry-10 and miniberry-30"):
        write_report(tmp_path / "r.html", [load_result(folder), load_result(away)])
    assert main(["report", str(folder), str(away), "--out", str(tmp_path / "r.html"), "--quiet"]) == 2
    assert capsys.readouterr().err.startswith(
        "error: the runs are of different farms, miniberry-10 and miniberry-30"
    )
    assert not (tmp_path / "r.html").exists()


def test_the_command_writes_beside_the_results(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", lambda url: opened.append(url) or True)
    run = tmp_path / "mine"
    run.symlink_to(folder)
    assert main(["report", str(run), "--out", str(tmp_path / "mine.html"), "--open", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["report"], told["bytes"]) == (
        str(tmp_path / "mine.html"),
        (tmp_path / "mine.html").stat().st_size,
    )
    assert opened == [(tmp_path / "mine.html").as_uri()]
    assert main(["report", str(run), "--out", str(tmp_path / "mine.html")]) == 2
    assert "is there already; give another name with --out, or --overwrite" in capsys.readouterr().err
    assert main(["report", str(run), "--out", str(tmp_path / "mine.html"), "--overwrite", "--quiet"]) == 0
    assert main(["report", str(tmp_path / "none")]) == 2
    assert "holds no result" in capsys.readouterr().err
    assert main(["report", str(run), "--out", str(tmp_path / "no" / "r.html")]) == 2
    assert "there is no folder" in capsys.readouterr().err


def test_ctrl_c_leaves_nothing(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: Any, **__: Any) -> str:
        raise KeyboardInterrupt

    monkeypatch.setattr(report, "document", interrupted)
    assert main(["report", str(folder), "--out", str(tmp_path / "r.html")]) == 130
    assert list(tmp_path.iterdir()) == []
    assert "interrupted" in capsys.readouterr().err


@pytest.mark.slow
def test_the_report_of_waterberry_is_small_and_true(tmp_path: Path) -> None:
    folder = flown(tmp_path / "w", farm="waterberry", planner="random-waypoint", budget="8min")
    result = load_result(folder)
    write_report(tmp_path / "w.html", [result], logs=[folder / "flight.tlog"], progress=silent)
    assert (tmp_path / "w.html").stat().st_size < MOST_BYTES
    (held,) = SinglePage(tmp_path / "w.html").held("recording")
    assert held["run"]["raster"]["cells"] == 6
    assert len(held["readings"]["time_s"]) == len(result.observations)
    check_layers(held, result)
