"""Pages in a real browser: the system's Chromium, led by Playwright, and what it must never do."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import Browser, Page, expect, sync_playwright

from wbf_mission.addons.web.server import LiveServer
from wbf_mission.addons.web.view import View

TIMEOUT_MS = 30_000  # A limit against hanging, not a measure
expect.set_options(timeout=TIMEOUT_MS)


@contextmanager
def chromium() -> Iterator[Browser]:
    """Start the system's browser; where there is none, tests are skipped, but not in CI."""
    path = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if path is None:
        (pytest.fail if os.environ.get("CI") else pytest.skip)("no Chromium is installed")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield browser
        browser.close()


@contextmanager
def page_at(
    browser: Browser, url: str, *, drawn: bool = True, script: str = "", **options: Any
) -> Iterator[Page]:
    """Open a page; in the end it must have asked nobody else for anything, and had no errors.

    A `script` is run in it before its own.
    """
    page = browser.new_page(**{"viewport": {"width": 1280, "height": 800}, **options})
    page.set_default_timeout(TIMEOUT_MS)
    if script:
        page.add_init_script(script)
    errors: list[str] = []
    asked: list[str] = []
    page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("request", lambda request: asked.append(request.url))
    page.goto(url)
    try:
        deadline_s = time.monotonic() + TIMEOUT_MS / 1000
        while drawn and not page.evaluate("performance.getEntriesByName('map drawn').length"):
            assert time.monotonic() < deadline_s, "no map is drawn"
            page.wait_for_timeout(20)
        yield page
        assert errors == []
        own = urlsplit(url).netloc
        assert [one for one in asked if urlsplit(one).netloc != own and not one.startswith("data:")] == []
    finally:
        page.close()


# Nothing gets old by itself, and what is said stays, however busy the machine is.
STANDING = """
    const [standing, stood, later] = [performance.now(), Date.now(), setTimeout];
    performance.now = () => standing;
    Date.now = () => stood;
    window.setTimeout = (act, ms, ...more) => ms >= 2000 ? 0 : later(act, ms, ...more);
"""


def standing() -> float:
    """Return the time of a clock that stands; the view of a standing page needs it, too."""
    return 0.0


@contextmanager
def standing_page(browser: Browser, view: View, orders: Any = None) -> Iterator[Page]:
    """Open the live page of a program for which no time passes, nor for the page."""
    with (
        LiveServer(view, orders=orders, clock=standing) as server,
        page_at(browser, server.url, script=STANDING) as page,
    ):
        yield page
