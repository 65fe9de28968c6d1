"""The tables in the documentation are the tables in the code."""

from __future__ import annotations

from pathlib import Path

import pytest
from page_tables import with_tables

from mission.transfer.client import CLIENT_TABLE
from mission.transfer.server_session import SERVER_TABLE

PAGE = Path(__file__).parents[3] / "docs" / "transfer.md"


@pytest.mark.parametrize("table", [CLIENT_TABLE, SERVER_TABLE], ids=["client", "server"])
def test_the_page_prints_the_table(table):
    rows = []
    for (state, found), (action, then) in table.items():
        following = "-" if then is state else then.value
        rows.append(f"| {state.value} | {found.value} | {action} | {following} |")
    assert "\n".join(rows) in with_tables(PAGE.read_text(encoding="utf-8"))
