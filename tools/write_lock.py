"""Write ``requirements.lock``: the versions that CI tested, as a constraints file of pip.

It holds all packages of this Python environment that wbf-mission and its extras need. Run the script in an
environment that has passed the tests; with ``--check`` it writes nothing, and fails if the file differs::

    python tools/write_lock.py [--check]
"""

from __future__ import annotations

import sys
import tomllib
from importlib.metadata import distribution
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
LOCK = ROOT / "requirements.lock"
HEAD = """\
# What CI tested: pip install -c requirements.lock .
# Written by tools/write_lock.py for Python 3.11 on Linux; do not edit.
"""


def project_requirements(*, with_extras: bool = True) -> list[Requirement]:
    """Return the requirements in pyproject.toml, by default with those of all extras."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"].values() if with_extras else ()
    lists = project["dependencies"], *extras
    return [Requirement(text) for texts in lists for text in texts if not text.startswith(project["name"])]


def locked_versions(requirements: list[Requirement]) -> dict[str, str]:
    """Return the installed versions, by name, of required packages and of all packages that these require."""
    versions: dict[str, str] = {}
    seen: set[tuple[str, str]] = set()
    left = [(requirement, "") for requirement in requirements]
    while left:
        requirement, extra = left.pop()
        if requirement.marker is not None and not requirement.marker.evaluate({"extra": extra}):
            continue
        installed = distribution(requirement.name)
        versions[canonicalize_name(requirement.name)] = installed.version
        for wanted in ("", *requirement.extras):
            key = canonicalize_name(requirement.name), wanted
            if key not in seen:
                seen.add(key)
                left += [(Requirement(text), wanted) for text in installed.requires or ()]
    return dict(sorted(versions.items()))


def main() -> None:
    """Write the lock file, or check it."""
    versions = locked_versions(project_requirements())
    text = HEAD + "".join(f"{name}=={version}\n" for name, version in versions.items())
    if sys.argv[1:] != ["--check"]:
        LOCK.write_text(text, encoding="utf-8")
    elif LOCK.read_text(encoding="utf-8") != text:
        sys.exit("requirements.lock differs from what is installed: install by it, or write it again")


if __name__ == "__main__":
    main()
