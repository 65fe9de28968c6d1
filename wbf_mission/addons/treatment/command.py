"""Command ``wbf-mission map``."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from geo.texts import duration
from wbf_mission.cli import options
from wbf_mission.cli.command import Command
from wbf_mission.cli.options import MISSION_SUFFIXES, Force, TargetError, option, refuse_overwrite
from wbf_mission.cli.output import Output, write_and_report
from wbf_mission.scenario import ScenarioError

if TYPE_CHECKING:
    from wbf_mission.addons.treatment.next_flight import NextFlight
    from wbf_mission.addons.treatment.treatment_map import TreatmentMap
    from wbf_mission.scenario import Scenario

EXAMPLES = """
Examples
wbf-mission map --log flight.tlog --farm my-farm.geojson --out map
wbf-mission map --log 00000012.BIN --observations leaves.csv --farm my-farm.geojson --estimator gp --out map
wbf-mission map --log pictures/ --observations leaves.csv --fields tylcv --treat-cost 300 --out map
wbf-mission map --log runs/mine --out map --next again.plan --budget 10min --policy orienteering
"""
BEGINNERS = (
    *("--log", "--observations", "--farm", "--fields", "--estimator", "--treat-cost"),
    *("--loss", "--next", "--budget", "--vehicle", "--out", "--overwrite"),
)

_COSTS = "Costs"
_NEXT = "The next flight"
_HOW = "[FIELD=]NUMBER, may be repeated"
_OF_NEXT = (
    *("policy", "budget", "altitude_m", "cruise_speed_m_s", "acceptance_radius_m", "margin_m"),
    "fence_m",
    *("vehicle", "autopilot", "parameters", "wind_speed_m_s", "wind_direction_deg", "wind_gust_m_s"),
)
"""Options that affect only the next flight."""


def _cost(text: str, metavar: str = "COST") -> Any:
    return option(text, panel=_COSTS, metavar=metavar)


_Texts = list[str] | None


@dataclass(frozen=True, slots=True)
class _Costs:
    """Options of costs, thresholds and treatment rates."""

    treat_cost: Annotated[
        _Texts,
        _cost(
            f"Cost of treating a hectare, in any currency: {_HOW}.  [default: from --loss, by the ratio of "
            f"the field's error costs]"
        ),
    ] = None
    loss: Annotated[
        _Texts,
        _cost(
            f"Loss on an untreated hectare that needs treatment: {_HOW}.  [default: from --treat-cost, by "
            f"the ratio of the field's error costs]"
        ),
    ] = None
    look_cost: Annotated[
        _Texts,
        _cost(
            f"Cost of another look at a hectare: {_HOW}.  [default: a tenth of --treat-cost, an assumption]"
        ),
    ] = None
    low_below: Annotated[
        _Texts,
        _cost(f"Treatment threshold of a continuous field: {_HOW}.  [default: 0.4, an assumption]", "VALUE"),
    ] = None
    rate: Annotated[
        _Texts,
        _cost(
            "Application rate on treated land: [FIELD=]NUMBER[UNIT], may be repeated.  [default: 200L/ha;"
            " for soil humidity 10mm]",
            "RATE",
        ),
    ] = None
    block: Annotated[
        float | None,
        option(
            "Side of a block, the smallest area a sprayer can treat (m).  [default: 4, less on small farms]",
            panel=_COSTS,
            parser=options.number,
        ),
    ] = None

    def given(self) -> dict[str, list[str]]:
        """Return the given options as arguments of `wbf_mission.addons.treatment.treatment_map.costs_of`."""
        if self.block is not None and not 0.01 <= self.block <= 1000.0:
            raise ScenarioError(f"--block {self.block:g} is out of range: give 0.01 to 1000 metres")
        every = (self.treat_cost, self.loss, self.look_cost, self.low_below, self.rate)
        keys = ("treat", "loss", "look", "below", "rate")
        return {key: texts for key, texts in zip(keys, every, strict=True) if texts}


@options.scenario_options(
    *("farm", "estimate", "mission", "vehicle", "weather", "camera"),
    without=(
        *("days", "flights_per_day", "world", "planner", "mission", "partition", "vehicles", "separation"),
        *("turbulence", "gps_noise_m", "baro_noise_m", "estimate_errors", "radio_range_m", "camera_noise"),
        *("false_positive_rate", "false_negative_rate", "camera_fields", "camera_spacing_m"),
        *("wind_shear", "wind_roughness_m", "wind_exponent", "wind_height_m"),
    ),
)
@options.speaks()
@options.gives("costs", _Costs)
def map_command(
    given: options.Given,
    output: Output,
    *,
    out: Annotated[Path, option("Folder for the map.", panel=options.OUTPUT_PANEL)],
    log: Annotated[
        Path | None,
        option(
            "Camera positions: a .tlog, an ArduPilot .bin, a PX4 .ulg, a folder of geotagged pictures, or the"
            " results of 'fly'.",
            panel="What was flown",
        ),
    ] = None,
    observations: Annotated[
        Path | None,
        option(
            "Camera readings: the observations of 'fly', or a CSV file with a column for each field and one "
            "column 'time', 'name' or 'image' (or two, 'latitude' and 'longitude'). [default: readings in "
            "the .tlog or results]",
            panel="What was flown",
        ),
    ] = None,
    costs: _Costs,
    next_plan: Annotated[
        Path | None,
        option(
            "Plan the next flight, for the largest expected saving, and write the mission to this file.",
            "--next",
            panel=_NEXT,
        ),
    ] = None,
    overwrite: Annotated[
        bool,
        option(
            "Replace an existing map, or write into a folder with other files.",
            "--overwrite",
            panel=options.OUTPUT_PANEL,
        ),
    ] = False,
    force: Force = False,
) -> None:
    """Make the treatment map of a flight: GeoTIFF, zones, prescriptions, a page for the farmer."""
    from mission.files import Firmware
    from wbf_mission.addons.treatment.gis import require_gis
    from wbf_mission.addons.treatment.map_files import write_map

    require_gis()
    inputs = [given.file, log, observations]
    _check_next(given, next_plan, inputs, overwrite=overwrite)
    with _folder(out, inputs, overwrite=overwrite) as folder, output.progress() as progress:
        of, scenario = _treatment(given, log, observations, costs, progress)
        output.notes(of.farm.notes, "farm")
        for note in of.notes:
            output.warn(note)
        flight = None
        if next_plan is not None:
            from wbf_mission.addons.treatment.next_flight import plan_next
            from wbf_mission.preflight.run import check_plans

            flight = plan_next(of, scenario, progress=progress)
            checked = [(flight.plan, flight.vehicle)]
            check_plans(checked, "nothing was written", output.events, force=force)
            for warning in flight.plan.warnings:
                output.warn(warning)
        planned = None if flight is None else flight.summary()
        files = write_map(of, folder.filled, progress, next=planned)
        if flight is not None and next_plan is not None:
            write_and_report(output, flight.plan.mission, next_plan, Firmware(flight.plan.mav_autopilot))
        folder.commit()
    summary = {**of.summary(), "next": planned, "files": [str(out / file.name) for file in files]}
    output.result(summary, _rows(of, flight, out, next_plan), title=f"{of.farm.name}: treatment map")


def _treatment(
    given: options.Given, log: Path | None, observations: Path | None, costs: _Costs, progress: Any
) -> tuple[TreatmentMap, Scenario]:
    """Return the treatment map and the scenario of the next flight."""
    from wbf_mission.addons.treatment.flights import treatment_of_log, treatment_of_result
    from wbf_mission.results.files import RECORD

    wanted: dict[str, Any] = {"costs": costs.given(), "block_m": costs.block}
    if log is None or not (log / RECORD).is_file():
        scenario = given.scenario()
        return (
            treatment_of_log(scenario, log=log, observations=observations, progress=progress, **wanted),
            scenario,
        )
    from wbf_mission.results.result import load_result

    fixed = sorted(set(given.changes) - {*_OF_NEXT, "camera_footprint", "seed"})
    if observations is not None or given.file is not None or fixed:
        what = "--observations" if observations else "--scenario" if given.file else options.flag_of(fixed[0])
        raise ScenarioError(f"{what} has no effect, as the results of a run contain it: leave out {what}")
    progress("reading", 0, 1)
    result = load_result(log)
    progress("reading", 1, 1)
    flown = result.scenario
    # A policy plans the next flight, even if the logged flight flew a mission file.
    planned = given.change(replace(flown, mission=replace(flown.mission, file=None)))
    return treatment_of_result(result, source=f"the results in {log.name}", **wanted), planned


def _check_next(
    given: options.Given, plan: Path | None, inputs: list[Path | None], *, overwrite: bool
) -> None:
    if plan is None:
        idle = [key for key in _OF_NEXT if key in given.changes]
        if idle:
            flag = options.flag_of(idle[0])
            raise ScenarioError(f"{flag} has an effect only with --next: add --next, or leave out {flag}")
        return
    from mission.files import writer_for

    refuse_overwrite(plan, inputs, suffixes=MISSION_SUFFIXES, overwrite=overwrite)
    writer_for(plan)


@contextlib.contextmanager
def _folder(out: Path, inputs: list[Path | None], *, overwrite: bool) -> Iterator[Any]:
    """Open the folder for the map.

    Raises TargetError if the folder holds an input, or holds other files and `overwrite` is false.
    """
    from geo.atomic import AtomicFolder, FolderError
    from wbf_mission.addons.treatment.map_files import SUMMARY, is_part

    if out.exists() and not out.is_dir():
        raise TargetError(f"{out}: is a file, not a folder for the map; give another name")
    for path in filter(None, inputs):
        if path.exists() and out.resolve() in (path.resolve(), path.resolve().parent):
            raise TargetError(f"{out}: holds the input {path}; give another folder")
    try:
        folder = AtomicFolder(out, SUMMARY, is_part)
        if not overwrite and out.is_dir() and {path.name for path in out.iterdir()} - folder.hidden_names:
            what = "a map" if (out / SUMMARY).is_file() else "other files"
            raise TargetError(f"{out}: holds {what} already; give another folder, or add --overwrite")
        with folder:
            yield folder
    except FolderError as error:
        raise TargetError(f"{out}: {error}") from error


def _rows(of: TreatmentMap, flight: NextFlight | None, out: Path, plan: Path | None) -> dict[str, str]:
    from wbf_mission.addons.treatment.map_files import area_in_words
    from wbf_mission.addons.treatment.treatment_map import HEALTHY, LOOK, TREAT

    rows = {"made from": f"{len(of.observations)} readings, day {of.day}, {of.estimator}", **of.report.rows()}
    for zones in of.zone_maps:
        areas = ((zones.word(zone), area_in_words(zones.area_ha(zone))) for zone in (TREAT, LOOK, HEALTHY))
        rows[f"zones, {zones.field.title}"] = ", ".join(map(" ".join, areas))
    if flight is not None:
        prediction = flight.plan.prediction
        rows["next flight"] = (
            f"{plan}: {flight.policy}, {flight.plan.budget_text}, {duration(prediction.duration_s)}; looks at"
            f" {area_in_words(flight.looked_at_ha)} of crops; expected saving {flight.gain:.3g} of at most"
            f" {flight.gain_of_all:.3g} by perfect information (in the unit of the costs)"
        )
    rows["files"] = str(out)
    return rows


COMMAND = Command(map_command, EXAMPLES, BEGINNERS)
