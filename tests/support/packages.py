"""Packages that are installed for a test: a folder of `sys.path` with their entry points."""

import json
import os
import re
import subprocess
import sys

_CALLS = """
import sys
from wbf_mission.cli.app import main

print([int(main(line.split())) for line in sys.argv[1:]])
"""


def install(folder, name, entry_points):
    """Register what a module or package in a folder offers, as its installation would."""
    metadata = folder / f"{name}-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(entry_points)


def importable(folder):
    """Return the PYTHONPATH of a process that finds the packages of a folder."""
    return os.pathsep.join(filter(None, [str(folder), os.environ.get("PYTHONPATH", "")]))


def command_lines(folder, *lines):
    """Run command lines in one process that finds the packages of a folder.

    Returns their exit codes, the JSON documents that they printed, all that they printed, and all errors.
    """
    done = subprocess.run(
        [sys.executable, "-c", _CALLS, *lines],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": importable(folder)},
        check=False,
    )
    assert done.returncode == 0, done.stderr
    documents, end = [], 0
    for begin in re.finditer(r"^[\[{]", done.stdout, re.MULTILINE):
        if begin.start() >= end:
            document, end = json.JSONDecoder().raw_decode(done.stdout, begin.start())
            documents.append(document)
    *documents, codes = documents
    return codes, documents, done.stdout, done.stderr
