"""Folders of a benchmark that was flown, and packs of them that are changed."""

import json
import zipfile

from msgspec import structs

from wbf_mission.addons.boards.submission import ABOUT, write_pack
from wbf_mission.bench.benchmark import benchmark
from wbf_mission.bench.rows import BenchStore, read_rows
from wbf_mission.bench.spec import BenchSpec, run_keys

SCENARIO = "WBF/Miniberry-10-v1"


def flown(folder, *, planners=("spiral", "lawnmower"), estimators=("point",), seeds=3):
    """Fly a small benchmark into a folder, and return the folder."""
    benchmark(BenchSpec.of([SCENARIO], list(planners), list(estimators), seeds), out=folder)
    return folder


def changed(folder, out, change):
    """Write rows of a folder into another one, each as `change` gives it; None leaves it out."""
    with BenchStore(out) as store:
        for number, row in enumerate(read_rows(folder)):
            row = change(number, row)
            if row is not None:
                store.add(row)
    return out


def told_of(row, **values):
    """Return a row with other values, and the key that belongs to them."""
    row = structs.replace(row, **values)
    return structs.replace(row, key=run_keys(row)[0])


def pack_of(rows, path, **given):
    """Pack rows without asking whether they are whole."""
    told = {"name": "Some", "by": "Somebody", "about": "", "made": "2026-01-01T00:00:00+00:00"}
    write_pack(path, rows, **(told | given))
    return path


def members_of(path):
    """Return what the members of a pack hold, by name."""
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def written(path, members):
    """Write an archive of these members, which may be pairs with the same name."""
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in members.items() if isinstance(members, dict) else members:
            archive.writestr(name, content)
    return path


def told_otherwise(path, out, **values):
    """Write a pack whose description tells other values."""
    members = members_of(path)
    about = json.loads(members[ABOUT]) | values
    return written(out, {**members, ABOUT: json.dumps(about)})
