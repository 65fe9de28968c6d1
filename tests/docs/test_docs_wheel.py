"""The wheel holds the packages, whole, and nothing else; installed alone, it flies from an empty folder."""

import shutil
import subprocess
import sys
import sysconfig
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("geo", "sensors", "mission", "sim_vehicle", "wbf_mission")


def is_for_users(path):
    # Sources of the page and READMEs are for who changes a part; what users load is in `static`.
    return path.name != "README.md" and Path("wbf_mission/addons/web/page") not in path.parents


def test_package_data_are_the_files_that_there_are():
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]
    patterns = [(name, pattern) for name, given in settings["package-data"].items() for pattern in given]
    listed = {pair: {path for path in (ROOT / pair[0]).glob(pair[1]) if path.is_file()} for pair in patterns}
    assert not [pair for pair, paths in listed.items() if not paths]
    there = {
        path
        for name in PACKAGES
        for path in (ROOT / name).rglob("*")
        if path.is_file() and path.suffix not in (".py", ".pyc") and is_for_users(path.relative_to(ROOT))
    }
    assert set().union(*listed.values()) == there


@pytest.mark.slow
def test_the_wheel_is_whole_and_flies(tmp_path):
    source, empty = tmp_path / "source", tmp_path / "empty"
    empty.mkdir()
    skip = shutil.ignore_patterns("__pycache__", "*.egg-info", "node_modules")
    for name in PACKAGES:
        shutil.copytree(ROOT / name, source / name, ignore=skip)
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source / name)
    wanted = {
        str(path.relative_to(source))
        for name in PACKAGES
        for path in (source / name).rglob("*")
        if path.is_file() and is_for_users(path.relative_to(source))
    }
    pip = [sys.executable, "-m", "pip"]
    subprocess.run([*pip, "wheel", "-q", ".", "--no-deps", "-w", str(tmp_path)], cwd=source, check=True)
    (wheel,) = tmp_path.glob("*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    assert {name for name in names if ".dist-info/" not in name} == wanted

    venv.create(tmp_path / "venv", with_pip=False, symlinks=True)
    python = tmp_path / "venv" / "bin" / "python"
    (site,) = (tmp_path / "venv" / "lib").glob("python*/site-packages")
    subprocess.run([*pip, "install", "-q", "--no-deps", "--target", str(site), str(wheel)], check=True)
    shared = [sysconfig.get_path("purelib"), *(one for one in sys.path if one.endswith("site-packages"))]
    (site / "shared.pth").write_text("\n".join(dict.fromkeys(shared)) + "\n")
    words = ["fly", "--farm", "miniberry-10", "--planner", "spiral", "--vehicle", "ideal", "--no-files"]
    code = "import geo, sys; print(geo.__file__); from wbf_mission.__main__ import main; sys.exit(main())"
    done = subprocess.run(
        [str(python), "-c", code, *words], cwd=empty, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(str(site))
    assert "completed" in done.stdout
