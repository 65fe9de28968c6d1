"""The lock file holds every dependency, at a version inside its range."""

import re
from importlib.metadata import PackageNotFoundError

import pytest
import write_lock
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


def test_what_a_dependency_needs_is_locked_too():
    assert {"llvmlite", "lxml", "numcodecs", "pluggy", "jinja2", "msgpack"} <= LOCKED.keys()


def test_packages_that_an_extra_or_another_system_needs_are_found_by_their_markers():
    found = write_lock.locked_versions([Requirement("dask[distributed]"), Requirement("pytest")])
    assert {"dask", "distributed", "tornado", "pluggy"} <= found.keys()
    assert "distributed" not in write_lock.locked_versions([Requirement("dask")])
    assert "colorama" not in found  # Windows alone needs it
    with pytest.raises(PackageNotFoundError):
        write_lock.locked_versions([Requirement("no-such-package")])
