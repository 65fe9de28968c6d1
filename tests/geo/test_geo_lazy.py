"""Imports of geo: light where they can be, and possible without modules that only Unix has."""

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGES = ["geo", "mission.files", "mission.link", "mission.planners", "mission.transfer"]


@pytest.mark.parametrize("name", PACKAGES)
def test_the_type_checker_and_the_program_see_the_same_names(name):
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


def test_an_unknown_name_is_an_attribute_error():
    import geo

    with pytest.raises(AttributeError, match="'geo' has no attribute 'farmer'"):
        _ = geo.farmer
    with pytest.raises(ImportError, match="farmer"):
        exec("from geo import farmer")


def test_errors_and_packages_are_imported_without_the_heavy_libraries():
    code = (
        f"import geo.errors, geo.farms, geo.named, mission.errors, {', '.join(PACKAGES)}, sys; "
        "geo.farms.farm_names(); "
        "print(sorted({'numpy', 'scipy', 'shapely', 'pyproj', 'pymavlink', 'numba'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


WINDOWS = """
# Libraries ask for the system when they are imported: they come first.
import multiprocessing.resource_tracker, pathlib, shutil, sys, tempfile
import filelock, joblib, msgspec, numba, numpy, psutil, pyproj, shapely, shapely.geometry.polygon
import os, platformdirs, signal, sqlite3, zipfile, xml.parsers.expat

sys.modules.update(fcntl=None, resource=None)
del signal.SIGHUP, signal.pthread_sigmask
sys.platform = "win32"

for file in pathlib.Path(sys.argv[1]).parent.glob("[!_]*.py"):
    __import__(f"geo.{file.stem}")

from geo.atomic import AtomicFolder, FolderError, atomic_write
from geo.system import available_memory
from geo.processes import INTERRUPTS, interrupts_held
from geo.atomic import made_by_one

folder = pathlib.Path(tempfile.mkdtemp())
with made_by_one(folder / "made"):
    pass
with AtomicFolder(folder / "result", "mark", lambda name: True) as result:
    with atomic_write(result.filled / "mark") as mark:
        mark.write("whole")
    try:
        AtomicFolder(folder / "result", "mark", lambda name: True).__enter__()
    except FolderError as error:
        print(str(error).split(";")[0], end=" ")
    result.commit()
with interrupts_held():
    print((folder / "result" / "mark").read_text(), len(INTERRUPTS), available_memory().bytes > 0)
print(sorted(path.name for path in folder.iterdir()))
shutil.rmtree(folder)
"""


def test_modules_that_only_unix_has_are_not_needed():
    import geo

    done = subprocess.run([sys.executable, "-c", WINDOWS, str(geo.__file__)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [
        "another run writes into this folder whole 2 True",
        "['made.lock', 'result']",
    ]
