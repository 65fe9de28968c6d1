"""Runs that are exported."""

from pathlib import Path

from wbf_mission.cli.app import main

FLEET = ("--farm", "miniberry-10", "--vehicles", "2", "--days", "2", "--fence", "10", "--no-plots", "--quiet")


def fleet_run(folder: Path, *options: str) -> Path:
    """Fly two vehicles over two days into a folder, with the log."""
    assert main(["fly", *FLEET, *options, "--out", str(folder)]) == 0
    return folder
