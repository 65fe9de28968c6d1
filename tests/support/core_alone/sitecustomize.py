"""First on PYTHONPATH, this hides the add-ons from a process and those that it starts."""

import importlib.abc
import importlib.metadata
import sys

ADDONS = "wbf_mission.addons"


class _Hidden(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name == ADDONS or name.startswith(f"{ADDONS}."):
            raise ModuleNotFoundError(f"{name} is hidden", name=name)


_entry_points = importlib.metadata.entry_points


def _core_entry_points(**wanted):
    found = _entry_points(**wanted)
    if not wanted:  # by group, in Python 3.11
        return found
    return importlib.metadata.EntryPoints(entry for entry in found if not entry.module.startswith(ADDONS))


importlib.metadata.entry_points = _core_entry_points
sys.meta_path.insert(0, _Hidden())
