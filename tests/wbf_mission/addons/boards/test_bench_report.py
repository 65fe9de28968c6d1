"""The report of a benchmark."""

from array import array

import numpy as np
import pytest
from bench_rows import made_row
from bench_rows import rows as rows_of
from PIL import Image

from wbf_mission.addons.base.intervals import Interval
from wbf_mission.addons.base.standings import scored, standing_table, standings
from wbf_mission.addons.boards.report import WHOLE, by_fixed, report_page
from wbf_mission.bench.requests import Asked, AskedFor, Card


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
    failed = {"error": "it | failed & fell", "score": None, "final_score": None}
    return [*good, *(made_row("<b>", seed, [-2.0], **failed) for seed in range(6))]


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
    assert "| greedy | - | 33.0 | 30.0 | +10.00% | 10.00% | 100.0 | - |" in markdown
    assert "| planner, estimator | wall | CPU | plan | flight |" in markdown
    assert "| greedy, gp | 2.000 | 1.000 | 0.500 | 1.500 |" in markdown
    with Image.open(tmp_path / "report" / files[0]) as picture:
        assert picture.width > 500
        assert len(picture.convert("RGB").getcolors(1_000_000)) > 50


def test_policies_are_held_to_what_they_chose_last_and_their_budget(tmp_path):
    used = {"decisions": 7, "budget": "36 s", "battery_used": 0.25}
    markdown, _ = markdown_of([made_row("greedy", 0, [-1.0], **used)], tmp_path)
    assert "| greedy | 36 s | 33.0 | 30.0 | +10.00% | 10.00% | 100.0 | 25.0% |" in markdown
    # Old rows of policies tell what their first path was to take.
    markdown, _ = markdown_of([made_row("greedy", 0, [-1.0], decisions=7)], tmp_path)
    assert "Planned and flown" not in markdown


def test_a_report_says_which_losses_are_larger_with_policies(tmp_path):
    def made(planner, ccr, decisions):
        ends = {"tylcv": 0.5 * ccr, "ccr": ccr}
        history = {name: array("d", [one]) for name, one in ends.items()}
        return [
            made_row(planner, seed, [-ccr], losses=ends, history=history, decisions=decisions)
            for seed in range(8)
        ]

    markdown, _ = markdown_of([*made("rows", 1.0, 1), *made("greedy", 1.7, 9)], tmp_path)
    assert "8 environments count (seeds 0..7)." in markdown
    assert "Events in fewer than 31 % of environments may be missing from these 8" in markdown
    assert (
        "### Losses divided by those of the best fixed planner of each column, over the run (below"
        in markdown
    )
    assert "ccr with greedy, gp (1.70 times rows)" in markdown
    assert "| greedy, gp | 1.70 | 1.70 | 1.70 |" in markdown
    assert "| the best fixed planner, gp | rows | rows | rows |" in markdown
    assert "| planner, estimator | tylcv, run | tylcv, end | ccr, run | ccr, end |" in markdown


def test_what_is_near_0_is_told_apart(tmp_path):
    rows = [
        made_row(planner, seed, [score * (1.0 + 0.01 * seed)], losses={"soil": -score})
        for planner, score in (("greedy", -6.1e-6), ("spiral", -8.0e-4), ("rows", -0.24))
        for seed in range(2)
    ]
    markdown, _ = markdown_of(rows, tmp_path)
    assert "| greedy, gp | -6.1e-6 | -6.5e-6 to -5.7e-6 | " in markdown
    assert "| greedy, gp | 6.1e-6 |" in markdown.replace(" - |", "")
    assert "| spiral, gp | -0.00080 | " in markdown
    assert "| rows, gp | -0.2412 | " in markdown
    assert "0.0000 " not in markdown.split("### Behind")[0]


def test_a_report_can_be_repeated_from(tmp_path):
    kept = {
        "versions": {"wbf-mission": "0.1.0", "commit": "4622a3d6f0", "python": "3.11", "numpy": "2.0"},
        "hardware": {"processor": "Some CPU", "cores": "2", "memory_gb": "8.0", "system": "Linux"},
        "codes": {"code": "c0de", "scenario": "5ce9a210", "planner": "91a7"},
        "objects": {"planner": "UCB(beta=9.0)"},
    }
    rows = [made_row("UCB", seed, [-1.0], **kept) for seed in range(2)]
    card = Card("WBF/Some-v1", "A test.", "5ce9a210", "a farm", "at the end", {"budget": "40steps"})
    asked = AskedFor([Asked("2026-01-02", "wbf-mission bench run a.toml", "seeds = 2\n# ```")], [card])
    page = report_page(rows, tmp_path, title="x", asked=asked)
    page.write(tmp_path / "report.md")
    markdown = (tmp_path / "report.md").read_text()
    assert "```text\nwbf-mission bench run a.toml\n```" in markdown
    assert "``````toml\nseeds = 2\n# ```\n``````" in markdown
    assert "| budget | 40steps |" in markdown
    assert "| wbf-mission | 0.1.0 | 4622a3d6 | c0de | python 3.11, numpy 2.0 | 2 |" in markdown
    assert "| planner UCB | - | - | 91a7 | UCB(beta=9.0) | 2 |" in markdown
    assert "| Some CPU | 2 | 8.0 | Linux | 2 | 4.0 | 2.0 |" in markdown


def test_only_failures_make_a_report_without_pictures(tmp_path):
    failed = made_row("a", 0, [-1.0], error="no", score=None, final_score=None)
    markdown, files = markdown_of([failed], tmp_path)
    assert files == ["report.md"]
    assert "Runs that failed" in markdown


def test_costs_stand_with_their_scenario_and_the_cheapest_comes_first(tmp_path):
    rows = [
        made_row("slow", 0, [-1.0], scenario="A", cpu_time_s=9.0, timings_s={"plan": 0.1, "decide": 8.0}),
        made_row("slow", 1, [-1.0], scenario="A", cpu_time_s=7.0, timings_s={"plan": 0.3, "decide": 6.0}),
        *(
            made_row("quick", seed, [-1.0], scenario="A", cpu_time_s=0.5, timings_s={"plan": 0.2})
            for seed in (0, 1)
        ),
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


def test_what_was_stated_is_told_by_field_with_intervals_over_environments(tmp_path):
    rows = [
        made_row(
            "spiral", seed, [-1.0], losses={"ccr": 0.1, "soil_2": 0.2}, calibration={"ccr_sick_held": held}
        )
        for seed, held in enumerate((0.8, 0.9, 1.0))
    ]
    rows += [made_row("greedy", seed, [-1.0]) for seed in range(3)]
    markdown, _ = markdown_of(rows, tmp_path)
    table = markdown.split("### How sure, how right")[1].split("###")[0]
    line = next(line for line in table.splitlines() if line.startswith("| spiral"))
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    assert cells[1] == "ccr"
    assert cells[2:5] == ["-"] * 3
    assert cells[5] == "0.9000 (0.6516 to 1.1484)"
    assert "soil_2" not in table
    assert "greedy" not in table


def test_losses_are_divided_by_those_of_the_fixed_planner_that_is_best_in_each():
    def made(planner, tylcv, ccr, decisions):
        of = {"tylcv": array("d", [tylcv]), "ccr": array("d", [ccr])}
        return rows_of(planner, [-tylcv - ccr] * 8, decisions=decisions, history=of)

    (group,) = scored([*made("policy", 1.0, 3.0, 9), *made("one", 2.0, 4.0, 1), *made("two", 8.0, 1.0, 1)])
    policy, one, two = by_fixed(group, over_run=True)
    assert [each.planner for each in (policy, one, two)] == ["policy", "one", "two"]
    assert [each.fixed for each in (policy, one, two)] == [False, True, True]
    assert policy.best == {WHOLE: "one", "tylcv": "one", "ccr": "two"}
    assert policy.ratios == {
        WHOLE: Interval(4 / 6, 4 / 6, 4 / 6),
        "tylcv": Interval(0.5, 0.5, 0.5),
        "ccr": Interval(3.0, 3.0, 3.0),
    }
    (only,) = scored(made("policy", 1.0, 3.0, 9))
    assert by_fixed(only, over_run=False) == []


def test_what_was_run_has_a_line_for_each_digest(tmp_path):
    build = {"wbf-mission": "0.1.0", "commit": "4622a3d6f0aa"}
    kept = [(build, "c0de" * 6), (build, "c0de" * 6), (build | {"commit": "5d01c2b3e4bb"}, "d1" * 12)]
    rows = [
        made_row("a", seed, [-1.0], versions=versions, codes={"code": code})
        for seed, (versions, code) in enumerate(kept)
    ]
    table = report_page(rows, tmp_path, title="x").sections[-1].tables[0]
    assert [line for line in table.rows if line[0] == "wbf-mission"] == [
        ("wbf-mission", "0.1.0", "4622a3d6", "c0dec0dec0de", "", "2"),
        ("wbf-mission", "0.1.0", "5d01c2b3", "d1d1d1d1d1d1", "", "1"),
    ]
