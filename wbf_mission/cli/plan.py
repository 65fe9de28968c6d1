"""The command ``wbf-mission plan``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from geo.texts import distance, duration
from wbf_mission.cli import options
from wbf_mission.cli.options import MISSION_SUFFIXES, Force, Overwrite, option, refuse_overwrite
from wbf_mission.cli.output import Output, write_and_report
from wbf_mission.scenario import ScenarioError

if TYPE_CHECKING:
    from mission.model import GeoPoint
    from wbf_mission.planning import PlanResult
    from wbf_mission.planning.fleet import SingleVehicle
    from wbf_mission.planning.sorties import SortiePlan

EXAMPLES = """
Examples
wbf-mission plan --farm miniberry-100 --planner spiral --budget 25min --out spiral.plan
wbf-mission plan --farm waterberry --planner lawnmower --budget 8000m --out rows.waypoints
wbf-mission plan --farm my-farm.geojson --planner adaptive-lawnmower --json
wbf-mission plan --farm waterberry --vehicles 3 --partition voronoi --budget 10km --out part.plan
wbf-mission plan --farm waterberry --planner lawnmower --budget 40km --out rows.plan
wbf-mission plan --farm waterberry --planner lawnmower --budget 3batteries --out rows.plan
wbf-mission plan --farm waterberry --mission rows.plan --resume flight.tlog --out rest.plan
"""
BEGINNERS = (
    *("--farm", "--planner", "--policy", "--mission", "--budget", "--vehicle"),
    *("--autopilot", "--altitude", "--fence", "--wind", "--seed", "--out"),
)

_PANEL = "Sorties"
_DAY_S = 86_400.0
_RESTS = ("rest.plan", "rest.json", "plan.json")  # The last is the whole mission, if nothing else is there


@dataclass(frozen=True, slots=True)
class SortieOptions:
    """Options for a mission that takes more than one battery."""

    whole: Annotated[
        bool,
        option(
            "Do not cut the mission into sorties, even if it needs several batteries.",
            "--whole",
            panel=_PANEL,
        ),
    ] = False
    home: Annotated[
        list[str] | None,
        option(
            "Take-off and landing place, latitude and longitude in degrees; may be repeated; each sortie"
            " then uses the cheapest place.  [default: the mission's home]",
            panel=_PANEL,
            metavar="LAT,LON",
        ),
    ] = None
    overlap: Annotated[
        float | None,
        option(
            "Length of a sortie's end that the next sortie flies again, m.  [default: twice the distance"
            " between images, plus the length needed to line up with the row]",
            panel=_PANEL,
            parser=options.number,
        ),
    ] = None
    change_time: Annotated[
        float,
        option("Duration of a battery change, s.", panel=_PANEL, parser=options.number),
    ] = 180.0
    resume: Annotated[
        str | None,
        option(
            "Place from which to resume the mission file: an item (12), a distance on the leg to an item"
            " (12+35m), a telemetry log, a results folder, or the vehicle's link.",
            panel=_PANEL,
            metavar="FROM",
        ),
    ] = None

    def check(self, *, mission: str | None) -> None:
        """Raise ScenarioError if a number is out of range or options contradict each other."""
        for name, value, most in (("overlap", self.overlap, 1e4), ("change-time", self.change_time, _DAY_S)):
            if value is not None and not 0.0 <= value <= most:
                raise ScenarioError(f"--{name} {value:g} is out of range: give 0 to {most:g}")
        if self.resume is not None and mission is None:
            raise ScenarioError(
                "--resume continues a mission: give the mission file with --mission, too, or give --resume"
                " a results folder that has a mission"
            )
        others = [name for name in ("home", "overlap", "resume") if getattr(self, name) is not None]
        if self.whole and others:
            raise ScenarioError(f"--whole leaves the mission as it is: leave out --{others[0]} or --whole")

    def check_counted(self) -> None:
        """Raise ScenarioError if ``--whole`` is given, which contradicts a budget in batteries."""
        if self.whole:
            msg = "--whole leaves the mission whole, but a budget of batteries cuts it: leave out one of them"
            raise ScenarioError(msg)

    def with_run(self, given: options.Given) -> tuple[options.Given, SortieOptions]:
        """If ``--resume`` is a results folder, take its farm, vehicle, weather, camera and mission."""
        if self.resume is None:
            return given, self
        from wbf_mission.results.files import RECORD, own_vehicles
        from wbf_mission.results.writing import scenario_in
        from wbf_mission.scenario.files import scenario_from_table

        folder = Path(self.resume)
        if isinstance(recorded := scenario_in(folder), dict):
            run = scenario_from_table(recorded, folder / RECORD)
            parts = (run.farm, run.vehicle, run.weather, run.camera)
            own = {key: value for part in parts for key, value in part.values().items()}
            own["vehicle"] = own_vehicles(run, folder)
            if (farm := folder / "farm.geojson").is_file():
                own |= {"farm": str(farm), "crop": None, "farm_crs": None, "repair": False}
            given = replace(given, defaults={**given.defaults, **own})
        file = next((file for name in _RESTS if (file := folder / name).is_file()), None)
        if file is None or "mission" in given.changes:
            return given, self
        of_rest = replace(self, resume=None) if file.name != _RESTS[-1] else self
        return replace(given, changes={**given.changes, "mission": str(file)}), of_rest

    def homes(self, altitude_m: float) -> list[GeoPoint]:
        """Return the take-off places of sorties; raise ScenarioError if a text is not a position."""
        from geo.texts import parse_number
        from mission.errors import MissionError
        from mission.model import GeoPoint

        found = []
        for text in self.home or ():
            try:
                latitude, longitude = map(parse_number, text.split(","))
                found.append(GeoPoint(latitude, longitude, altitude_m))
            except (ValueError, MissionError):
                msg = f"--home {text}: give latitude and longitude in degrees, such as 28.05,-82.15"
                raise ScenarioError(msg) from None
        return found

    def cut(self, whole: PlanResult, vehicle: SingleVehicle) -> SortiePlan | None:
        """Cut a vehicle's mission into sorties; return None if the mission stays whole.

        Raise WbfMissionError if the mission cannot be cut, or cannot be resumed.
        """
        from wbf_mission.planning.sorties import sorties_of

        if self.whole or not (whole.is_too_long or self.home or self.resume is not None):
            return None
        begin = None
        if self.resume is not None:
            from mission.course import Course
            from wbf_mission.preflight.run import connection

            begin = connection("resume")(self.resume, Course(whole.mission))
        return sorties_of(
            whole,
            vehicle,
            begin=begin,
            homes=self.homes(whole.farm.frame.altitude_m),
            overlap_m=self.overlap,
            change_s=self.change_time,
        )

    def cut_or_warn(self, whole: PlanResult, vehicle: SingleVehicle, output: Output) -> SortiePlan | None:
        """Cut a vehicle's mission as `cut` does; if that is impossible, warn and return None.

        Raise ScenarioError in place of the warning if ``--resume`` or ``--home`` was given.
        """
        from wbf_mission.planning.sorties import UncutError

        try:
            return self.cut(whole, vehicle)
        except UncutError as error:
            for flag, value in {"--resume": self.resume, "--home": " ".join(self.home or ())}.items():
                if value:
                    raise ScenarioError(f"{flag} {value}: {error}") from error
            output.warn(str(error))
            return None


@options.scenario_options(
    *("farm", "mission", "vehicle", "weather", "camera"),
    without=(
        *options.OF_DAYS,
        *("turbulence", "gps_noise_m", "baro_noise_m", "radio_range_m"),
        *("camera_noise", "false_positive_rate", "false_negative_rate", "camera_fields"),
    ),
)
@options.speaks()
@options.gives("sorties", SortieOptions)
def plan_command(
    given: options.Given,
    output: Output,
    *,
    out: Annotated[
        Path | None,
        option(
            "Mission file to write: .plan (QGroundControl), .waypoints (WPL 110), .json (wbf-mission), .kml,"
            " .kmz, .geojson, .gpx, .csv, .wpml.kmz (DJI); several vehicles give NAME-1.plan, NAME-2.plan,"
            " ..., several sorties NAME-sortie-1.plan ...",
            panel="Output",
        ),
    ] = None,
    sorties: SortieOptions,
    overwrite: Overwrite = False,
    force: Force = False,
) -> None:
    """Plan a mission within a budget and predict its length, time, coverage and battery use.

    A mission that needs several batteries is cut into sorties where this costs least.
    """
    from mission.files import Firmware, writer_for
    from mission.transfer import Severity
    from wbf_mission.flight import check_flight
    from wbf_mission.planning.builder import budget_left, coverage_together, not_used
    from wbf_mission.planning.coverage import too_little_seen
    from wbf_mission.planning.fleet import single_vehicles
    from wbf_mission.preflight.run import check_plans
    from wbf_mission.run.plan import plan_fleet, plan_for_batteries
    from wbf_mission.scenario.values import batteries_in

    given, sorties = sorties.with_run(given)
    chosen = given.scenario()
    batteries = batteries_in(chosen.mission.budget)
    if batteries is not None:
        sorties.check_counted()
        chosen = replace(chosen, mission=replace(chosen.mission, budget=None))
    sorties.check(mission=chosen.mission.file)
    if given.file is not None or chosen.farm.fields:
        check_flight(chosen)
    inputs = [given.file, chosen.farm.name, *chosen.farm.fields, chosen.mission.file, *chosen.vehicle.names]
    inputs.append(sorties.resume)
    outs = numbered_files(out, len(chosen.vehicle.fleet))

    def refuse(paths: Sequence[Path | None]) -> None:
        for path in paths:
            refuse_overwrite(path, inputs, suffixes=MISSION_SUFFIXES, overwrite=overwrite)
            if path is not None:
                writer_for(path)

    refuse(outs)
    with output.progress() as progress:
        progress("planning", 0, 1)
        vehicles = single_vehicles(chosen)
        if batteries is None:
            results = plan_fleet(chosen, progress=progress)
            cuts = [
                sorties.cut_or_warn(result, vehicle, output)
                for result, vehicle in zip(results, vehicles, strict=True)
            ]
        else:
            whole, cut = plan_for_batteries(
                chosen, batteries, lambda whole: sorties.cut(whole, vehicles[0]), progress=progress
            )
            results, cuts = (whole,), [cut]
        progress("planning", 1, 1)
    flown = [(result,) if cut is None else cut.plans for result, cut in zip(results, cuts, strict=True)]
    files = [numbered_files(path, len(plans), "-sortie") for path, plans in zip(outs, flown, strict=True)]
    for paths in files:
        refuse(paths)
    check_plans(
        [(plan, vehicle) for plans, vehicle in zip(flown, vehicles, strict=True) for plan in plans],
        "nothing was written",
        output.events,
        force=force,
    )
    every = [plan for plans in flown for plan in plans]
    for warning in dict.fromkeys(warning for plan in every for warning in plan.warnings):
        output.warn(warning)
    coverage = coverage_together(results, chosen.camera.footprint)
    if unseen := too_little_seen(coverage, whole=results[0].asks_whole):
        output.warn(unseen)
    output.notes(results[0].farm.notes, "farm")
    if chosen.mission.policy is None:
        unused = [budget_left(plans) for plans in flown]
        if batteries is not None and len(flown[0]) < batteries:
            unused = [not_used(str(len(flown[0])), results[0].budget_text)]
        output.notes(filter(None, dict.fromkeys(unused)))
    remarks = [remark for plan in every for remark in plan.rendered.remarks]
    output.notes(dict.fromkeys(str(remark) for remark in remarks if remark.severity is Severity.NOTE))
    for plan, path in zip(every, chain.from_iterable(files), strict=True):
        if path is not None:
            write_and_report(output, plan.mission, path, Firmware(plan.mav_autopilot))
    values, tables = [], []
    for result, cut, paths in zip(results, cuts, files, strict=True):
        file = {"file": str(paths[0]) if paths[0] else None}
        values.append({**result.summary(), **file} if cut is None else sortie_summary(cut, paths))
        tables.append(_rows(result, paths[0]) if cut is None else _rows_of_sorties(cut, paths))
    if len(results) == 1:
        output.result(values[0], tables[0], title="Plan")
    else:
        rows = [
            [str(number), *(shown[name] for name in _OF_EACH)] for number, shown in enumerate(tables, start=1)
        ]
        title = f"{results[0].farm.name}: {results[0].planner}, {results[0].budget_text} each"
        last_s = max(finish_s(*planned) for planned in zip(results, cuts, strict=True))
        together = {"vehicles": len(results), "finish_s": last_s, "plans": values}
        output.table(together, ["", *_OF_EACH], rows, title=title, left=True)
    for number, (cut, paths) in enumerate(zip(cuts, files, strict=True), start=1):
        if cut is not None and not output.as_json:
            whose = f" of vehicle {number}" if len(cuts) > 1 else ""
            output.table(None, SORTIE_HEADER, sortie_rows(cut, paths), title=f"Sorties{whose}", left=True)
    if len(cuts) > 1 and any(cuts) and not output.as_json:
        output.table(None, FLEET_HEADER, fleet_rows(results, cuts), title="Fleet", left=True)


_OF_EACH = (
    "vehicle",
    "waypoints",
    "row spacing",
    "length",
    "predicted time",
    "coverage",
    "battery use",
    "file",
)
"""Columns of the table that shows a fleet's plans."""


def _rows_of_sorties(cut: SortiePlan, paths: Sequence[Path | None]) -> dict[str, str]:
    """Return the rows of the table that shows a plan in sorties."""
    rows, count = _rows(cut.whole, None), len(cut.sorties)
    used = [plan.battery_used for plan in cut.plans if plan.battery_used is not None]
    lengths_m = sum(plan.length_m for plan in cut.plans)
    changed = {
        "length": f"{distance(lengths_m)} over ground, as predicted",
        "predicted time": f"{duration(cut.flight_s)} in the air, {duration(cut.total_s)} with the changes"
        if count > 1
        else duration(cut.flight_s),
        "battery use": f"at most {max(used):.1%} in a sortie" if used else "none",
        "batteries": str(count),
        "file": ", ".join(map(str, paths)) if paths[0] is not None else rows["file"],
    }
    return {**rows, **changed}


def _camera_rows(result: PlanResult) -> dict[str, str]:
    """Return the rows about a camera given by sensor and lens; no rows for the leaf camera."""
    camera = result.camera
    if camera is None:
        return {}
    in_time = "" if camera["interval_speed_m_s"] is None else ", no gaps up to {interval_speed_m_s:.1f} m/s"
    forms = {
        "camera": "{name}: {gsd_cm:.2f} cm a pixel at {height_m:.1f} m",
        "image": "{footprint_across_m:.1f} m across the flight, {footprint_along_m:.1f} m along",
        "overlap": "{front_overlap:.0%} front, {side_overlap:.0%} side",
        "images": "{images}, one every {image_distance_m:.1f} m",
        "speed": "{speed_m_s:.1f} m/s (sharp images up to {blur_speed_m_s:.1f} m/s" + in_time + ")",
    }
    return {label: form.format_map(camera) for label, form in forms.items()}


def _rows(result: PlanResult, path: Path | None) -> dict[str, str]:
    """Return the rows of the table that shows a plan."""
    prediction, battery = result.prediction, result.battery_used
    time = duration(prediction.duration_s)
    if prediction.duration_interval_s is not None:
        low, high = map(duration, prediction.duration_interval_s)
        time += f" (90 %: {low} to {high})"
    return {
        "farm": result.farm.name,
        "planner": result.planner or "none (mission file)",
        "vehicle": result.vehicle.name,
        "budget": result.budget_text,
        "waypoints": str(len(result.path_m)),
        "row spacing": "-" if result.spacing_m is None else distance(result.spacing_m),
        "length": f"{distance(result.length_m)} over ground, as predicted",
        "predicted time": time,
        **_camera_rows(result),
        "coverage": f"{result.coverage:.2%} of the land to be seen, as predicted",
        "battery use": "none" if battery is None else f"{battery:.1%}",
        "batteries": "never enough" if result.batteries is None else str(result.batteries),
        "file": str(path) if path else "not written (give --out FILE)",
    }


def numbered_files(out: Path | None, count: int, what: str = "") -> list[Path | None]:
    """Return a numbered file name for each of several missions; a single mission keeps the name `out`.

    >>> [str(file) for file in numbered_files(Path("rows.plan"), 2, "-sortie")]
    ['rows-sortie-1.plan', 'rows-sortie-2.plan']
    """
    if out is None or count == 1:
        return [out] * count
    from mission.files import ending

    stem = out.name[: len(out.name) - len(ending(out))]
    return [out.with_name(f"{stem}{what}-{number}{ending(out)}") for number in range(1, count + 1)]


SORTIE_HEADER = ["", "items", "length", "time", "at most", "battery use", "from", "to", "file"]


def sortie_rows(cut: SortiePlan, files: Sequence[Path | None]) -> list[list[str]]:
    """Return a row of the table for each sortie, and a row of totals."""
    rows = []
    for number, (sortie, path) in enumerate(zip(cut.sorties, files, strict=True), start=1):
        plan, battery = sortie.plan, sortie.plan.battery_used
        rows.append(
            [
                str(number),
                str(len(plan.mission.items)),
                distance(plan.length_m),
                duration(plan.prediction.duration_s),
                f"{plan.prediction.most_wh:.1f} Wh",
                "-" if battery is None else f"{battery:.1%}",
                str(sortie.begin),
                "the end" if sortie.end is None else str(sortie.end),
                "-" if path is None else str(path),
            ]
        )
    lengths_m = sum(plan.length_m for plan in cut.plans)
    most_wh = sum(plan.prediction.most_wh for plan in cut.plans)
    total = [distance(lengths_m), duration(cut.flight_s), f"{most_wh:.1f} Wh"]
    return [*rows, ["all", "", *total, "", "", "", ""]]


FLEET_HEADER = ["", "sorties", "in the air", "with the changes"]


def finish_s(result: PlanResult, cut: SortiePlan | None) -> float:
    """Return the time (s) of a vehicle's whole plan, battery changes included."""
    return result.prediction.duration_s if cut is None else cut.total_s


def fleet_rows(results: Sequence[PlanResult], cuts: Sequence[SortiePlan | None]) -> list[list[str]]:
    """Return a row of totals for each vehicle, and a row with the time at which the last vehicle ends."""
    rows, every_s = [], [finish_s(*planned) for planned in zip(results, cuts, strict=True)]
    for number, (result, cut, total_s) in enumerate(zip(results, cuts, every_s, strict=True), start=1):
        aloft_s = result.prediction.duration_s if cut is None else cut.flight_s
        count = 1 if cut is None else len(cut.sorties)
        rows.append([f"vehicle {number}", str(count), duration(aloft_s), duration(total_s)])
    return [*rows, ["all together", "", "", duration(max(every_s))]]


def sortie_summary(cut: SortiePlan, files: Sequence[Path | None]) -> dict[str, Any]:
    """Return the summary of a mission in sorties as plain values, for JSON."""
    values = cut.summary()
    names = [None if path is None else str(path) for path in files]
    for sortie, name in zip(values["sorties"], names, strict=True):
        sortie["file"] = name
    return {**values, "file": names[0] if len(names) == 1 else None}
