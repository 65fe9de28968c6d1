"""The page of a benchmark: sorted, filtered and opened by mouse and keyboard, and kept in its address."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from bench_rows import made_row
from live_page import page_at
from playwright.sync_api import Browser, Locator, Page, expect
from single_page import SinglePage

from wbf_mission.addons.base.standings import standings
from wbf_mission.bench.rows import BenchRow, BenchStore
from wbf_mission.cli.app import main

BAD = '<img src=x onerror="document.title=1">'
SCENARIOS = ("WBF/Miniberry-10-v1", "WBF/Miniberry-30-v1")
PLANNERS = ("greedy", "spiral", BAD)
SEEDS = 3
CALIBRATION = ("brier", "log_loss", "ece", "sick_held", "healthy_held", "held", "error")


@pytest.fixture(scope="module")
def rows() -> list[BenchRow]:
    draw = np.random.default_rng(7)
    made = [
        made_row(
            planner,
            seed,
            sorted(draw.uniform(-2.0, -0.1, 4).tolist()),
            key=f"{scenario}{planner}{estimator}{seed}",
            scenario=scenario,
            estimator=estimator,
            cpu_time_s=float(draw.uniform(1.0, 200.0)),
            calibration={f"tylcv_{key}": float(draw.uniform(0.0, 1.0)) for key in CALIBRATION},
        )
        for scenario in SCENARIOS
        for planner in PLANNERS
        for estimator in ("gp", "point")
        for seed in range(SEEDS)
    ]
    # What failed counts as the worst that it saw.
    return [*made, made_row("late", 0, [-2.5, -1.0], error="no | way", score=None, final_score=None)]


@pytest.fixture(scope="module")
def folder(rows: list[BenchRow], tmp_path_factory: pytest.TempPathFactory) -> Path:
    kept = tmp_path_factory.mktemp("bench") / "results"
    with BenchStore(kept) as store:
        for row in rows:
            store.add(row)
    return kept


@pytest.fixture(scope="module")
def file(folder: Path) -> Path:
    assert main(["report", str(folder), "--quiet"]) == 0
    return folder.with_name("results.html")


@pytest.fixture
def page(browser: Browser, file: Path) -> Iterator[Page]:
    with page_at(browser, file.as_uri(), drawn=False) as opened:
        yield opened


def column(page: Page, name: str) -> list[str]:
    """The texts of a column, of the rows that are seen."""
    names = page.locator("#standings thead th").all_inner_texts()
    number = [one.strip() for one in names].index(name) + 1
    cells = page.locator(f"#standings > tbody > tr:not(.detail):visible > td:nth-child({number})")
    return [text.strip() for text in cells.all_inner_texts()]


def heading(page: Page, name: str) -> Locator:
    return page.locator("#standings thead th").filter(has=page.get_by_role("button", name=name, exact=True))


def test_it_is_whole_in_itself_and_holds_the_standings(file: Path, rows: list[BenchRow]) -> None:
    page = SinglePage(file)
    page.check()
    assert page.tags.count("img") == len(SCENARIOS)
    found = standings(rows)
    held = page.held("seeds")
    assert len(held) == len(found)
    for one, seeds in zip(found, held, strict=True):
        assert len(seeds) == one.environments
        if seeds:
            assert np.mean([score for _, score, _, _, _ in seeds]) == pytest.approx(one.score.mean)
    assert [0, -2.5, -2.5, "no | way", "late0"] in [seed for seeds in held for seed in seeds]
    assert BAD in "".join(page.words)


def test_headings_sort_by_mouse_and_keyboard(page: Page) -> None:
    page.get_by_role("button", name="CPU, s").click()
    numbers = [float(one) for one in column(page, "CPU, s") if one != "-"]
    assert len(numbers) == 12
    assert numbers == sorted(numbers)
    assert column(page, "CPU, s")[-1] == "-"  # what is not known is last
    expect(heading(page, "CPU, s")).to_have_attribute("aria-sort", "ascending")
    heading(page, "CPU, s").get_by_role("button").focus()
    page.keyboard.press("Enter")
    assert [float(one) for one in column(page, "CPU, s") if one != "-"] == numbers[::-1]
    assert column(page, "CPU, s")[-1] == "-"
    expect(heading(page, "CPU, s")).to_have_attribute("aria-sort", "descending")
    heading(page, "estimator").get_by_role("button").focus()
    page.keyboard.press("Space")
    assert column(page, "estimator") == sorted(column(page, "estimator"))
    expect(page.locator("#standings th[aria-sort]")).to_have_count(1)


def test_filters_leave_what_fits_and_the_address_keeps_them(browser: Browser, page: Page) -> None:
    page.get_by_label("Scenario").select_option(SCENARIOS[1])
    page.get_by_label("Estimator").select_option("gp")
    page.get_by_label("Text").fill("GREE")
    page.get_by_role("button", name="rank").click()
    assert column(page, "planner or policy") == ["greedy"]
    expect(page.get_by_role("status")).to_have_text("1 of 13 rows")
    address = page.url
    with page_at(browser, address, drawn=False) as again:
        assert column(again, "planner or policy") == ["greedy"]
        expect(again.get_by_label("Scenario")).to_have_value(SCENARIOS[1])
        expect(heading(again, "rank")).to_have_attribute("aria-sort", "ascending")
        again.get_by_label("Text").fill("")
        again.get_by_label("Planner or policy").select_option(BAD)
        assert column(again, "planner or policy") == [BAD]
        again.get_by_label("Scenario").select_option("")
        assert (
            column(again, "scenario") == list(SCENARIOS) or column(again, "scenario") == list(SCENARIOS)[::-1]
        )
    page.evaluate("location.hash = '#scenario=nowhere&sort=99'")
    expect(page.get_by_role("status")).to_have_text("13 of 13 rows")


def test_a_row_opens_to_its_seeds(page: Page, rows: list[BenchRow]) -> None:
    page.get_by_label("Scenario").select_option(SCENARIOS[0])
    page.get_by_label("Estimator").select_option("point")
    opener = page.locator("#standings").get_by_role("button", name="spiral")
    opener.click()
    expect(opener).to_have_attribute("aria-expanded", "true")
    mine = [
        row for row in rows if (row.scenario, row.planner, row.estimator) == (SCENARIOS[0], "spiral", "point")
    ]
    told = [
        [cell.inner_text() for cell in row.locator("td").all()]
        for row in page.locator(".seeds tbody tr").all()
    ]
    assert told == [
        [str(row.seed), f"{row.score:.4f}", f"{row.final_score:.4f}", row.key[:8], ""] for row in mine
    ]
    dots = page.locator(".strip .own")
    expect(dots).to_have_count(SEEDS)
    places = [float(dot.get_attribute("cx") or "nan") for dot in dots.all()]
    assert np.argsort(places).tolist() == np.argsort([row.score for row in mine]).tolist()
    expect(page.locator(".strip .other")).to_have_count(5 * SEEDS)
    page.get_by_role("button", name="run", exact=True).first.click()
    assert (
        page.locator(".detail").evaluate("one => one.previousElementSibling.textContent").count("spiral") == 1
    )
    opener.click()
    expect(page.locator(".detail")).to_have_count(0)


@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (390, "dark")])
def test_all_can_use_it(browser: Browser, file: Path, width: int, scheme: str) -> None:
    size = {"width": width, "height": 800}
    options = {"viewport": size, "color_scheme": scheme, "bypass_csp": True}
    with page_at(browser, file.as_uri(), drawn=False, **options) as page:
        page.locator(".opener").first.click()
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        found = Axe().run(page).response["violations"]
        assert [(one["id"], [node["html"][:80] for node in one["nodes"]]) for one in found] == []


def test_the_commands_write_the_same_page(
    folder: Path, file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["bench", "report", str(folder), "--out", str(tmp_path)]) == 0
    assert (tmp_path / "report.html").read_bytes() == file.read_bytes()
    capsys.readouterr()
    assert main(["report", str(folder), str(folder), "--out", str(tmp_path / "x.html")]) == 2
    assert "a benchmark is shown alone" in capsys.readouterr().err
    assert main(["report", str(folder), "--out", str(tmp_path / "y.html"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["runs"] == 37
