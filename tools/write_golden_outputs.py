"""Write the golden outputs: digests of the outputs of five flights and thirty commands.

Run ``python tools/write_golden_outputs.py`` after a change that is meant to alter outputs. The commit names
the altered outputs and the reason. ``--keep DIR`` keeps the outputs in DIR, so that ``diff -r`` shows
changes.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pyarrow.parquet
from mcap.reader import make_reader

from geo.atomic import atomic_write
from wbf_mission.bench.provenance import libraries

TABLE = Path(__file__).parents[1] / "tests" / "data" / "golden_outputs.json"
MEASURED = {"wall_time_s", "cpu_time_s", "realtime_factor", "timings_s", "compute_s", "seconds", "time_share"}
"""Keys of documents with measured times as values, which differ from run to run."""
_SMALL = "--farm miniberry-10"
FLIGHTS = {
    "spiral": f"{_SMALL} --planner spiral --estimator gp --seed 3",
    "fleet": f"{_SMALL} --policy greedy --estimator gp --autopilot px4,ardupilot --budget 60s --seed 1",
    "days": f"{_SMALL} --planner random-waypoint --estimator adaptive-disk --vehicle ideal --days 2",
    "survey": "--farm miniberry-30 --planner survey --vehicle mini-quad --estimator point",
    "rover": f"{_SMALL} --planner lawnmower --vehicle rover --estimator gp --wind 3,180,1 --camera-noise 0.1",
}
COMMANDS = {
    "plan": "plan --farm miniberry-30 --planner spiral --json",
    "plan-adaptive": "plan --farm miniberry-30 --planner adaptive-lawnmower --budget 800m --json",
    "plan-fleet": "plan --farm miniberry-30 --vehicle quad,rover --budget 200s --json",
    "plan-wing": "plan --farm miniberry-100 --vehicle wing --planner lawnmower --json",
    "plan-survey": "plan --farm miniberry-100 --planner survey --camera dji-p1-35 --gsd 0.5 --json",
    "plan-fence": "plan --farm miniberry-30 --fence 10 --autopilot ardupilot --json",
    "plan-file": "plan --farm miniberry-10 --planner lawnmower --out out/mine.plan --json",
    "plan-waypoints": "plan --farm miniberry-10 --planner spiral --out out/mine.waypoints --json",
    "preflight": "preflight out/mine.plan --json",
    "preflight-fly": "preflight out/mine.waypoints --vehicle quad --autopilot ardupilot --json",
    "convert": "convert out/mine.plan out/mine.kml --json",
    "convert-back": "convert out/mine.waypoints out/again.plan --json",
    "farm-list": "farm list --json",
    "farm-show": "farm show miniberry-100 --json",
    "farm-save": "farm save miniberry-30 --out out/farm.geojson --json",
    "vehicle-list": "vehicle list --json",
    "vehicle-show": "vehicle show quad --json",
    "bench-list": "bench list --json",
    "bench-families": "bench list --families --json",
    "bench-show": "bench show WBF/Miniberry-30-Days-v1 --json",
    "bench-run": "bench run --scenarios WBF/Miniberry-10-v1 --planners spiral,greedy --estimators point"
    " --seeds 2 --out out/bench --json",
    "bench-report": "bench report out/bench --json",
    "map": f"map {_SMALL} --log spiral/flight.tlog --observations spiral/observations.parquet --out out/map"
    " --json",
    "export-mcap": "export rover --to mcap --estimates 4 --out out/rover.mcap --json",
    "export-kml": "export spiral --to kml --out out/spiral.kml --json",
    "export-geojson": "export spiral --to geojson --out out/spiral.geojson --json",
    "export-csv": "export survey --to csv --out out/survey.csv --json",
    "export-gpx": "export rover --to gpx --out out/rover.gpx --json",
    "check-planner": "check-planner spiral --json",
    "check-policy": "check-policy greedy --json",
}
_FILES = {".tlog", ".plan", ".waypoints", ".kml", ".geojson", ".gpx", ".csv"}


def outputs(folder: Path) -> Iterator[tuple[str, bytes]]:
    """Run all flights and commands in a folder; yield name and output, without times and machine paths."""
    (folder / "out").mkdir(parents=True)
    for name, options in FLIGHTS.items():
        printed = _run(folder, f"fly {options} --out {name} --json")
        yield f"fly {name}", printed
        for path in sorted((folder / name).iterdir()):
            if path.suffix in _FILES:
                yield f"{name}/{path.name}", path.read_bytes()
            elif path.name.endswith(".json"):
                yield f"{name}/{path.name}", _stable(path.read_bytes(), folder)
            elif path.suffix == ".parquet":
                yield f"{name}/{path.name}", _table(path)
        yield f"{name}/page", _page(folder / name)
    for name, command in COMMANDS.items():
        yield name, _run(folder, command)
    for path in sorted((folder / "out").rglob("*")):
        if path.suffix in _FILES:
            yield path.relative_to(folder).as_posix(), path.read_bytes()
        elif path.suffix == ".mcap":
            yield path.relative_to(folder).as_posix(), mcap_messages(path)


def _run(folder: Path, command: str) -> bytes:
    arguments = [sys.executable, "-m", "wbf_mission", *command.split()]
    done = subprocess.run(arguments, cwd=folder, capture_output=True, check=False, timeout=600)
    return f"exit code {done.returncode}\n".encode() + _stable(done.stdout or done.stderr, folder)


def _stable(text: bytes, folder: Path) -> bytes:
    """Return a JSON document without machine-dependent values; other texts are returned unchanged."""
    try:
        document = json.loads(text)
    except ValueError:
        kept = text.decode()
    else:
        kept = json.dumps(_without_times(document), indent=1, sort_keys=True)
    return kept.replace(str(folder), "FOLDER").encode()


def _without_times(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_times(held) for key, held in value.items() if key not in MEASURED}
    return [_without_times(held) for held in value] if isinstance(value, list) else value


def _table(path: Path) -> bytes:
    table = pyarrow.parquet.read_table(path)
    columns = [name for name in table.column_names if name not in MEASURED]
    return json.dumps(table.select(columns).to_pydict(), default=str).encode()


def _page(run: Path) -> bytes:
    """Return the messages from which the page of a run is made."""
    from wbf_mission import load_result
    from wbf_mission.addons.base.replay import events_of
    from wbf_mission.addons.web.view import View

    view, cursor, messages = View(), None, []
    for number, event in enumerate(events_of(load_result(run))):
        view.take(event)
        if number % 50 == 0:
            update, cursor = view.update(cursor)
            messages.append(msgspec.json.encode(update))
    messages.append(msgspec.json.encode(view.update(cursor)[0]))
    return _without_clock(b"\n".join(messages))


def mcap_messages(path: Path) -> bytes:
    """Return the messages of an MCAP file without the file header, which names the program's version."""
    with path.open("rb") as file:
        found = [
            f"{channel.topic} {schema.name} {message.log_time} ".encode() + message.data
            for schema, channel, message in make_reader(file).iter_messages()
            if schema is not None  # Each of ours has one.
        ]
    return _without_clock(b"\n".join(found))


def _without_clock(messages: bytes) -> bytes:
    return re.sub(rb'"(compute|wall_time)_s":[0-9.e-]+', b"", messages)


def digests(keep: Path | None = None) -> dict[str, str]:
    """Return the digest of each output by name; `keep`: folder in which the outputs are kept."""
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, content in outputs(Path(folder) / "golden"):
            found[name] = hashlib.sha256(content).hexdigest()[:16]
            if keep is not None:
                path = keep / name.replace(" ", "-")
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content)
    return found


def main() -> None:
    """Write the table of digests."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--out", type=Path, default=TABLE)
    options.add_argument("--keep", type=Path)
    given = options.parse_args()
    if given.keep is not None:
        shutil.rmtree(given.keep, ignore_errors=True)
    with atomic_write(given.out) as file:
        made = {"libraries": libraries(), "outputs": digests(given.keep)}
        file.write(json.dumps(made, indent=1) + "\n")


if __name__ == "__main__":
    main()
