"""The pages of a benchmark in a browser: light, dark and narrow."""

import io
import shutil
from types import SimpleNamespace

import numpy as np
import pytest
from bench_rows import made_row
from PIL import Image

from wbf_mission.addons.base.intervals import score_text
from wbf_mission.addons.web.bench_page import write_bench_page
from wbf_mission.cli.app import main
from wbf_mission.cli.command import provided

ASKED = {
    "page": "document.documentElement.scrollWidth",
    "window": "document.documentElement.clientWidth",
    "pictures": "[...document.images].map(one => one.complete && one.naturalWidth > 0)",
    "tables": "document.querySelectorAll('tbody tr').length",
}
# The parts of names, up to a sign at which they may break, that stand in more than one line.
BROKEN = r"""() => {
    const found = [];
    for (const cell of document.querySelectorAll("#standings td.text")) {
        const walk = document.createTreeWalker(cell, NodeFilter.SHOW_TEXT);
        while (walk.nextNode()) {
            for (const part of walk.currentNode.data.matchAll(/[^\s\/:,=-]+[\/:,=-]*/g)) {
                const range = document.createRange();
                range.setStart(walk.currentNode, part.index);
                range.setEnd(walk.currentNode, part.index + part[0].length);
                if (new Set([...range.getClientRects()].map(one => one.top)).size > 1) found.push(part[0]);
            }
        }
    }
    return found;
}"""


def look(browser, file, *, width, dark):
    """Open a file; return what the browser finds wrong, its picture as PNG, and what is `ASKED` of it."""
    page = browser.new_page(
        viewport={"width": width, "height": 800}, color_scheme="dark" if dark else "light"
    )
    errors = []
    page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("requestfailed", lambda request: errors.append(request.url))
    page.goto(file.as_uri())
    seen = SimpleNamespace(
        errors=errors,
        png=page.screenshot(),
        values={name: page.evaluate(text) for name, text in ASKED.items()},
    )
    page.close()
    return seen


def row(planner, seed, draw, **given):
    values = {
        "scenario": "WBF/Miniberry-30-Sweep-v1",
        "estimator": "gp:learn_from=model,length_scale=4.0",
        "losses": {"tylcv": 0.2, "ccr": 0.3, "soil": 0.1},
        "timings_s": {"plan": 0.5, "flight": 1.0, "decide": 0.2, "estimate and score": 0.3},
    }
    return made_row(planner, seed, sorted(draw.uniform(-2.0, -0.1, 12).tolist()), **{**values, **given})


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    draw = np.random.default_rng(4)
    planners = ["greedy", "rolling-horizon:horizon=4,least_weight=0.35", "spiral", "<b>lawnmower</b>"]
    rows = [row(planner, seed, draw) for planner in planners for seed in range(6)]
    failed = row("random-waypoint", 0, draw, error="x" * 300, score=None, final_score=None)
    return written([*rows, failed], tmp_path_factory.mktemp("report"))


def written(rows, folder):
    """Write the page of rows, without its pictures beside it."""
    page = provided("bench.report")(rows, folder / "pictures", title=f"Benchmark of {len(rows)} runs")
    write_bench_page(folder / "report.html", page, folder / "pictures", rows)
    shutil.rmtree(folder / "pictures")
    return folder / "report.html"


@pytest.fixture(scope="module")
def paper(tmp_path_factory):
    out = tmp_path_factory.mktemp("paper")
    spec = ("--scenarios", "WBF/Miniberry-10-v1", "--planners", "spiral,lawnmower")
    spec += ("--estimators", "point", "--seeds", "2", "--only", "comparison")
    assert main(["bench", "paper", *spec, "--out", str(out), "--quiet"]) == 0
    return out / "paper.html"


def light_of(seen):
    """How bright the corner of a page is, from 0 to 255."""
    with Image.open(io.BytesIO(seen.png)) as picture:
        return np.asarray(picture.convert("L"))[:3, :3].mean()


@pytest.mark.parametrize(("name", "width", "dark"), [("report", 1200, False), ("paper", 400, True)])
def test_a_page_is_whole_and_no_wider_than_its_window(name, width, dark, browser, request):
    page = request.getfixturevalue(name)
    seen = look(browser, page, width=width, dark=dark)
    assert seen.errors == []
    assert width - 20 < seen.values["window"] <= width  # beside its scroll bar
    assert seen.values["page"] <= seen.values["window"]
    assert seen.values["pictures"] == [True] * {"report": 1, "paper": 2}[name]
    assert seen.values["tables"] > 4
    assert light_of(seen) < 60 if dark else light_of(seen) > 200


def test_names_break_at_their_signs_only_and_no_table_scrolls(browser, tmp_path):
    draw = np.random.default_rng(5)
    planners = ["adaptive-lawnmower:min_spacing_m=0.9144", "lawnmower:direction=1.5707963267948966", "greedy"]
    estimators = ["adaptive-disk", "epidemic"]
    rows = [
        row(planner, seed, draw, estimator=estimator)
        for planner in planners
        for estimator in estimators
        for seed in range(8)
    ]
    page = browser.new_page(viewport={"width": 1200, "height": 800})
    page.goto(written(rows, tmp_path).as_uri())
    names = page.locator("#standings td:first-child").all_text_contents()
    assert names == ["WBF/Miniberry-30-Sweep-v1"] * 6
    assert page.evaluate("document.querySelector('#standings td').getBoundingClientRect().height") > 40
    assert page.evaluate(BROKEN) == []
    wide = "[...document.querySelectorAll('.wide')].filter(one => one.scrollWidth > one.clientWidth)"
    assert page.evaluate(f"{wide}.map(one => one.ariaLabel)") == []
    page.close()


def test_small_scores_of_seeds_are_told_apart(browser, tmp_path):
    scores = [-0.12345, -0.00081, -6.1e-6, -3.8e-6, 0.0]
    rows = [made_row("greedy", seed, [score], losses={"soil": -score}) for seed, score in enumerate(scores)]
    page = browser.new_page()
    page.goto(written(rows, tmp_path).as_uri())
    page.locator(".opener").click()
    told = page.locator(".seeds td:nth-child(2)").all_text_contents()
    page.close()
    assert told == ["-0.1235", "-0.00081", "-6.1e-6", "-3.8e-6", "0.0000"]
    assert told == [score_text(one) for one in scores]
