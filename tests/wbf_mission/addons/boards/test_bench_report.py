"""The report of a benchmark."""

from array import array

import numpy as np
import pytest
from bench_rows import made_row
from PIL import Image

from wbf_mission.addons.base.standings import standing_table, standings
from wbf_mission.addons.boards.report import report_page
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
