"""Surveys of 50 real fields: the planner `survey` beside QGroundControl's survey item and Fields2Cover.

    python benchmarks/coverage_planning.py [--fields 50] [--swaths FILE] [--write-fields FILE] [--json FILE]

Every field (`fields.json`, with sources and licences) is to be seen by one camera at one height, in rows at
the distance of its side overlap. All paths are flown by the same vehicle's model, straight from point to
point, with start and landing beside the field, in calm air and in wind. QGroundControl's transects are a
reimplementation of the method that its ``SurveyComplexItem.cc`` has: lines at an angle through the centre
of the bounds, from the first crossing of the border to the last, to and fro, from the nearest entry. Its
angle is the user's; here it is that with the fewest rows. Fields2Cover's swaths come from the program
itself: ``--write-fields`` writes what its runner reads (name, swath width, whether it decomposes the field,
WKT), ``--swaths`` reads what that printed.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import shapely
from shapely.geometry import Polygon

from geo.frame import LocalFrame
from mission.planners import PlannedPath, PlanningRequest, build_mission
from mission.planners.cuts import hull_angles
from mission.planners.path import Points, path_length
from mission.planners.survey import survey
from sensors.camera.optics import Imaging, get_camera
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.airframe.spec import VehicleSpec
from sim_vehicle.autopilot import firmware_of, with_autopilot
from sim_vehicle.prediction.predict import expected_flights
from sim_vehicle.weather.wind import Wind

FIELDS = Path(__file__).with_name("fields.json")
FRAME = LocalFrame(55.0, 10.0)
CAMERA = Imaging(get_camera("sentera-6x"), 60.0, 0.75, 0.7)
WIND_M_S, FROM_DEG = 6.0, 240.0
_AWAY_M = 20.0
_TURN_RAD = math.radians(30.0)
_THREADS = 2
BASE = "survey, border=overlap"


@dataclass(frozen=True, slots=True)
class Sky:
    """A vehicle in an air: what a path takes, in seconds; a budget without a limit."""

    vehicle: VehicleSpec
    home_m: tuple[float, float]
    wind: Wind | None
    limit: float = 1e9
    unit: str = "s"

    def costs(self, paths_xy_m: Sequence[Points]) -> list[float]:
        """Return the predicted seconds of flights through paths that begin at home."""
        firmware = firmware_of(self.vehicle)
        assert firmware is not None
        missions = [
            build_mission(
                PlannedPath(path[1:], None, "candidate"),
                frame=FRAME,
                home_xy_m=self.home_m,
                altitude_m=CAMERA.height_m,
                speed_m_s=self.vehicle.cruise_speed_m_s,
                camera_distance_m=CAMERA.image_distance_m,
                cornering=firmware.cornering,
            )
            for path in paths_xy_m
        ]
        flown = expected_flights(missions, self.vehicle, wind=self.wind, threads=_THREADS, endless=True)
        return [one.duration_s if one.feasible else math.inf for one in flown]

    def cost(self, path_xy_m: Points) -> float:
        """Return the predicted seconds of one of them."""
        return self.costs([path_xy_m])[0]


def qgc_transects(field: Polygon, spacing_m: float, start_m: Points) -> Points:
    """Return the survey item's transects to and fro: its angle that of the fewest rows, no turnaround."""
    angle = hull_angles(field)[0]
    low_x, low_y, high_x, high_y = field.bounds
    centre = np.array([0.5 * (low_x + high_x), 0.5 * (low_y + high_y)])
    half = 0.5 * (max(high_x - low_x, high_y - low_y) + 2000.0)
    along, across = (
        np.array([math.cos(angle), math.sin(angle)]),
        np.array([-math.sin(angle), math.cos(angle)]),
    )
    rows = []
    for offset in np.arange(-half, half, spacing_m):
        middle = centre + offset * across
        line = shapely.linestrings([middle - half * along, middle + half * along])
        met = shapely.get_coordinates(shapely.intersection(line, field.exterior))
        if len(met) > 1:
            order = np.argsort(met @ along)
            rows.append(met[order[[0, -1]]])
    entries = [
        [row[::-1] if turned else row for row in (rows[::-1] if last else rows)]
        for last in (False, True)
        for turned in (False, True)
    ]
    best = min(entries, key=lambda one: math.dist(one[0][0], start_m))
    return np.vstack([row[:: -1 if k % 2 else 1] for k, row in enumerate(best)])


def fields_to_cover(text: str) -> dict[str, list[Points]]:
    """Return the paths of the runner's lines, straight from swath to swath.

    A line is ``name~variant|cell x y x y;...``: the order of swaths begins at one of four corners.
    """
    found: dict[str, list[Points]] = {}
    for line in text.splitlines():
        name, _, swaths = line.partition("|")
        ends = [[float(one) for one in each.split()[1:]] for each in swaths.split(";") if each.strip()]
        if ends:
            found.setdefault(name.partition("~")[0], []).append(np.array(ends).reshape(-1, 2))
    return found


@dataclass(frozen=True, slots=True)
class Measured:
    """A path over a field."""

    covered: float  # Share of the field that its images show
    flown: float  # Its length times the distance of rows, over the field's area: 1 if nothing is seen twice
    length_m: float
    turns: int
    calm_s: float
    wind_s: float


def measured(
    path: Points, field: Polygon, calm: Sky, windy: Sky, wind_path: Points | None = None
) -> Measured:
    """Measure a path, and in wind another one if the planner makes one for it."""
    steps = np.diff(path, axis=0)
    steps = steps[np.hypot(*steps.T) > 0.5]
    headings = np.arctan2(steps[:, 1], steps[:, 0])
    turns = np.abs((np.diff(headings) + math.pi) % (2 * math.pi) - math.pi)
    start = np.asarray(calm.home_m)
    return Measured(
        covered=shown(path, field),
        flown=path_length(path) * CAMERA.row_spacing_m / field.area,
        length_m=path_length(np.vstack((start, path, start))),
        turns=int(np.count_nonzero(turns > _TURN_RAD)),
        calm_s=calm.cost(np.vstack((start, path))),
        wind_s=windy.cost(np.vstack((start, path if wind_path is None else wind_path))),
    )


def shown(path: Points, field: Polygon) -> float:
    """Return the share of a field that rectangles of the image's size show along a path's legs."""
    seen = []
    for begin, end in itertools.pairwise(path):
        length = math.dist(begin, end)
        if length < 0.5:
            continue
        along = (end - begin) / length
        across = np.array([-along[1], along[0]])
        ahead, aside = 0.5 * CAMERA.sure_along_m * along, 0.5 * CAMERA.across_m * across
        seen.append([begin - ahead - aside, begin - ahead + aside, end + ahead + aside, end + ahead - aside])
    images = shapely.union_all(shapely.polygons(seen))
    return float(shapely.intersection(images, field).area / field.area)


def fields(count: int) -> Iterator[tuple[str, Polygon]]:
    """Yield the names and outlines of the fields."""
    for one in json.loads(FIELDS.read_text("utf-8"))["fields"][:count]:
        yield one["name"], Polygon(one["rings"][0], one["rings"][1:])


def compare(name: str, field: Polygon, others: dict[str, dict[str, list[Points]]]) -> dict[str, Measured]:
    """Return what each method's path over a field measures."""
    low_x, low_y, _, _ = field.bounds
    home = (low_x - _AWAY_M, low_y - _AWAY_M)
    vehicle = with_autopilot(get_vehicle("mapping-quad"), "px4", {})
    calm = Sky(vehicle, home, None)
    windy = Sky(vehicle, home, Wind.from_direction(WIND_M_S, FROM_DEG))

    def asked(sky: Sky) -> PlanningRequest:
        return PlanningRequest(
            field,
            home,
            sky,
            CAMERA.across_m,
            row_spacing_m=CAMERA.row_spacing_m,
            footprint_along_m=CAMERA.sure_along_m,
        )

    found = {}
    for border in ("overlap", "seen"):
        rows = survey(asked(calm), border=border).points_m
        in_wind = survey(asked(windy), border=border).points_m
        found[f"survey, border={border}"] = measured(rows, field, calm, windy, in_wind)
    narrowest = math.degrees(hull_angles(field)[0])
    fewest = survey(asked(calm), border="overlap", angle=narrowest).points_m
    found["the same, the fewest rows"] = measured(fewest, field, calm, windy)
    transects = qgc_transects(field, CAMERA.row_spacing_m, np.asarray(home))
    found["QGroundControl's transects"] = measured(transects, field, calm, windy)
    for method, paths in others.items():
        if name in paths:
            # The corner to begin at is the user's choice: the best one.
            starts = [np.vstack((home, path)) for path in paths[name]]
            best = int(np.argmin(calm.costs(starts)))
            found[method] = measured(paths[name][best], field, calm, windy)
    return found


def table(results: Sequence[dict[str, Measured]]) -> str:
    """Return the comparison: medians over the fields, of lengths and times as shares of the survey's own."""
    lines = [
        "| method | fields | covered, worst | flown | length | turns | time, calm | time, wind |",
        "|" + "---|" * 8,
    ]
    methods = list(dict.fromkeys(name for one in results for name in one))
    for method in methods:
        pairs = [(one[method], one[BASE]) for one in results if method in one]
        covered = [a.covered for a, _ in pairs]
        lines.append(
            f"| {method} | {len(pairs)} | {np.median(covered):.2%}, {min(covered):.1%} |"
            f" {np.median([a.flown for a, _ in pairs]):.2f} |"
            f" {_ratios([a.length_m / b.length_m for a, b in pairs])} |"
            f" {_ratios([a.turns / max(b.turns, 1) for a, b in pairs])} |"
            f" {_ratios([a.calm_s / b.calm_s for a, b in pairs])} |"
            f" {_ratios([a.wind_s / b.wind_s for a, b in pairs])} |"
        )
    return "\n".join(lines)


def _ratios(values: Sequence[float]) -> str:
    """Return the median of ratios, and the least and the greatest."""
    return f"{np.median(values):.2f} ({min(values):.2f} to {max(values):.2f})"


def main() -> None:
    """Compare, and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--fields", type=int, default=50, help="how many fields")
    parser.add_argument("--swaths", type=Path, help="what the runner of Fields2Cover printed")
    parser.add_argument("--write-fields", type=Path, help="write what that runner reads, and end")
    parser.add_argument("--json", type=Path, help="write all measures there")
    options = parser.parse_args()
    if options.write_fields:
        lines = [
            f"{name}{'+' if cut else ''} {CAMERA.row_spacing_m:.6f} {cut} {field.wkt}"
            for name, field in fields(options.fields)
            for cut in (0, 1)
        ]
        options.write_fields.write_text("\n".join(lines) + "\n", "utf-8")
        return
    others: dict[str, dict[str, list[Points]]] = {}
    if options.swaths:
        paths = fields_to_cover(options.swaths.read_text("utf-8"))
        others["Fields2Cover"] = {name: path for name, path in paths.items() if not name.endswith("+")}
        cut = {name[:-1]: path for name, path in paths.items() if name.endswith("+")}
        others["Fields2Cover, decomposed"] = cut
    results = {}
    for name, field in fields(options.fields):
        results[name] = compare(name, field, others)
        print(name, {method: round(one.calm_s) for method, one in results[name].items()}, flush=True)
    if options.json:
        measures = {name: {key: asdict(one) for key, one in each.items()} for name, each in results.items()}
        options.json.write_text(json.dumps(measures, indent=1), "utf-8")
    print(table(list(results.values())))


if __name__ == "__main__":
    main()
