"""The page of the preflight check names every finding, and no other; each has a test."""

import ast
import re
from pathlib import Path

from page_tables import rows_of

import wbf_mission.preflight.run
from wbf_mission.addons.operate import vehicle_rules
from wbf_mission.preflight.rules import RULES

ROOT = Path(__file__).parents[3]
CODE = re.compile(r"[a-z]+(-[a-z]+)*")


def rows_on_the_page():
    """Codes and severities of each row."""
    rows = rows_of("preflight.csv")
    return [(re.findall(r"`([^`]+)`", row["code"]), row["severity"].split(", ")) for row in rows]


def codes_on_the_page():
    return [code for codes, _ in rows_on_the_page() for code in codes]


def codes_in_the_source():
    """Second arguments of findings, and the codes of problems that stand in the executor's checks."""
    found = set()
    folder = Path(wbf_mission.preflight.__file__).parent
    sources = [
        *folder.rglob("*.py"),
        Path(vehicle_rules.__file__),
        ROOT / "sim_vehicle" / "execution" / "items.py",
    ]
    for path in sources:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and CODE.fullmatch(node.value):
                found.add(node.value)
    return found


def codes_in_the_tests():
    """Of the tables CASES of the tests: keys, or what comes first in each row."""
    found = set()
    for path in (ROOT / "tests" / "wbf_mission").rglob("*_checks.py"):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "CASES":
                table = node.value
                first = table.keys if isinstance(table, ast.Dict) else [row.elts[0] for row in table.elts]
                found |= {one.value for one in first}
    return found


def test_every_finding_that_a_test_knows_is_on_the_page():
    tested = codes_in_the_tests()
    assert len(tested) > 80
    page = codes_on_the_page()
    assert len(page) == len(set(page))
    assert set(page) == tested, "add a row to docs/preflight.csv, or a case to CASES in *_checks.py"


def test_every_finding_on_the_page_is_in_the_source():
    assert set(codes_on_the_page()) <= codes_in_the_source()


def test_the_page_has_the_severity_of_each_rule():
    """Severities in a row of several codes are theirs, one after another, if there are as many."""
    told = {}
    for codes, severities in rows_on_the_page():
        each = severities if len(severities) == len(codes) > 1 else [severities] * len(codes)
        told.update(zip(codes, each, strict=True))
    assert len(RULES) > 60
    for code, rule in RULES.items():
        assert code in told, f"docs/preflight.csv has no row of {code}"
        assert rule.severity.value in told[code], code
