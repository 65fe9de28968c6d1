"""The lock file holds every dependency, at a version inside its range."""

import re
from importlib.metadata import PackageNotFoundError

import pytest
import write_lock
import write_wheel_table
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

LINES = [line for line in write_lock.LOCK.read_text(encoding="utf-8").splitlines() if line[0] != "#"]
LOCKED = dict(line.split("==") for line in LINES)


def test_the_lock_holds_names_and_exact_versions_alone():
    assert [line for line in LINES if not re.fullmatch(r"[a-z0-9-]+==[a-z0-9.+]+", line)] == []
    assert sorted(LOCKED) == list(LOCKED)


@pytest.mark.parametrize("requirement", write_lock.project_requirements(), ids=str)
def test_a_dependency_is_locked_inside_its_range(requirement):
    assert requirement.specifier.contains(LOCKED[canonicalize_name(requirement.name)])


def test_packages_that_an_extra_or_another_system_needs_are_found_by_their_markers():
    found = write_lock.locked_versions([Requirement("dask[distributed]"), Requirement("pytest")])
    assert {"dask", "distributed", "tornado", "pluggy"} <= found.keys()
    assert "distributed" not in write_lock.locked_versions([Requirement("dask")])
    assert "colorama" not in found  # Windows alone needs it
    with pytest.raises(PackageNotFoundError):
        write_lock.locked_versions([Requirement("no-such-package")])


def test_the_table_of_wheels_is_that_of_the_lock():
    page = (write_lock.ROOT / "docs" / "evidence" / "wheels.md").read_text(encoding="utf-8")
    for requirement in write_lock.project_requirements(with_extras=False):
        name = canonicalize_name(requirement.name)
        row = re.search(rf"^\| {name} (\S+) \|", page, re.MULTILINE)
        assert row[1] == LOCKED[name] if row else re.search(rf"\b{name}\b", page), name


@pytest.mark.parametrize(
    ("system", "wheels", "text"),
    [
        ("Windows x86_64", ["a-1-cp311-cp311-win_amd64.whl", "a-1-cp313-cp313-win_amd64.whl"], "3.11, 3.13"),
        ("Windows x86_64", ["a-1-cp313-abi3-win_amd64.whl", "a-1-cp311-cp311-win32.whl"], "3.13, 3.14"),
        ("Windows x86_64", ["a-1-cp311-cp311-macosx_11_0_arm64.whl"], "**none**"),
        ("macOS arm64", ["a-1-cp38-abi3-macosx_15_0_arm64.whl"], "all, from macOS 15"),
    ],
)
def test_wheels_are_for_the_pythons_and_systems_in_their_names(system, wheels, text):
    assert write_wheel_table.covered(wheels, write_wheel_table.SYSTEMS[system]) == text


def test_the_lowest_versions_are_the_lower_bounds_of_the_ranges():
    text = (write_lock.ROOT / ".ci" / "lowest.txt").read_text(encoding="utf-8")
    lowest = dict(line.split("==") for line in text.splitlines() if line[0] != "#")
    bounds = {
        canonicalize_name(requirement.name): bound.version
        for requirement in write_lock.project_requirements()
        for bound in requirement.specifier
        if bound.operator in (">=", "==")
    }
    core = {requirement.name for requirement in write_lock.project_requirements(with_extras=False)}
    assert core <= lowest.keys()
    assert lowest == {name: bounds[name] for name in lowest}
