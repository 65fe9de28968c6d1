"""Packages that are installed for a test: a folder of `sys.path` with their entry points."""

import os


def install(folder, name, entry_points):
    """Register what a module or package in a folder offers, as its installation would."""
    metadata = folder / f"{name}-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(entry_points)


def importable(folder):
    """Return the PYTHONPATH of a process that finds the packages of a folder."""
    return os.pathsep.join(filter(None, [str(folder), os.environ.get("PYTHONPATH", "")]))
