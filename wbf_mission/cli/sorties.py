"""Options of sorties, and the tables of a mission in sorties."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from geo.texts import distance, duration
from wbf_mission.cli import options
from wbf_mission.cli.options import option
from wbf_mission.scenario import ScenarioError

if TYPE_CHECKING:
    from mission.model import GeoPoint
    from wbf_mission.planning import PlanResult
    from wbf_mission.planning.fleet import SingleVehicle
    from wbf_mission.planning.sorties import SortiePlan

_PANEL = "Sorties"
_DAY_S = 86_400.0
_REST = "rest.plan"


@dataclass(frozen=True, slots=True)
class SortieOptions:
    """Options for a mission that is longer than a battery."""

    whole: Annotated[
        bool,
        option(
            "Keep a mission that is longer than a battery whole, instead of cutting it into sorties.",
            "--whole",
            panel=_PANEL,
        ),
    ] = False
    home: Annotated[
        list[str] | None,
        option(
            "Take-off and landing place, latitude and longitude in degrees; may be repeated: each sortie uses"
            " the place that costs least.  [default: the mission's home]",
            panel=_PANEL,
            metavar="LAT,LON",
        ),
    ] = None
    overlap: Annotated[
        float | None,
        option(
            "Length flown again where the next sortie begins, m.  [default: twice the distance between "
            "images,"
            " plus the length needed to line up with the row]",
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
            "Place from which to resume the mission file: an item (12), metres on the leg to it (12+35m), a"
            " telemetry log, a results folder, or the vehicle's link.",
            panel=_PANEL,
            metavar="FROM",
        ),
    ] = None

    def check(self, *, mission: str | None) -> None:
        """Raise ScenarioError for numbers out of range and options that contradict each other."""
        for name, value, most in (("overlap", self.overlap, 1e4), ("change-time", self.change_time, _DAY_S)):
            if value is not None and not 0.0 <= value <= most:
                msg = f"--{name} {value:g} is out of range: give 0 to {most:g}"
                raise ScenarioError(msg)
        if self.resume is not None and mission is None:
            msg = (
                "--resume continues a mission that was flown: give its file with --mission, too (or the"
                f" results of a flight that left a {_REST})"
            )
            raise ScenarioError(msg)
        others = [name for name in ("home", "overlap", "resume") if getattr(self, name) is not None]
        if self.whole and others:
            msg = f"--whole leaves the mission as it is: leave --{others[0]} out, or --whole"
            raise ScenarioError(msg)

    def check_counted(self) -> None:
        """Raise ScenarioError for options that contradict a budget in batteries."""
        if self.whole:
            msg = "--whole leaves the mission as it is, a budget of batteries cuts it: leave one of them out"
            raise ScenarioError(msg)

    def with_rest(self, given: options.Given) -> tuple[options.Given, SortieOptions]:
        """Return the given options with the mission file of a results folder's remaining mission, if any."""
        if self.resume is None or "mission" in given.changes:
            return given, self
        rest = Path(self.resume) / _REST
        if not rest.is_file():
            return given, self
        return replace(given, changes={**given.changes, "mission": str(rest)}), replace(self, resume=None)

    def homes(self, altitude_m: float) -> list[GeoPoint]:
        """Return the take-off places of sorties; ScenarioError if one is not a position."""
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
        """Return a vehicle's mission in sorties; None if it stays whole.

        WbfMissionError if the mission cannot be resumed.
        """
        from wbf_mission.planning.sorties import sorties_of

        if self.whole or not (whole.is_too_long or self.home or self.resume):
            return None
        begin = None
        if self.resume is not None:
            from mission.course import Course
            from wbf_mission.flight import connection

            begin = connection("resume")(self.resume, Course(whole.mission))
        return sorties_of(
            whole,
            vehicle,
            begin=begin,
            homes=self.homes(whole.farm.frame.altitude_m),
            overlap_m=self.overlap,
            change_s=self.change_time,
        )


def numbered_files(out: Path | None, count: int, what: str = "") -> list[Path | None]:
    """Return numbered file names for several missions; a single mission keeps the name `out`.

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
    """Return a row for each sortie, and a row of totals."""
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
    """Return the time of a vehicle's whole plan, battery changes included (s)."""
    return result.prediction.duration_s if cut is None else cut.total_s


def fleet_rows(results: Sequence[PlanResult], cuts: Sequence[SortiePlan | None]) -> list[list[str]]:
    """Return a row of totals for each vehicle, and a row with the time of the last one."""
    rows, every_s = [], [finish_s(*planned) for planned in zip(results, cuts, strict=True)]
    for number, (result, cut, total_s) in enumerate(zip(results, cuts, every_s, strict=True), start=1):
        aloft_s = result.prediction.duration_s if cut is None else cut.flight_s
        count = 1 if cut is None else len(cut.sorties)
        rows.append([f"vehicle {number}", str(count), duration(aloft_s), duration(total_s)])
    return [*rows, ["all together", "", "", duration(max(every_s))]]


def sortie_summary(cut: SortiePlan, files: Sequence[Path | None]) -> dict[str, Any]:
    """Return a mission in sorties as plain values, for JSON."""
    values = cut.summary()
    names = [None if path is None else str(path) for path in files]
    for sortie, name in zip(values["sorties"], names, strict=True):
        sortie["file"] = name
    return {**values, "file": names[0] if len(names) == 1 else None}
