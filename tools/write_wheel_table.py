"""Write ``docs/evidence/wheels.md``: for which systems and Pythons the locked core dependencies have wheels.

`uv <https://docs.astral.sh/uv>`_, which is asked for the files of each package once, must be on the PATH::

    python tools/write_wheel_table.py
"""

from __future__ import annotations

import subprocess
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path
from textwrap import fill

from packaging.tags import Tag, compatible_tags, cpython_tags, mac_platforms
from packaging.utils import parse_wheel_filename
from write_lock import LOCK, ROOT, locked_versions, project_requirements

PAGE = ROOT / "docs" / "evidence" / "wheels.md"
PYTHONS = ((3, 11), (3, 12), (3, 13), (3, 14))
MACOS = (26, 0)


def linux_platforms(machine: str) -> Iterator[str]:
    """Yield the platform tags of Linux with glibc 2.28 (2018) or newer."""
    yield from (f"manylinux_2_{minor}_{machine}" for minor in range(28, 4, -1))
    yield from (f"manylinux{year}_{machine}" for year in ("2014", "2010", "1"))


SYSTEMS = {
    "Linux x86_64": list(linux_platforms("x86_64")),
    "Linux aarch64": list(linux_platforms("aarch64")),
    "macOS arm64": list(mac_platforms(MACOS, "arm64")),
    "macOS x86_64": list(mac_platforms(MACOS, "x86_64")),
    "Windows x86_64": ["win_amd64"],
}
HEAD = """\
# Wheels of the dependencies

This table shows where `pip install -c requirements.lock .` needs no compiler. For each core dependency, and
each package that these need, the table names the versions of Python from 3.11 to 3.14 for which the version
in `requirements.lock` has a wheel. Linux means glibc 2.28 or newer. `python tools/write_wheel_table.py` made
it from the names of the wheels; nothing was installed on macOS and Windows.

numba has no wheel of this version for Macs with Intel processors. Without the lock file, pip installs numba
0.62.1 there for Python 3.11 to 3.13, which `pyproject.toml` allows; for 3.14 there is no wheel.
"""


def wheel_names(versions: dict[str, str]) -> dict[str, list[str]]:
    """Return the names of the wheels of each package in this version."""
    with tempfile.TemporaryDirectory() as folder:
        asked, found = Path(folder, "asked.txt"), Path(folder, "pylock.found.toml")
        asked.write_text("".join(f"{name}=={version}\n" for name, version in versions.items()))
        options = ["--no-deps", "--universal", "--python-version", "3.11", "--format", "pylock.toml"]
        subprocess.run(["uv", "pip", "compile", "-q", asked, *options, "-o", found], check=True)
        packages = tomllib.loads(found.read_text(encoding="utf-8"))["packages"]
    return {
        package["name"]: [wheel["url"].rpartition("/")[2] for wheel in package.get("wheels", ())]
        for package in packages
    }


def covered(wheels: list[str], platforms: list[str]) -> str:
    """Return the Pythons with a wheel, and the macOS that the newest one's wheel needs, beyond macOS 12."""
    tags: set[Tag] = set().union(*(parse_wheel_filename(name)[3] for name in wheels))
    pythons, newest = [], ""
    for version in PYTHONS:
        usable = [*cpython_tags(version, platforms=platforms), *compatible_tags(version, platforms=platforms)]
        fitting = [tag for tag in usable if tag in tags]
        if fitting:
            pythons.append(".".join(map(str, version)))
            newest = fitting[-1].platform
    text = "all" if len(pythons) == len(PYTHONS) else ", ".join(pythons) or "**none**"
    _, _, macos = newest.partition("macosx_")
    needed = int(macos.partition("_")[0] or 0)
    return f"{text}, from macOS {needed}" if needed > 12 else text


def main() -> None:
    """Write the page."""
    locked = dict(
        line.split("==") for line in LOCK.read_text(encoding="utf-8").splitlines() if line[0] != "#"
    )
    core = locked_versions(project_requirements(with_extras=False))
    wheels = wheel_names({name: locked[name] for name in core})
    pure, rows = [], []
    for name, names in wheels.items():
        if any(wheel.endswith("-none-any.whl") for wheel in names):
            pure.append(name)
        else:
            cells = [covered(names, platforms) for platforms in SYSTEMS.values()]
            rows.append(f"| {name} {locked[name]} | {' | '.join(cells)} |\n")
    head = f"| | {' | '.join(SYSTEMS)} |\n|{'---|' * (len(SYSTEMS) + 1)}\n"
    others = fill(", ".join(pure), 110, break_on_hyphens=False)
    rest = f"\nThe other {len(pure)} packages have the same wheel for all systems:\n{others}.\n"
    PAGE.write_text(HEAD + "\n" + head + "".join(rows) + rest, encoding="utf-8")


if __name__ == "__main__":
    main()
