from __future__ import annotations

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGES = ["geo", "mission.files", "mission.link", "mission.planners", "mission.transfer"]


@pytest.mark.parametrize("name", PACKAGES)
def test_the_type_checker_and_the_program_see_the_same_names(name: str) -> None:
    package = importlib.import_module(name)
    tree = ast.parse(Path(str(package.__file__)).read_text(encoding="utf-8"))
    (branch,) = (node for node in tree.body if isinstance(node, ast.If))
    typed = {
        alias.asname: statement.module
        for statement in branch.body
        if isinstance(statement, ast.ImportFrom)
        for alias in statement.names
    }
    assert sorted(typed) == sorted(package.__all__)
    for public, module in typed.items():
        assert getattr(package, public) is getattr(importlib.import_module(str(module)), public)
    assert set(package.__all__) <= set(dir(package))
    # A module of the same name would take the place of the public name when it is imported.
    assert not {module.stem for module in Path(str(package.__file__)).parent.glob("*.py")} & set(typed)


def test_an_unknown_name_is_an_attribute_error() -> None:
    import geo

    with pytest.raises(AttributeError, match="'geo' has no attribute 'farmer'"):
        _ = geo.farmer  # type: ignore[attr-defined]
    with pytest.raises(ImportError, match="farmer"):
        exec("from geo import farmer")


def test_errors_and_packages_are_imported_without_the_heavy_libraries() -> None:
    code = (
        f"import geo.errors, geo.named, mission.errors, {', '.join(PACKAGES)}, sys; "
        "print(sorted({'numpy', 'scipy', 'shapely', 'pyproj', 'pymavlink', 'numba'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
