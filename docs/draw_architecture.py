"""Draw the picture of docs/architecture.md from the code: rooms, their imports, and how data flows.

    python docs/draw_architecture.py --out docs/images/architecture.png
    python docs/draw_architecture.py --check

Rooms, sizes and imports are read from the sources by grimp, which comes with import-linter. Each hand-over in
`FLOW` names a type in the code; a type that no longer exists is an error. The PNG contains, as text, the
structure that was drawn. ``--check`` reports an outdated picture: other rooms or arrows, or a room whose size
differs by more than a tenth.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import grimp
import matplotlib
from PIL import Image

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.patches import FancyBboxPatch

ROOT = Path(__file__).parents[1]
FLOORS = ("wbf_mission", "sim_vehicle", "mission", "sensors", "geo")
ANSWERS = {
    "wbf_mission": "the whole job",
    "sim_vehicle": "who flies, and what it carries",
    "mission": "what to fly",
    "sensors": "what there is to sense, and what it tells",
    "geo": "where",
}
# Hand-overs: from room, to room, thing that is handed over, and type in the code that carries it.
FLOW = (
    ("geo", "wbf_mission.planning", "farm", "geo.farm:Farm"),
    ("wbf_mission.planning", "mission.planners", "request", "mission.planners.request:PlanningRequest"),
    ("mission.planners", "mission.transfer", "mission", "mission.model:Mission"),
    ("mission.transfer", "sim_vehicle.mavlink", "upload", "mission.transfer.verified:VerifiedUpload"),
    ("sensors.environment", "sensors.camera", "truth", "sensors.environment.environment:Environment"),
    ("sim_vehicle.mavlink", "sim_vehicle.camera", "telemetry", "sim_vehicle.mavlink.vehicle:SimVehicle"),
    ("sensors.camera", "sim_vehicle.camera", "leaf camera", "sensors.camera.leaf_camera:LeafCamera"),
    ("sim_vehicle.camera", "sensors.estimators", "observations", "sensors.observations:Observations"),
    ("sensors.estimators", "sensors.scoring", "model", "sensors.scoring.information:InformationModel"),
)
BLUE, GREY, ORANGE = "#dbe7f3", "#8a8f98", "#c8500a"
PICTURE = ROOT / "docs" / "images" / "architecture.png"
DRAWN_FROM = "Description"
"""Keyword of the PNG text that contains the drawn structure."""
OFF = 0.1


@dataclass(frozen=True, slots=True)
class Room:
    """A package below a floor, or the modules that lie on the floor itself."""

    name: str
    floor: str
    lines: int
    modules: int


def rooms_of(graph: grimp.ImportGraph) -> dict[str, Room]:
    """Return all rooms by name; the modules directly in a floor form a room with the floor's name."""
    sizes: dict[str, list[int]] = {}
    for module in graph.modules:
        path = ROOT / (module.replace(".", "/") + ".py")
        path = path if path.exists() else ROOT / module.replace(".", "/") / "__init__.py"
        sizes.setdefault(room_of(module, graph), []).append(
            len(path.read_text(encoding="utf-8").splitlines())
        )
    return {name: Room(name, name.split(".")[0], sum(lines), len(lines)) for name, lines in sizes.items()}


def room_of(module: str, graph: grimp.ImportGraph) -> str:
    """Return the room of a module: its package directly below the floor, or the floor."""
    parts = module.split(".")
    name = ".".join(parts[:2])
    return name if len(parts) > 1 and graph.find_children(name) else parts[0]


def arrows_of(graph: grimp.ImportGraph) -> dict[tuple[str, str], int]:
    """Return the number of imports from one room to another."""
    counts: dict[tuple[str, str], int] = {}
    for importer in graph.modules:
        for imported in graph.find_modules_directly_imported_by(importer):
            pair = room_of(importer, graph), room_of(imported, graph)
            if pair[0] != pair[1]:
                counts[pair] = counts.get(pair, 0) + 1
    return counts


def structure(rooms: dict[str, Room], arrows: dict[tuple[str, str], int]) -> dict[str, Any]:
    """Return the structure that a picture shows: sizes of rooms, arrows within floors, and hand-overs."""
    return {
        "rooms": {name: [room.modules, room.lines] for name, room in sorted(rooms.items())},
        "arrows": [list(pair) for pair in sorted(arrows) if is_drawn(*pair)],
        "flow": [list(one) for one in FLOW],
    }


def is_drawn(above: str, below: str) -> bool:
    """Return whether an arrow is drawn: only between two rooms of the same floor."""
    floor = above.split(".")[0]
    return floor == below.split(".")[0] and floor not in (above, below)


def differences(drawn: dict[str, Any], now: dict[str, Any]) -> list[str]:
    """Return the differences between a picture and the code, one line each."""
    lines = []
    for name in sorted({*drawn["rooms"], *now["rooms"]}):
        sizes = [one["rooms"].get(name, [0, 0]) for one in (drawn, now)]
        if any(abs(a - b) > OFF * max(a, b) for a, b in zip(*sizes, strict=True)):
            lines.append(f"{name}: drawn with {sizes[0]} modules and lines, has {sizes[1]}")
    for kind in ("arrows", "flow"):
        before, after = ({tuple(one) for one in parts[kind]} for parts in (drawn, now))
        lines += [f"{kind}: {' -> '.join(one[:2])} is drawn, and gone" for one in sorted(before - after)]
        lines += [f"{kind}: {' -> '.join(one[:2])} is not drawn" for one in sorted(after - before)]
    return lines


def check_flow() -> None:
    """Raise LookupError for a hand-over whose type is not in the code."""
    for _, _, _, where in FLOW:
        module, name = where.split(":")
        source = (ROOT / (module.replace(".", "/") + ".py")).read_text(encoding="utf-8")
        if f"class {name}" not in source:
            msg = f"FLOW names {where}, which is not in the code"
            raise LookupError(msg)


def levels(rooms: list[Room], arrows: dict[tuple[str, str], int]) -> dict[str, int]:
    """Return the level of each room in its floor. A room lies above all rooms of this floor that it imports.

    Modules directly in a floor form no room: they are drawn at the bottom, although some import rooms.
    """
    names = {room.name for room in rooms if room.name != room.floor}
    below = {name: {b for (a, b) in arrows if a == name and b in names} for name in names}
    height: dict[str, int] = {}
    while len(height) < len(names):
        ready = [name for name in sorted(names - set(height)) if below[name] <= set(height)]
        if not ready:
            msg = f"a circle of imports among {', '.join(sorted(names - set(height)))}"
            raise LookupError(msg)
        for name in ready:
            height[name] = max((height[one] + 1 for one in below[name]), default=0)
    return height


def place(
    rooms: dict[str, Room], arrows: dict[tuple[str, str], int]
) -> tuple[dict[str, tuple[float, float]], dict[str, tuple[float, float]]]:
    """Return the centres of the rooms, and the bottom and top of each floor."""
    centres: dict[str, tuple[float, float]] = {}
    bands: dict[str, tuple[float, float]] = {}
    bottom = 0.0
    for floor in reversed(FLOORS):
        own = [room for room in rooms.values() if room.floor == floor]
        height = {name: level + 1 for name, level in levels(own, arrows).items()} | {floor: 0}
        rows = max(height.values()) + 1
        for level in range(rows):
            row = sorted(name for name, at in height.items() if at == level)
            # Single rooms are placed alternately left and right, so that no arrow runs through them.
            shift = (-1.6, 1.6)[level % 2] if len(row) % 2 else 0.0
            for column, name in enumerate(row):
                centres[name] = (
                    5.0 + shift + (column - (len(row) - 1) / 2) * 2.4,
                    bottom + 0.5 + 0.85 * level,
                )
        bands[floor] = (bottom, bottom + 0.85 * rows + 0.15)
        bottom += 0.85 * rows + 0.4
    return centres, bands


def draw(out: Path) -> None:
    """Draw the picture."""
    check_flow()
    graph = grimp.build_graph(*FLOORS, cache_dir=None)
    rooms, arrows = rooms_of(graph), arrows_of(graph)
    centres, bands = place(rooms, arrows)
    top = bands[FLOORS[0]][1]
    figure, axes = plt.subplots(figsize=(16, 0.92 * top), layout="constrained")
    axes.set(xlim=(-1.9, 13.4), ylim=(-0.1, top + 0.1))
    axes.axis("off")
    for floor, (low, high) in bands.items():
        axes.add_patch(
            FancyBboxPatch(
                (-1.8, low),
                11.9,
                high - low,
                boxstyle="round,pad=0,rounding_size=0.1",
                facecolor="#f6f6f4",
                edgecolor="none",
                zorder=0,
            )
        )
        axes.text(-1.7, (low + high) / 2 + 0.12, floor, weight="bold", size=11, va="center")
        axes.text(-1.7, (low + high) / 2 - 0.16, "\n".join(_wrapped(ANSWERS[floor], 22)), size=7.5, va="top")
    for (above, below), count in sorted(arrows.items()):
        if not is_drawn(above, below):
            continue
        (x0, y0), (x1, y1) = centres[above], centres[below]
        axes.annotate(
            "",
            (x1, y1 + 0.24),
            (x0, y0 - 0.24),
            zorder=1,
            arrowprops={
                "arrowstyle": "-|>",
                "color": GREY,
                "lw": 0.5 + 0.12 * min(count, 12),
                "alpha": 0.5,
                "shrinkA": 0,
                "shrinkB": 0,
            },
        )
    for name, (x, y) in centres.items():
        room = rooms[name]
        axes.add_patch(
            FancyBboxPatch(
                (x - 0.58, y - 0.22),
                1.16,
                0.44,
                boxstyle="round,pad=0,rounding_size=0.06",
                facecolor=BLUE,
                edgecolor="#5b7fa6",
                lw=0.8,
                zorder=3,
            )
        )
        own = name.split(".")[-1] if "." in name else "(own modules)"
        axes.text(x, y + 0.05, own, ha="center", va="center", size=9, zorder=4)
        axes.text(
            x,
            y - 0.13,
            f"{room.modules} files, {room.lines:,} lines",
            ha="center",
            va="center",
            size=5.5,
            color="#444444",
            zorder=4,
        )
    for number, (start, end, what, where) in enumerate(FLOW, 1):
        (x0, y0), (x1, y1) = (centres[_shown(one, centres)] for one in (start, end))
        axes.annotate(
            "",
            (x1, y1),
            (x0, y0),
            zorder=5,
            arrowprops={
                "arrowstyle": "-|>",
                "color": ORANGE,
                "lw": 1.8,
                "shrinkA": 22,
                "shrinkB": 22,
                "connectionstyle": "arc3,rad=0.22",
            },
        )
        dx, dy = y1 - y0, -(x1 - x0)
        axes.text(
            (x0 + x1) / 2 + 0.11 * dx,
            (y0 + y1) / 2 + 0.11 * dy,
            str(number),
            size=9,
            color="white",
            ha="center",
            va="center",
            zorder=6,
            bbox={"boxstyle": "circle,pad=0.25", "facecolor": ORANGE, "edgecolor": "none"},
        )
        axes.text(
            10.4,
            top - 0.35 - 0.62 * (number - 1),
            f"{number}  {what}: {where.split(':')[1]}\n     {start} -> {end}",
            size=8,
            color=ORANGE,
            va="top",
        )
    drawn_from = json.dumps(structure(rooms, arrows))
    figure.savefig(out, dpi=110, metadata={"Software": None, DRAWN_FROM: drawn_from})
    plt.close(figure)


def check(picture: Path) -> list[str]:
    """Return the differences between the picture in a file and the code."""
    check_flow()
    graph = grimp.build_graph(*FLOORS, cache_dir=None)
    with Image.open(picture) as image:
        drawn = json.loads(image.info[DRAWN_FROM])
    return differences(drawn, structure(rooms_of(graph), arrows_of(graph)))


def _shown(name: str, centres: dict[str, tuple[float, float]]) -> str:
    return name if name in centres else name.split(".")[0]


def _wrapped(text: str, width: int) -> list[str]:
    lines = [""]
    for word in text.split():
        if len(lines[-1]) + len(word) + 1 > width:
            lines.append("")
        lines[-1] = f"{lines[-1]} {word}".strip()
    return lines


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=PICTURE)
    parser.add_argument("--check", action="store_true", help="only check that the picture matches the code")
    given = parser.parse_args()
    if given.check:
        found = check(given.out)
        sys.exit("\n".join([*found, f"{given.out}: draw it again"]) if found else 0)
    draw(given.out)
