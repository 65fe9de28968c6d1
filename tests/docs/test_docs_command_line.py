"""The page of the command line names every option of every command, and no other."""

import re
from collections import Counter
from pathlib import Path

import pytest
from advice import FLAG, commands, flags_of, misadvice

from wbf_mission.scenario.scenario import all_options

pytest.importorskip("wbf_mission.addons", reason="the page names the commands of the add-ons, too")
PAGE = (Path(__file__).parents[2] / "docs" / "command-line.md").read_text(encoding="utf-8")
ROW = re.compile(r"^\| (`--.*) \|$", re.MULTILINE)
NAME = re.compile(r"`([^`]+)`")


def rows(page):
    """The rows of the tables of options: flags, what is between, and commands."""
    for row in ROW.findall(page):
        options, *between, where = row.split(" | ")
        flags = [flag for flag in NAME.findall(options) if flag.startswith("--")]
        named = NAME.findall(where)
        yield flags, between, sorted(commands().keys() - set(named)) if where.startswith("all") else named


def of_page(page):
    """How often the page says that a command has an option, by flag and command."""
    return Counter((flag, name) for flags, _, names in rows(page) for flag in flags for name in names)


def of_commands():
    return {(flag, name) for name in commands() for flag in flags_of(name) if flag.startswith("--")}


def test_every_option_of_every_command_is_in_the_page_once():
    told = of_page(PAGE)
    assert sorted(of_commands() - told.keys()) == []
    assert [pair for pair, count in told.items() if count > 1] == []


def test_the_page_names_no_other_option():
    assert sorted(of_page(PAGE).keys() - of_commands()) == []
    known = {flag for flag, _ in of_commands()} | {"--version"}
    assert {found[0] for found in FLAG.finditer(PAGE)} <= known
    for line in re.findall(r"^wbf-mission (.*)$", PAGE, re.MULTILINE):
        assert misadvice(line.split(), line) == [], line


@pytest.mark.parametrize("key", all_options())
def test_every_key_of_a_scenario_file_stands_beside_its_option(key):
    option = all_options()[key][2]
    keys = {flag: between[1] for flags, between, _ in rows(PAGE) if len(between) == 2 for flag in flags}
    assert any(f"`{key}`" in cell for flag, cell in keys.items() if option.flag in (flag, None)), (
        f"docs/command-line.md has no row of {option.flag} with the key `{key}`"
    )
