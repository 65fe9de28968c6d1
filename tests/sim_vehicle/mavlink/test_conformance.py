"""The conformance table and the tests that it names."""

import re
from pathlib import Path

from page_tables import rows_of, with_tables

ROOT = Path(__file__).parents[3]


def test_the_conformance_table_names_tests_that_exist():
    page = with_tables((ROOT / "docs" / "conformance.md").read_text(encoding="utf-8"))
    named = set(re.findall(r"`(test_\w+)`", page))
    assert len(named) > 50
    defined = {
        name
        for path in (ROOT / "tests").rglob("test_*.py")
        for name in re.findall(
            r"^ *(?:async )?def (test_\w+)", path.read_text(encoding="utf-8"), re.MULTILINE
        )
    }
    assert named <= defined, sorted(named - defined)


def test_every_row_names_a_test():
    rows = rows_of("conformance.csv")
    assert len(rows) > 180
    assert [row for row in rows if "`test_" not in row["test"]] == []
