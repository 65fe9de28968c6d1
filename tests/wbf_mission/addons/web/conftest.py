"""One browser for all tests of pages in a process."""

from collections.abc import Iterator

import pytest
from live_page import chromium
from playwright.sync_api import Browser


@pytest.fixture(scope="package")
def browser() -> Iterator[Browser]:
    with chromium() as started:
        yield started
