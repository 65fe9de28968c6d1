"""The report of a benchmark."""

import numpy as np
import pytest
from bench_rows import made_row
from PIL import Image

from wbf_mission.bench.report import report_page, score_over_time, standing_table
from wbf_mission.bench.standings import standings


def markdown_of(rows, folder, title="x"):
    """Write the report of rows; return it, and the names of all files."""
    report_page(rows, folder, title=title).write(folder / "report.md")
    return (folder / "report.md").read_text(), sorted(one.name for one in folder.iterdir())


@pytest.fixture
def rows():
    draw = np.random.default_rng(1)
    good = [
        made_row(planner, seed, sorted(draw.uniform(-2.0, -0.1 - 0.5 * k, 3).tolist()))
        for k, planner in enumerate(["greedy", "spiral"])
        for seed in range(6)
    ]
    return [*good, made_row("<b>", 0, [-1.0], error="it | failed & fell", score=None, final_score=None)]


def test_the_score_over_time_holds_until_the_next_scored_time():
    times_s, scores = score_over_time([made_row("a", 0, [-3.0, -1.0]), made_row("a", 1, [-5.0, -4.0, -2.0])])
    assert (times_s[0], times_s[-1]) == (0.0, 30.0)
    one, two = scores
    assert set(one[times_s < 20.0]) == {-3.0}
    assert set(one[times_s >= 20.0]) == {-1.0}
    assert (two[0], two[-1]) == (-5.0, -2.0)


def test_the_files_say_what_the_standings_are(rows, tmp_path):
    markdown, files = markdown_of(rows, tmp_path / "report", title="My runs")
    assert files == ["WBF-Some-v1.png", "report.md"]
    assert markdown.startswith("# My runs\n")
    table = standing_table("", standings(rows))
    assert table.rows[0][0] == "greedy, gp"
    for line in table.rows:
        assert "| " + " | ".join(line).replace("<", "&lt;") + " |" in markdown
    behind = {one.planner: one.behind for one in standings(rows)}
    one, two = (
        np.mean([each.score for each in rows if each.planner == name]) for name in ("greedy", "spiral")
    )
    assert (behind["greedy"].mean, behind["spiral"].mean) == (0.0, pytest.approx(one - two))
    assert f"| spiral, gp | {behind['spiral'].mean:.4f} | " in markdown
    assert "it \\| failed & fell" in markdown
    assert "![Score over time](WBF-Some-v1.png)" in markdown
    assert "| greedy | 33.0 | 30.0 | +10.00% | 10.00% | 100.0 |" in markdown
    assert "| planner, estimator | wall | CPU | plan | flight |" in markdown
    assert "| greedy, gp | 2.000 | 1.000 | 0.500 | 1.500 |" in markdown
    with Image.open(tmp_path / "report" / files[0]) as picture:
        assert picture.width > 500
        assert len(picture.convert("RGB").getcolors(1_000_000)) > 50


def test_a_plan_that_was_changed_on_the_way_is_not_compared_with_its_prediction(tmp_path):
    markdown, _ = markdown_of([made_row("greedy", 0, [-1.0], decisions=7)], tmp_path)
    assert "Planned and flown" not in markdown


def test_only_failures_make_a_report_without_pictures(tmp_path):
    failed = made_row("a", 0, [-1.0], error="no", score=None, final_score=None)
    markdown, files = markdown_of([failed], tmp_path)
    assert files == ["report.md"]
    assert "Runs that failed" in markdown


def test_costs_stand_with_their_scenario_and_the_cheapest_comes_first(tmp_path):
    rows = [
        made_row("slow", 0, [-1.0], scenario="A", cpu_time_s=9.0, timings_s={"plan": 0.1, "decide": 8.0}),
        made_row("slow", 1, [-1.0], scenario="A", cpu_time_s=7.0, timings_s={"plan": 0.3, "decide": 6.0}),
        made_row("quick", 0, [-1.0], scenario="A", cpu_time_s=0.5, timings_s={"plan": 0.2}),
        made_row("quick", 0, [-1.0], scenario="B", cpu_time_s=0.75, timings_s={"estimate and score": 0.7}),
    ]
    markdown, _ = markdown_of(rows, tmp_path)
    first, second = markdown.split("## B\n")
    assert "| planner, estimator | wall | CPU | plan | decide |" in first
    quick, slow = (line for line in first.splitlines() if line.endswith((" 0.000 |", " 7.000 |")))
    assert quick == "| quick, gp | 2.000 | 0.500 | 0.200 | 0.000 |"
    assert slow == "| slow, gp | 2.000 | 8.000 | 0.200 | 7.000 |"
    assert "| planner, estimator | wall | CPU | estimate and score |" in second
    assert "| quick, gp | 2.000 | 0.750 | 0.700 |" in second
