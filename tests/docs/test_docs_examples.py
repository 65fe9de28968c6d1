"""The examples of the documentation do what they say: every ``wbf-mission`` line in a ``sh`` block runs."""

import ast
import dataclasses
import doctest
import re
import shlex
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from sim_vehicle.airframe.power_spec import BatterySpec, PowerSpec
from sim_vehicle.airframe.spec import PublishedEndurance
from wbf_mission.addons.animation import animation
from wbf_mission.addons.rovers.kind import RoverPowerSpec
from wbf_mission.addons.wings.kind import FixedWingAirframe, FixedWingPowerSpec
from wbf_mission.cli.app import main

Printed = Callable[..., str]
REPOSITORY = Path(__file__).parents[2]
PAGES = sorted(
    [
        REPOSITORY / "README.md",
        *(REPOSITORY / "docs").glob("*.md"),
        *(REPOSITORY / "docs" / "evidence").glob("*.md"),
    ]
)

PAGES_BY_NAME = {page.stem: page for page in PAGES}


def blocks(page: Path, language: str) -> list[str]:
    pattern = rf"^```{language}\n(.*?)^```"
    return re.findall(pattern, page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)


def commands(page: Path) -> list[str]:
    lines = [line for block in blocks(page, "sh") for line in block.splitlines()]
    return [line for line in lines if line.startswith("wbf-mission ")]


@pytest.fixture
def printed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Printed:
    """Run a command in an empty folder and return what it prints."""
    monkeypatch.chdir(tmp_path)

    def run(line: str, good: tuple[int, ...] = (0,)) -> str:
        code = main(shlex.split(line)[1:])
        told = capsys.readouterr()
        assert code in good, f"{line}\n{told.err}"
        return told.out

    return run


# Of what a page flies for minutes, or draws, a little is enough here.
FRAMES = 6
SHORTER = {
    "--estimator gp --day 4 --days 3": "--budget 100steps",
    "--policy greedy --budget 10min": "--budget 3min",
    "--planner lawnmower --budget 10min": "--budget 5min",
    "--planner spiral --budget 10min": "--budget 5min",
}


@pytest.mark.slow
@pytest.mark.parametrize(
    "page",
    # Those of the worked example are run by its own tests.
    [page for page in PAGES if commands(page) and page.stem != "field-to-map"],
    ids=lambda page: page.stem,
)
def test_the_commands_of_a_page_run(
    page: Path, tmp_path: Path, printed: Printed, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(animation._Animation.write.__kwdefaults__, "frames", FRAMES)
    shutil.copytree(REPOSITORY / "missions", tmp_path / "missions")
    shutil.copytree(REPOSITORY / "docs" / "examples", tmp_path / "docs" / "examples")
    for line in commands(page):
        printed(" ".join((line, *(less for given, less in SHORTER.items() if given in line))))


def rows(text: str) -> list[str]:
    """The lines of a text without frames of tables; lines that go on belong to the one before."""
    found: list[str] = []
    for line in re.sub(r"[\u2500-\u257f]", " ", text).splitlines():
        goes_on = line[:1] == " " and line.strip() and re.match(r" {18}", line)
        if goes_on and found:
            found[-1] += " " + line.strip()
        elif line.strip():
            found.append(line.strip())
    return [" ".join(row.split()) for row in found]


def check_shown(shown: str, printed: str) -> None:
    """Compare what a page shows with what is printed: words, and numbers to 2 %; ``...`` is left out."""
    lines = rows(printed)
    for row in rows(shown):
        if row.startswith("wall time"):
            continue
        start, *rest = (part.strip() for part in row.split("..."))
        words, numbers = masked(start)
        line = next((one for one in lines if masked(one)[0].startswith(words)), None)
        assert line is not None, f"{row!r} is not printed:\n{printed}"
        assert masked(line)[1][: len(numbers)] == pytest.approx(numbers, rel=0.02), (row, line)
        assert not any(rest), f"{row!r}: nothing may follow what is left out"


def masked(text: str) -> tuple[str, list[float]]:
    """A text without its numbers, and the numbers."""
    number = r"-?\d[\d,]*(?:\.\d+)?(?:e-?\d+)?"
    return re.sub(number, "#", text), [float(one.replace(",", "")) for one in re.findall(number, text)]


@pytest.mark.slow
def test_the_readme_shows_what_the_main_job_prints(printed: Printed) -> None:
    (job,) = (block for block in blocks(PAGES_BY_NAME["README"], "sh") if "fly --farm waterberry" in block)
    (shown,) = (block for block in blocks(PAGES_BY_NAME["README"], "text") if "score" in block)
    line = "wbf-mission" + job.strip().rpartition("/wbf-mission")[2]
    check_shown(shown, printed(f"{line} --no-files --no-plots"))


@pytest.mark.slow
def test_the_page_of_preflight_shows_what_is_printed(printed: Printed) -> None:
    page = PAGES_BY_NAME["preflight"]
    (session,) = (block for block in blocks(page, "text") if block.startswith("$ wbf-mission "))
    order, _, shown = session.removeprefix("$ ").partition("\n")
    printed(commands(page)[0])
    check_shown(shown, printed(order, good=(0, 1)))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_python_in_a_page_is_sound(page: Path) -> None:
    """Sessions (>>>) give what they show; other blocks are Python whose imports exist."""
    failures, _ = doctest.testfile(str(page), module_relative=False)
    assert failures == 0
    for block in blocks(page, "python"):
        if block.lstrip().startswith(">>>"):
            continue
        tree = ast.parse(block)
        imports = [
            node
            for node in ast.walk(tree)
            if isinstance(node, ast.Import)
            or (isinstance(node, ast.ImportFrom) and not str(node.module).startswith("my_"))
        ]
        exec(compile(ast.Module(imports, type_ignores=[]), page.name, "exec"), {})


@pytest.mark.parametrize(
    "table",
    [BatterySpec, PowerSpec, FixedWingPowerSpec, RoverPowerSpec, FixedWingAirframe, PublishedEndurance],
)
def test_the_page_on_vehicle_files_names_every_key(table: type) -> None:
    text = PAGES_BY_NAME["vehicle-files"].read_text(encoding="utf-8")
    assert {field.name for field in dataclasses.fields(table)} <= set(re.findall(r"`(\w+)`", text))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_between_pages_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#:]+)\)", page.read_text(encoding="utf-8")):
        assert (page.parent / target).exists(), f"{page.name}: {target}"
