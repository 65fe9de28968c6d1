"""Errors that a user can mend have one root."""

import importlib
import re
from pathlib import Path

from geo.errors import PACKAGES, WbfMissionError

ROOT = Path(__file__).parents[2]
# Caught within the project: none of them reaches a user.
INTERNAL = {"ArchiveError", "StoppedError", "FileError", "FtpError", "_OwnCodeError", "StdoutError"}


def test_every_error_derives_from_the_root_or_stays_inside():
    others, count = set(), 0
    for package in PACKAGES:
        for file in (ROOT / package).rglob("*.py"):
            module = ".".join(file.relative_to(ROOT).with_suffix("").parts)
            for name in re.findall(r"^class (\w+Error)\(", file.read_text(encoding="utf-8"), re.MULTILINE):
                count += 1
                if not issubclass(getattr(importlib.import_module(module), name), WbfMissionError):
                    others.add(name)
    assert others == INTERNAL
    assert count > 50
