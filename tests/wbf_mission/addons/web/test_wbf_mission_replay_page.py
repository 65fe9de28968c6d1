"""The page of a run of a benchmark that is flown again: map, candidates and outcome of each decision."""

from __future__ import annotations

import base64
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_page import page_at
from playwright.sync_api import Browser, expect
from single_page import SinglePage

from mission.policies.decision import AcquisitionMap
from wbf_mission.addons.boards.replay import Replay, replay, run_of
from wbf_mission.addons.web import schema
from wbf_mission.addons.web.report import MOST_BYTES, RunPage, thinned_moments, write_report
from wbf_mission.bench.rows import read_rows
from wbf_mission.cli.app import main
from wbf_mission.events import EventStream


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("bench") / "results"
    wanted = ["--scenarios", "WBF/Miniberry-10-v1", "--planners", "greedy,market", "--estimators", "point"]
    assert main(["bench", "run", *wanted, "--seeds", "1", "--out", str(out), "--quiet"]) == 0
    return out


@pytest.fixture(scope="module")
def flown(folder: Path) -> tuple[Replay, RunPage]:
    row = next(one for one in read_rows(folder) if one.planner == "greedy")
    events = EventStream()
    layers = RunPage(events, len(row.times_s))
    return replay(row, run_of(row), events=events), layers


@pytest.fixture(scope="module")
def files(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    out = tmp_path_factory.mktemp("replays")
    for row in read_rows(folder):
        assert main(["bench", "replay", str(folder), row.key, "--out", str(out), "--format", "html"]) == 0
    return {row.planner: out / f"{row.key[:8]}.html" for row in read_rows(folder)}


def acquisitions_in(held: dict[str, Any]) -> list[tuple[float, np.ndarray]]:
    """Return the acquisition map of each moment that tells one, with its time; 0 where there is nothing."""
    found = []
    shape = held["run"]["raster"]["height"], held["run"]["raster"]["width"]
    for moment in held["moments"]:
        for tile in moment["tiles"]:
            if tile["layer"] == "acquisition":
                pixels = np.frombuffer(zlib.decompress(base64.b64decode(tile["data"])), np.uint8).reshape(
                    shape
                )
                values = np.where(pixels == 255, 0.0, pixels / 254.0 * moment["scales"]["acquisition"])
                found.append((moment["time_s"], values.T))
    return found


def test_the_page_holds_the_map_of_each_decision(
    flown: tuple[Replay, RunPage], files: dict[str, Path]
) -> None:
    again, _ = flown
    assert again.equal and again.causes == ()
    page = SinglePage(files["greedy"])
    page.check()
    (held,) = page.held("recording")
    maps = [one for one in again.acquisitions if isinstance(one, AcquisitionMap)]
    assert len(maps) == len(held["decisions"]) > 3
    told = acquisitions_in(held)
    assert len(told) == len(maps)
    for (time_s, values), one, decision in zip(told, maps, held["decisions"], strict=True):
        assert time_s == pytest.approx(decision["time_s"], abs=0.01)
        step = max(moment["scales"].get("acquisition", 0.0) for moment in held["moments"]) / 254.0
        np.testing.assert_allclose(values, one.values, atol=0.51 * step)
    assert any(len(one["candidates"]) > 1 for one in held["decisions"])
    assert files["greedy"].stat().st_size < MOST_BYTES


def test_its_layers_are_those_of_a_saved_result(flown: tuple[Replay, RunPage], tmp_path: Path) -> None:
    """The estimates of the flight are those that are made again of its observations."""
    again, layers = flown
    write_report(tmp_path / "live.html", [again.result], layers=layers)
    write_report(tmp_path / "saved.html", [again.result])
    ends = []
    for name in ("live", "saved"):
        (held,) = SinglePage(tmp_path / f"{name}.html").held("recording")
        tiles: dict[str, str] = {}
        for moment in held["moments"]:
            tiles |= {
                tile["layer"]: tile["data"] for tile in moment["tiles"] if tile["layer"] != "acquisition"
            }
        ends.append((tiles, held["scores"], held["readings"], held["states"]))
    assert ends[0] == ends[1]


def test_light_moments_tell_the_acquisition_alone() -> None:
    def moment(time_s: float, **tiles: str) -> schema.Moment:
        named = {"value": "value/tylcv", "acquisition": "acquisition"}
        return schema.Moment(time_s, 1, 0, [schema.Tile(named[k], 0, 0, one) for k, one in tiles.items()], {})

    moments = [
        moment(1.0, value="a"),
        moment(2.0, value="b", acquisition="A"),
        moment(3.0, value="c"),
        moment(4.0, value="d", acquisition="B"),
    ]
    light = [False, True, False, True]

    def told(every: int, which: list[bool]) -> list[tuple[float, list[str]]]:
        kept = thinned_moments(moments, which, every)
        return [(one.time_s, [tile.data for tile in one.tiles]) for one in kept]

    assert told(1, [False] * 4) == [(1.0, ["a"]), (2.0, ["b", "A"]), (3.0, ["c"]), (4.0, ["d", "B"])]
    # What is left at the end comes with the last one.
    assert told(1, light) == [(1.0, ["a"]), (2.0, ["A"]), (3.0, ["c"]), (4.0, ["B", "d"])]
    assert told(2, [False] * 4) == [(2.0, ["b", "A"]), (4.0, ["d", "B"])]


def test_what_is_too_large_is_reduced_and_said(flown: tuple[Replay, RunPage], tmp_path: Path) -> None:
    again, layers = flown
    told = {"layers": layers, "told": ["equal"]}
    whole = write_report(tmp_path / "whole.html", [again.result], **told)
    assert whole.notes == ("equal",)
    light = write_report(tmp_path / "light.html", [again.result], most_bytes=whole.size, **told)
    assert light.size < whole.size
    assert light.moments[0] <= whole.moments[0]
    assert light.notes[:2] == (
        "equal",
        "Between about 40 of the scored times, only acquisition maps are kept",
    )
    (held,) = SinglePage(tmp_path / "light.html").held("recording")
    assert 0 < len(acquisitions_in(held)) <= len(layers.decided_s)


def test_one_goes_from_decision_to_decision_and_sees_what_came_of_it(
    browser: Browser, files: dict[str, Path]
) -> None:
    (held,) = SinglePage(files["greedy"]).held("recording")
    second, third = held["decisions"][1:3]
    with page_at(browser, files["greedy"].as_uri()) as page:
        page.locator("#app").scroll_into_view_if_needed()
        expect(page.locator(".decided > .small")).to_be_empty()
        # A time that is given before the recording is read is lost.
        expect(page.locator("ol.decisions details")).to_have_count(len(held["decisions"]))
        # Both at once: a button that is pressed before the page shows the new time goes on from that time.
        page.get_by_label("Time of the run").evaluate(
            """(slider, time_s) => {
                slider.value = time_s;
                slider.dispatchEvent(new Event("input"));
                document.querySelector(".steps button:last-child").click();
            }""",
            f"{second['time_s'] + 0.1:.1f}",
        )
        opened = page.locator("ol.decisions details[open]")
        expect(opened).to_contain_text("Decision 3,")
        seen = [time_s for time_s in held["readings"]["time_s"] if time_s > third["time_s"]]
        until = [time_s for time_s in seen if time_s <= held["decisions"][3]["time_s"]]
        expect(opened.locator(".came")).to_contain_text(f"Until the next decision: {len(until)} reading")
        times_s, scores = np.array(held["scores"]["time_s"]), held["scores"]["score"]
        before, after = (
            scores[np.searchsorted(times_s, one["time_s"], side="right") - 1]
            for one in (third, held["decisions"][3])
        )
        expect(opened.locator(".came")).to_contain_text(f"; score {before:.4f} to {after:.4f}")
        page.get_by_role("button", name="Previous").click()
        expect(opened).to_contain_text("Decision 2,")
        page.get_by_role("radio", name="Acquisition").check(force=True)
        expect(page.locator(".legend .title")).to_have_text("Acquisition")
        expect(page.locator(".legend .ends")).not_to_have_text("0.0000.0000.000")
        for _ in held["decisions"]:
            page.get_by_role("button", name="Next").click()
        expect(opened).to_contain_text(f"Decision {len(held['decisions'])},")
        expect(opened.locator(".came")).to_contain_text("Until the end:")


def test_where_there_is_no_map_the_page_says_so(browser: Browser, files: dict[str, Path]) -> None:
    words = " ".join(SinglePage(files["market"]).words)
    assert "market uses no acquisition map" in words
    assert "flown again: equal to the bit" in words
    with page_at(browser, files["market"].as_uri()) as page:
        expect(page.locator(".decided > .small")).to_contain_text(
            "No acquisition map is kept: see the summary."
        )
        expect(page.get_by_role("radio", name="Acquisition")).to_have_count(0)
