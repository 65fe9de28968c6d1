"""Draw the pictures of pages: the live page, reports, the benchmark's page, the studio.

    python docs/draw_pages.py report.png bench-page.png --out docs/images

The script needs Chromium and the extra `dev`. It first flies the runs of these pages, in a temporary folder.
"""

from __future__ import annotations

import contextlib
import io
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from drawing import asked_for
from PIL import Image
from playwright.sync_api import Browser, Locator, Page, expect, sync_playwright

ROOT = Path(__file__).parents[1]
PROGRAM = (sys.executable, "-m", "wbf_mission")
FLIGHT = ("--farm", "miniberry-30", "--budget", "3min", "--estimator", "epidemic")
FLEET = (*FLIGHT, "--policy", "rolling-horizon", "--vehicles", "2")
DRAWN = {  # Positions as fractions of the map's width and height
    "Field": ((0.12, 0.2), (0.55, 0.12), (0.86, 0.3), (0.8, 0.82), (0.42, 0.68), (0.15, 0.85)),
    "Hole": ((0.35, 0.35), (0.47, 0.33), (0.5, 0.48), (0.37, 0.52)),
    "Obstacle": ((0.66, 0.4), (0.72, 0.4), (0.72, 0.5), (0.66, 0.5)),
    "Home": ((0.1, 0.9),),
}
STILL_MS, LONGEST_MS = 1500, 120_000
WIDTH, HEIGHT = 1280, 800


def run(*arguments: str | Path) -> None:
    """Run the program."""
    subprocess.run([*PROGRAM, *map(str, arguments), "--quiet"], check=True, stdout=subprocess.DEVNULL)  # noqa: S603


@contextlib.contextmanager
def served(*arguments: str) -> Iterator[str]:
    """Run a command that serves a page; yield the address that it prints."""
    command = [*PROGRAM, *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:  # noqa: S603
        lines = process.stdout or ()
        try:
            yield next(found[0] for line in lines if (found := re.search(r'http://[^\s"]+', line)))
        finally:
            process.terminate()


def opened(browser: Browser, url: str, *, height: int = HEIGHT) -> Page:
    """Open a page, and wait until it is drawn."""
    page = browser.new_page(viewport={"width": WIDTH, "height": height}, color_scheme="light")
    page.goto(url)
    page.wait_for_timeout(STILL_MS)
    return page


def keep(shown: Page | Locator, path: Path) -> None:
    """Save a picture with few colours, which suffice for pages."""
    picture = Image.open(io.BytesIO(shown.screenshot())).convert("RGB")
    picture.quantize(dither=Image.Dither.NONE).save(path, optimize=True)


def draw_report(browser: Browser, folder: Path, out: Path) -> None:
    """Draw the page of a run at half of its time, and the summary of the run."""
    run("fly", *FLEET, "--out", folder / "run", "--no-plots")
    run("report", folder / "run")
    page = opened(browser, (folder / "run.html").as_uri())
    keep(page.locator("#summary"), out.with_name("report-summary.png"))
    page.get_by_role("link", name="Replay it below").click()
    page.get_by_label("Time of the run").fill("100")
    page.wait_for_timeout(STILL_MS)
    keep(page, out)


def draw_two(browser: Browser, folder: Path, out: Path) -> None:
    """Draw two runs side by side."""
    for name, chooser in (("spiral", ("--planner", "spiral")), ("greedy", ("--policy", "greedy"))):
        run("fly", *FLIGHT, *chooser, "--out", folder / name, "--no-plots")
    run("report", folder / "spiral", folder / "greedy")
    page = opened(browser, (folder / "spiral-greedy.html").as_uri())
    page.get_by_role("link", name="Replay it below").click()
    page.wait_for_timeout(STILL_MS)
    keep(page, out)


def draw_bench(browser: Browser, folder: Path, out: Path) -> None:
    """Draw the page of a benchmark, with an open row."""
    what = ("--planners", "spiral,lawnmower,greedy,orienteering", "--estimators", "gp,adaptive-disk")
    scenarios = ("--scenarios", "WBF/Miniberry-10-v1,WBF/Miniberry-30-v1")
    run("bench", "run", *scenarios, *what, "--seeds", "5", "--out", folder / "results")
    run("report", folder / "results")
    page = opened(browser, (folder / "results.html").as_uri() + "#estimator=gp&sort=3 down")
    page.locator(".opener:visible").first.click()
    keep(page, out)


def draw_board(browser: Browser, folder: Path, out: Path) -> None:
    """Draw the leaderboard of the frozen baselines and a submission."""
    what = ("--scenarios", "WBF/Miniberry-10-v1", "--planners", "greedy", "--estimators", "gp,epidemic")
    run("bench", "run", *what, "--seeds", "10", "--out", folder / "mine")
    pack = folder / "mine.zip"
    run("bench", "submit", folder / "mine", "--name", "Mine", "--by", "A. Grower", "--out", pack)
    run("bench", "board", ROOT / "results", pack, "--out", folder / "board")
    keep(opened(browser, (folder / "board" / "board.html").as_uri()), out)


def draw_live(browser: Browser, folder: Path, out: Path) -> None:
    """Draw the live page during a flight."""
    flight = (
        "fly",
        *FLEET,
        "--out",
        str(folder / "live"),
        "--no-plots",
        "--live",
        "0",
        "--speed",
        "10",
        "--json",
    )
    with served(*flight) as url:
        page = opened(browser, url)
        while (page.locator(".clock").text_content() or "") < "1:40":
            page.wait_for_timeout(100)
        keep(page, out)


def draw_studio(browser: Browser, _: Path, out: Path) -> None:
    """Draw a field with a hole and an obstacle in the studio, and take the picture of its plan."""
    flown = ("--planner", "survey", "--budget", "unlimited", "--vehicle", "mapping-quad", "--wind", "3,0,0")
    with served("studio", *flown, "--camera", "dji-mavic-3m-ms", "--gsd", "2") as url:
        page = opened(browser, url)
        box = page.locator(".map").bounding_box() or {}
        page.get_by_role("button", name="New farm").click()
        page.get_by_label("Go to latitude, longitude").fill("28.02, -82.11")
        page.get_by_label("Go to latitude, longitude").press("Enter")
        for tool, ring in DRAWN.items():
            page.get_by_role("button", name=tool, exact=True).click()
            for x, y in ring:
                page.mouse.click(box["x"] + x * box["width"], box["y"] + y * box["height"])
            page.keyboard.press("Enter")
        page.get_by_role("button", name="field 1").click()
        expect(page.locator("#studio.stale")).to_have_count(0, timeout=LONGEST_MS)
        expect(page.get_by_role("status").first).to_have_text(re.compile("planned"), timeout=LONGEST_MS)
        keep(page, out)


PICTURES: dict[str, Callable[[Browser, Path, Path], None]] = {
    "report.png": draw_report,
    "report-two.png": draw_two,
    "bench-page.png": draw_bench,
    "board.png": draw_board,
    "live.png": draw_live,
    "studio.png": draw_studio,
}


def main() -> int:
    """Fly and draw."""
    pictures = asked_for(__doc__, PICTURES)
    path = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as folder:
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        for picture in pictures:
            PICTURES[picture.name](browser, Path(folder), picture)
        browser.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
