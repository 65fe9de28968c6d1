"""Draw the picture of the studio: a field is drawn in the page, by a headless Chromium.

python docs/draw_studio.py
"""

import re
import shutil
from pathlib import Path

from playwright.sync_api import expect, sync_playwright

from wbf_mission.scenario import Scenario
from wbf_mission.scenario.parts import ScenarioKeywords
from wbf_mission.web.server import LiveServer
from wbf_mission.web.studio import Studio
from wbf_mission.web.view import View

OUT = Path(__file__).parent / "images" / "studio.png"
WIDTH, HEIGHT = 1280, 800
# Parts of the map's width and height.
FIELD = (0.12, 0.2), (0.55, 0.12), (0.86, 0.3), (0.8, 0.82), (0.42, 0.68), (0.15, 0.85)
HOLE = (0.35, 0.35), (0.47, 0.33), (0.5, 0.48), (0.37, 0.52)
SHED = (0.66, 0.4), (0.72, 0.4), (0.72, 0.5), (0.66, 0.5)


def main() -> None:
    """Open the studio, draw, and take the picture."""
    flown: ScenarioKeywords = {"planner": "survey", "budget": "unlimited", "vehicle": "mapping-quad"}
    camera: ScenarioKeywords = {"camera_model": "dji-mavic-3m-ms", "gsd_cm": 2.0, "wind_speed_m_s": 3.0}
    studio = Studio(Scenario(**flown, **camera))
    chromium = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))))
    with LiveServer(View(), routes=studio.routes(), home="studio") as server, sync_playwright() as playwright:
        studio.begin(server)
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
        page.goto(server.url)
        box = page.locator(".map").bounding_box()
        assert box is not None
        page.get_by_role("button", name="New farm").click()
        page.get_by_label("Go to latitude, longitude").fill("28.02, -82.11")
        page.get_by_label("Go to latitude, longitude").press("Enter")
        for tool, ring in (("Field", FIELD), ("Hole", HOLE), ("Obstacle", SHED), ("Home", [(0.1, 0.9)])):
            page.get_by_role("button", name=tool, exact=True).click()
            for x, y in ring:
                page.mouse.click(box["x"] + x * box["width"], box["y"] + y * box["height"])
            page.keyboard.press("Enter")
        page.get_by_role("button", name="field 1").click()
        expect(page.locator("#studio.stale")).to_have_count(0, timeout=120_000)
        expect(page.get_by_role("status").first).to_have_text(re.compile("planned"), timeout=120_000)
        page.screenshot(path=OUT)
        browser.close()
    studio.close()


if __name__ == "__main__":
    main()
