"""The figures of the paper."""

import base64
import json
from array import array

import msgspec
import numpy as np
import pytest
from PIL import Image

from wbf_mission.addons.paper import cost, make, shown
from wbf_mission.addons.paper.comparison import lead_table, pair_table
from wbf_mission.addons.paper.cost import kept_costs, measured_costs, plot_costs
from wbf_mission.addons.paper.dynamics import DAYS, Dynamics
from wbf_mission.addons.paper.shown import ShownRun
from wbf_mission.bench import engine
from wbf_mission.bench.benchmark import BenchmarkInterrupted
from wbf_mission.bench.rows import BenchRow, read_rows
from wbf_mission.cli.app import main
from wbf_mission.results.storage import ResultError
from wbf_mission.scenario import load_scenario

SMALL = ("--scenarios", "WBF/Miniberry-10-v1", "--planners", "spiral,lawnmower")
SMALL += ("--estimators", "adaptive-disk,point", "--seeds", "2")
COMMAND = ("bench", "paper", *SMALL, "--only", "geometry,dynamics,comparison")
PICTURES = ["geometry", "dynamics", "comparison-1", "comparison-2", "comparison-scores"]


def colours(path):
    with Image.open(path) as picture:
        assert min(picture.size) > 500
        return len(picture.convert("RGB").getcolors(10_000_000))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("paper") / "figures"
    assert main([*COMMAND, "--out", str(out), "--quiet"]) == 0
    return out


def test_the_pictures_show_something(folder):
    for name in PICTURES:
        assert colours(folder / f"{name}.png") > 100
    markdown, page = ((folder / f"paper.{suffix}").read_text() for suffix in ("md", "html"))
    assert all(f"]({name}.png)" in markdown for name in PICTURES)
    pictures = [base64.b64encode((folder / f"{name}.png").read_bytes()).decode() for name in PICTURES]
    assert all(f'<img src="data:image/png;base64,{picture}"' in page for picture in pictures)
    assert "Leading planner, and its lead" in markdown
    assert "Leading planner, and its lead" in page


def test_a_second_call_only_draws(folder, monkeypatch, capsys):
    def never(*_given, **_more):
        raise AssertionError("it is flown again")

    monkeypatch.setattr(engine, "fly_run", never)
    monkeypatch.setattr(shown, "fly", never)
    before = {name: (folder / f"{name}.png").read_bytes() for name in PICTURES}
    for name in PICTURES:
        (folder / f"{name}.png").unlink()
    assert main([*COMMAND, "--out", str(folder), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told == {
        "pages": [str(folder / "paper.md"), str(folder / "paper.html")],
        "pictures": [str(folder / f"{name}.png") for name in PICTURES],
        "runs": 8,
    }
    assert {name: (folder / f"{name}.png").read_bytes() for name in PICTURES} == before


def test_maps_are_of_the_very_runs_of_the_rows(folder):
    rows = {row.key: row for row in read_rows(folder / "runs")}
    files = sorted((folder / "shown").iterdir())
    assert len(files) == 4
    for file in files:
        row, run = rows[file.stem], ShownRun.load(file)
        assert row.seed == 0
        legs_m = np.diff(run.path_m, axis=0)
        assert np.hypot(*legs_m.T).sum() == pytest.approx(row.path_length_m, rel=1e-4)
        assert run.truth.shape == run.estimate.shape == (3, 10, 10)
        sick = (run.truth[0, :, 5:] < 1.0).mean()
        assert 0.0 < sick < 1.0


def test_pictures_for_print(tmp_path, capsys):
    command = ("bench", "paper", "--only", "geometry", "--out", str(tmp_path), "--json")
    assert main([*command, "--format", "pdf,png"]) == 0
    files = [tmp_path / "geometry.pdf", tmp_path / "geometry.png"]
    assert json.loads(capsys.readouterr().out)["pictures"] == [str(one) for one in files]
    assert files[0].read_bytes().startswith(b"%PDF")
    assert "](geometry.png)" in (tmp_path / "paper.md").read_text()


def test_the_days_of_other_farms_are_drawn(tmp_path, capsys):
    command = ("bench", "paper", "--only", "dynamics", "--seeds", "1", "--out", str(tmp_path), "--json")
    assert main([*command, "--dynamics-farms", "Miniberry-10"]) == 0
    assert json.loads(capsys.readouterr().out)["pictures"] == [str(tmp_path / "dynamics-miniberry-10.png")]
    assert "15 days of miniberry-10" in (tmp_path / "paper.md").read_text()
    assert main([*command, "--dynamics-farms", "miniberry-7"]) == 2
    assert "miniberry-7" in capsys.readouterr().err


def test_a_damaged_map_is_named(folder, tmp_path):
    file = tmp_path / "x.npz"
    np.savez(file, path_m=np.array([None], dtype=object))
    with pytest.raises(ResultError, match=r"x\.npz: holds no run"):
        ShownRun.load(file)
    np.savez(
        file, path_m=np.zeros((4, 3)), truth=np.ones((1, 2, 2)), estimate=np.ones((1, 2, 2)), axis_max=0.0
    )
    with pytest.raises(ResultError, match="wrong shapes"):
        ShownRun.load(file)
    file.write_bytes(next((folder / "shown").iterdir()).read_bytes()[:-40])
    with pytest.raises(ResultError, match="remove it"):
        ShownRun.load(file)


def test_the_days_are_those_of_the_environment():
    dynamics = Dynamics(load_scenario("WBF/Miniberry-30-v1"), [0, 1, 2])
    assert dynamics.sick.shape == (3, len(DAYS), 3)
    diseases = dynamics.sick[:, :, :2]
    assert (np.diff(diseases, axis=1) >= 0.0).all()  # nobody recovers
    assert (dynamics.lost <= dynamics.sick).all()
    assert 0.0 < diseases[:, 0].min() < diseases[:, -1].max() < 1.0
    assert not np.array_equal(dynamics.sick[0], dynamics.sick[1])
    truth = dynamics.maps[6][0]
    assert (truth[:, 15:] < 0.75).mean() == pytest.approx(dynamics.sick[0, 5, 0])


def row(planner, seed, scores):
    values = {"key": f"{planner}{seed}", "scenario": "s", "planner": planner, "estimator": "gp", "seed": seed}
    times_s = array("d", [10.0 * (k + 1) for k in range(len(scores))])
    return BenchRow(**values, scores=array("d", scores), times_s=times_s)


def test_who_leads_is_told_in_pairs():
    rows = [row("a", seed, [-1.0 - seed, -0.4 - seed]) for seed in range(6)]
    rows += [row("b", seed, [-0.5 - seed, -0.6 - seed]) for seed in range(6)]
    table = lead_table([*rows, row("a", 9, [-0.1, -0.1])])
    assert table.header == ("estimator, time", "a", "b")
    # The environments differ by far more than the planners do, which drops out in pairs.
    assert table.rows[0] == ("gp, at 2 s", "0.500 (0.500 to 0.500)", "leads")
    assert table.rows[-1] == ("gp, at 20 s", "leads", "0.200 (0.200 to 0.200)")


def test_planners_are_compared_over_parts_of_the_time():
    # Scores every 10 s up to 100 s: the first is ahead by 1 in the first half, then as good.
    rows = [row("spiral", seed, [-1.0 - seed] * 10) for seed in range(3)]
    rows += [row("lawnmower", seed, [-2.0 - seed] * 5 + [-1.0 - seed] * 5) for seed in range(3)]
    (line,) = pair_table(rows).rows
    assert line[0] == "gp: spiral - lawnmower"
    assert line[1].startswith("1.000 (1.000 to 1.000)")
    # At 60 s, after the half, lawnmower is as good.
    assert line[2].startswith("1.000") and float(line[3].split()[0]) == pytest.approx(0.2, abs=0.01)
    assert line[4].startswith("0.000 (0.000 to 0.000)")
    assert pair_table(rows[:3]).rows == ()


def test_costs_are_measured_once(tmp_path, monkeypatch):
    file = tmp_path / "cost.json"
    costs = measured_costs(file, farms=["miniberry-10"], numbers=(1, 30, 1000))
    at = {(one.method, one.observations): one.cpu_s for one in costs}
    assert set(at) >= {("adaptive-disk", 1000), ("gp", 1000), ("gp-sklearn", 30), ("score", 0)}
    assert at["gp-sklearn", 1000] is None
    assert all(one.cpu_s is None or one.cpu_s >= 0.0 for one in costs)
    assert all(one.cells == 100 for one in costs)
    monkeypatch.setattr(cost, "_measured", None)
    assert measured_costs(file, farms=["miniberry-10"]) == costs == kept_costs(file)
    plot_costs(costs, [tmp_path / "cost.png"])
    assert colours(tmp_path / "cost.png") > 100


def test_a_method_that_takes_too_long_is_not_asked_for_more(tmp_path):
    costs = measured_costs(tmp_path / "c.json", farms=["miniberry-10"], numbers=(1, 3), limit_s=0.0)
    assert {(one.method, one.observations, one.cpu_s) for one in costs if one.method != "score"} == {
        (method, 1, None) for method in cost.ESTIMATORS
    }


def test_costs_that_are_none_are_named(tmp_path):
    file = tmp_path / "cost.json"
    file.write_text("[")
    with pytest.raises(ResultError, match=r"cost\.json: is not valid JSON"):
        kept_costs(file)
    file.write_bytes(msgspec.json.encode([{"method": "gp", "farm": 3}]))
    with pytest.raises(ResultError, match="holds no costs"):
        kept_costs(file)


@pytest.mark.parametrize(("unlucky", "code"), [("point", 1), ("", 2)])
def test_estimators_that_fail_with_each_planner_have_no_picture(unlucky, code, tmp_path, capsys, monkeypatch):
    real = engine.fly_run

    def some(run):
        return engine.failed_row(run, "no luck") if unlucky in run.estimator else real(run)

    monkeypatch.setattr(engine, "fly_run", some)
    command = ("bench", "paper", *SMALL, "--planners", "spiral", "--seeds", "1", "--only", "comparison")
    assert main([*command, "--out", str(tmp_path)]) == code
    assert "no luck" in capsys.readouterr().err
    assert (tmp_path / "comparison-1.png").exists() == (code == 1)
    assert not (tmp_path / "comparison-2.png").exists()


def test_ctrl_c_says_how_to_go_on(tmp_path, capsys, monkeypatch):
    def stopped(*_given, **_more):
        raise BenchmarkInterrupted([], 8)

    monkeypatch.setattr(make, "benchmark", stopped)
    assert main([*COMMAND, "--only", "comparison", "--out", str(tmp_path)]) == 130
    assert (
        "interrupted after 0 of 8 runs; repeat the command to fly the other runs" in capsys.readouterr().err
    )


@pytest.mark.parametrize(
    ("given", "cause"),
    [
        (
            ["--only", "geometrie"],
            "unknown figure 'geometrie' (is 'geometry' meant?): choose geometry, dynamics",
        ),
        (["--format", "gif"], "unknown format 'gif': choose png, pdf"),
        (["--scenarios", "WBF/Miniberry-10-v1,WBF/Miniberry-30-v1"], "2 scenarios"),
        (["--scenarios", "WBF/Miniberry-11-v1"], "unknown scenario"),
        (["--cost-farms", "nowhere"], "nowhere"),
        (["--jobs", "0"], "--jobs 0"),
    ],
)
def test_what_cannot_be_is_refused_in_a_line(given, cause, tmp_path, capsys):
    out = tmp_path / "figures"
    assert main(["bench", "paper", "--out", str(out), *given]) == 2
    told = capsys.readouterr()
    assert cause in told.err
    assert told.err.count("\n") == 1
    assert told.out == ""
    assert not out.exists()


def test_the_paper_has_forty_runs_and_all_figures(tmp_path, monkeypatch):
    asked = []

    def made(spec, out, **given):
        asked.append((len(spec), given["figures"], given["cost_farms"]))
        raise BenchmarkInterrupted([], len(spec))

    monkeypatch.setattr(make, "make_paper", made)
    assert main(["bench", "paper", "--out", str(tmp_path), "--quiet"]) == 130
    assert asked == [(40, list(make.FIGURES), list(cost.FARMS))]


@pytest.mark.slow
def test_the_whole_paper(tmp_path, monkeypatch):
    # How long methods take is told by few numbers of observations, too.
    monkeypatch.setitem(measured_costs.__kwdefaults__, "numbers", (1, 30, 300))
    monkeypatch.setattr(cost, "_MOST_TIMES", 1)
    assert main(["bench", "paper", "--seeds", "2", "--out", str(tmp_path), "--quiet"]) == 0
    for name in [*PICTURES, "cost"]:
        assert colours(tmp_path / f"{name}.png") > 100
    assert len(read_rows(tmp_path / "runs")) == 16
