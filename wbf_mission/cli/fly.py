"""The command ``wbf-mission fly``."""

from __future__ import annotations

import contextlib
import shlex
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from geo.system import process_age_s
from geo.texts import distance, duration
from mission.outcome import in_words
from wbf_mission.cli import options, signals
from wbf_mission.cli.live import SPEED, LivePage
from wbf_mission.cli.options import Force, option
from wbf_mission.cli.output import Output, filled
from wbf_mission.exit_codes import ExitCode, exit_code_of_flight
from wbf_mission.progress import Progress
from wbf_mission.scenario import Scenario, ScenarioError, load_broken_scenario
from wbf_mission.scenario.parts import CAMERA_OF_PLANS

if TYPE_CHECKING:
    from wbf_mission.results.result import Result
    from wbf_mission.results.writing import ResultFolder
    from wbf_mission.run.orders import Orders

EXAMPLES = """
Examples
wbf-mission fly --farm miniberry-30 --planner lawnmower --estimator gp --vehicle ideal --seed 7
wbf-mission fly --farm waterberry --planner spiral --vehicle mapping-quad --wind 4,270,1 --out runs/windy
wbf-mission fly --farm miniberry-100 --mission spiral.plan --json
wbf-mission fly --scenario missions/noisy-camera.toml
wbf-mission fly --farm miniberry-100 --policy greedy --budget 10min --vehicles 2 --days 2
wbf-mission fly --farm miniberry-30 --planner spiral --connect udpin:127.0.0.1:14550
wbf-mission fly --farm miniberry-100 --policy greedy --vehicles 3 --live 0 --open
wbf-mission fly --policy greedy --connect udpin:127.0.0.1:14550 --connect serial:/dev/ttyUSB0:57600
"""
BEGINNERS = (
    *("--farm", "--planner", "--policy", "--mission", "--budget", "--vehicle"),
    *("--autopilot", "--connect", "--live", "--estimator", "--seed", "--out"),
)


@dataclass(frozen=True, slots=True)
class _Links:
    """Options that concern the links to real vehicles."""

    connect: Annotated[
        list[str] | None,
        options.link(
            "Link to a real vehicle, flown in place of a simulated vehicle; give one link for all vehicles,"
            " or a link for each"
        ),
    ] = None
    yes: Annotated[bool, option("Start without asking.", "--yes", panel=options.LINK_PANEL)] = False
    system_id: Annotated[
        list[int] | None,
        option(
            "System id of the vehicle, 1 to 255; may be repeated, in the order of --connect.  [default: the"
            " first vehicles heard]",
            panel=options.LINK_PANEL,
            metavar="NUMBER",
            parser=options.whole_number_in(1, 255),
        ),
    ] = None
    wait: options.Wait = 10.0
    via: options.Via = "own"

    def counted(self, given: options.Given) -> options.Given:
        """Return the options; without a number of vehicles, the number of links or system ids counts."""
        count = max(len(self.connect or ()), len(self.system_id or ()))
        if not self.connect or count < 2:
            return given
        return replace(given, changes={"vehicles": count, **given.changes})

    def live(
        self, output: Output, orders: Orders | None, *, force: bool, simulates: bool, change_s: float
    ) -> Any:
        """Return the links and the operator at this terminal; None for a simulated flight."""
        if not self.connect:
            if self.yes or self.system_id or self.via != "own":
                with_link = "--yes, --system-id and --via need --connect"
                raise ScenarioError(f"{with_link}: give the vehicle's link, or leave these options out")
            return None
        from wbf_mission.preflight.run import connection

        if not self.yes and orders is None and not sys.stdin.isatty():
            msg = "--connect asks before the motors start, but there is no terminal: give --yes"
            raise ScenarioError(msg)
        if simulates:
            msg = "--speed and --fault apply only to simulated flights: leave them out with --connect"
            raise ScenarioError(msg)
        return connection("fly")(
            output,
            self.connect,
            agreed=self.yes,
            wait_s=self.wait,
            system_ids=self.system_id or (),
            force=force,
            via=self.via,
            change_s=change_s,
            orders=orders,
        )


_OUT = options.OUTPUT_PANEL


@dataclass(frozen=True, slots=True)
class _Saving:
    """Options for the folder, files and pictures of the results."""

    out: Annotated[
        Path | None,
        option("Folder for the results.  [default: runs/ and a name from the scenario]", panel=_OUT),
    ] = None
    files: Annotated[bool, option("Write results into a folder, or only print them.", panel=_OUT)] = True
    plots: Annotated[bool, option("Draw pictures into the folder.", panel=_OUT)] = True
    animate: Annotated[
        bool, option("Also write an animation of the run (run.gif).", "--animate", panel=_OUT)
    ] = False
    treatment_map: Annotated[
        bool,
        option(
            "Also write a treatment map, as 'wbf-mission map' does (needs the extra gis).",
            "--treatment-map",
            panel=_OUT,
        ),
    ] = False
    overwrite: Annotated[
        bool,
        option(
            "Replace the result of another run in the folder, or write beside other files.",
            "--overwrite",
            panel=_OUT,
        ),
    ] = False

    def products(self) -> list[str]:
        """Return the names of the products that are written in addition to the results."""
        from wbf_mission.results.products import ANIMATION, PICTURES, TREATMENT, product_names

        drawn = self.plots and PICTURES in product_names()
        wanted = {PICTURES: drawn, ANIMATION: self.animate, TREATMENT: self.treatment_map}
        return [name for name in wanted if wanted[name]]

    def require_products(self, chosen: Scenario, output: Output) -> None:
        """Raise an error before the flight if a product cannot be written; only note missing pictures."""
        from wbf_mission.results.products import GROUP, PICTURES, product, product_names

        if not self.files and (self.animate or self.treatment_map):
            what = "--animate writes a file" if self.animate else "--treatment-map writes files"
            raise ScenarioError(f"{what}, but --no-files forbids files: leave one of them out")
        if self.files and self.plots and PICTURES not in product_names():
            output.note(f"note: no pictures, since no installed package makes '{PICTURES}' ({GROUP})")
        for name in self.products():
            product(name).require(chosen)

    def write(self, result: Result, folder: ResultFolder | None, progress: Progress) -> bool:
        """Write the results unless `folder` is None; return False if Ctrl-C interrupts the writing."""
        try:
            if folder is not None:
                folder.write(result, products=self.products(), release=True, progress=progress)
        except KeyboardInterrupt:
            return False
        return True

    def folder(
        self, given: options.Given, chosen: Scenario, output: Output, *, real: bool
    ) -> ResultFolder | None:
        """Return the results' folder, which must not contain an input, or None with ``--no-files``."""
        if not self.files:
            return None
        from wbf_mission.results.writing import ResultFolder, run_name
        from wbf_mission.run.estimation import resolved

        farm, mission, vehicle = chosen.farm, chosen.mission, chosen.vehicle
        inputs = [given.file, farm.name, *farm.fields, mission.file, *vehicle.names]
        path, asked = self.out or Path("runs") / run_name(chosen), resolved(chosen).to_dict()
        return ResultFolder(
            path, inputs=inputs, scenario=asked, overwrite=self.overwrite, real=real, warn=output.warn
        )


@options.scenario_options(
    *("farm", "mission", "estimate", "score", "vehicle", "weather", "camera"), without=CAMERA_OF_PLANS
)
@options.speaks()
@options.gives("links", _Links)
@options.gives("saving", _Saving)
@options.gives("page", LivePage)
def fly_command(
    given: options.Given,
    output: Output,
    *,
    speed: Annotated[
        float | None,
        option(
            "Pace in simulated seconds per second of wall time."
            "  [default: as fast as possible; with --live 20]",
            panel="What to run",
            parser=options.number,
        ),
    ] = None,
    change_time: Annotated[
        float,
        option(
            "Duration of a battery change between sorties, s; with --connect and --yes, the longest time to"
            " wait for the change.",
            panel="What to run",
            parser=options.number,
        ),
    ] = 180.0,
    links: _Links,
    fault: Annotated[
        list[str] | None,
        option(
            "Fault to simulate in each flight, besides those of the scenario file:"
            " KIND[=VALUE][,vehicle=N][,from=S][,for=S][,at=EVENT][,...]; may be repeated; 'wbf-mission sim"
            " --list-faults' lists the kinds.",
            panel="Faults",
            metavar="TEXT",
        ),
    ] = None,
    saving: _Saving,
    page: LivePage,
    cache: Annotated[
        bool,
        option("Keep a large farm's environment for the next run.", panel="What to run"),
    ] = True,
    force: Force = False,
) -> int:
    """Plan, upload over MAVLink, fly, observe, estimate and score, in simulation or with --connect.

    A single vehicle's mission is flown in sorties if it needs several batteries. The command writes the
    plan, a telemetry log, the observations, the information model with the truth, a summary and pictures.
    """
    from wbf_mission.flight import Simulated, fly

    if speed is not None and not 0.01 <= speed <= 1e6:
        msg = f"--speed {speed} is out of range: give 0.01 to 1000000 simulated seconds per second"
        raise ScenarioError(msg)
    if not 0.0 <= change_time <= 86_400.0:
        raise ScenarioError(f"--change-time {change_time:g} is out of range: give 0 to 86400 seconds")
    base, in_file = (
        (Scenario(**given.defaults), ()) if given.file is None else load_broken_scenario(given.file)
    )
    chosen = links.counted(given).change(base)
    saving.require_products(chosen, output)
    simulates = speed is not None or bool(fault or in_file)
    orders = page.orders(output)
    live = links.live(output, orders, force=force, simulates=simulates, change_s=change_time)
    if page.wanted and speed is None and live is None:
        speed = SPEED
    events = output.events
    with page.serve(output, events, orders):
        with contextlib.ExitStack() as stack:
            folder = saving.folder(given, chosen, output, real=live is not None)
            if folder is not None:
                stack.enter_context(folder)
            if folder is not None and live is None:
                kept = f"interrupted: an estimate is made from the images taken, and saved in {folder.path}"
                # The telemetry log exists from the beginning of the flight on.
                stack.enter_context(
                    signals.announcing(f"{kept}; a second interrupt stops both", when=folder.tlog.exists)
                )
            started_s = process_age_s()
            stack.enter_context(output.progress())
            simulated = Simulated(
                [*in_file, *(fault or ())], pace=speed, orders=orders, change_s=change_time, force=force
            )
            by = replace(live or simulated, tlog=folder.tlog if folder else None)
            result = fly(chosen, by=by, events=events, use_cache=cache)
            flown_s = process_age_s()
            interrupted = not saving.write(result, folder, events.progress)
        summary = result.summary()
        summary["files"] = str(folder.path) if folder and folder.is_written else None
        saved_s = process_age_s() - flown_s
        summary["timings_s"] = {"start-up": started_s, **result.timings_s, "results": saved_s}
        summary["wall_time_s"] = process_age_s()
        _show(output, result, summary, interrupted=interrupted, simulated=live is None)
        if interrupted:
            return ExitCode.INTERRUPTED
        if not signals.came():
            page.stay(output)
        blind = result.outcome.is_good and not len(result.observations)
        return ExitCode.NOT_GOOD if blind or result.policy_failed else exit_code_of_flight(result.outcome)


def _show(
    output: Output, result: Result, summary: dict[str, Any], *, interrupted: bool, simulated: bool
) -> None:
    """Print the result of a run and the run's notes and warnings."""
    output.notes(result.farm.notes, "farm")
    if simulated and (left := result.budget_left):
        output.notes([left])
    for warning in result.warnings:
        output.warn(warning)
    if interrupted:
        kept = "pictures may be missing" if summary["files"] else "nothing of this run is kept"
        output.warn(f"interrupted while the results were written: {kept}")
    if not result.outcome.is_good:
        output.warn(in_words(result.outcome, result.reason))
    elif not len(result.observations):
        output.warn(f"no image shows the farm {result.farm.name}: there is no estimate and no score")
    if result.rest is not None and summary["files"]:
        folder = summary["files"]
        name = "rest.plan" if Path(folder, "rest.plan").is_file() else "rest.json"
        output.note(
            f"the unflown rest of the mission is in {folder}/{name}: continue with fly --mission, or with"
            f" plan --resume {folder}"
        )
    title = f"{result.farm.name}: {result.plan.planner or 'mission file'}, {result.estimator}"
    title += f", {result.plan.vehicle.name}, seed {result.scenario.seed}"
    output.result(summary, _rows(result, summary, simulated=simulated), title=title)
    if output.as_json:
        return
    if len(result.days) > 1:
        _print_days(output, result)
    if summary["vehicles"] > 1:
        _print_fleet(output, result)


def _rows(result: Result, summary: Mapping[str, Any], *, simulated: bool) -> dict[str, str]:
    """Return the rows of the table that shows a run's result."""
    transfer = summary["transfer"]
    losses = ", ".join(
        f"{name} {value:.4g}" for name, value in summary["losses"].items() if value is not None
    )
    farm, vehicles = result.scenario.farm, len({flight.system_id for flight in result.flights})
    sorties = len(result.flights) // max(vehicles * farm.days * farm.flights_per_day, 1)
    # Of a policy's flight, only the first path is known beforehand.
    plans = result.scenario.mission.policy is None
    predicted = filled(" (predicted {predicted_coverage:.2%})", summary) if plans else ""
    rows = {
        "outcome": in_words(result.outcome, result.reason),
        "score": filled("{score:.5f} over the run, {final_score:.5f} at the end (0 is perfect)", summary),
        "loss per cell at the end": losses or "-",
        **(result.report.rows() if result.report is not None else {}),
        "observations": filled("{observations}, of {cells_observed} different cells", summary),
        "coverage": filled("{coverage:.2%} of the land to be seen", summary) + predicted,
        "flown": result.flown(predicted=plans),
        **({"sorties": f"{sorties}, with a full battery each"} if sorties > 1 else {}),
        **_decision_rows(result),
        "battery used": filled("{battery_used:.1%}", summary),
        "mission transfer": f"{transfer['items']} items, {transfer['retries']} retries, "
        + ("verified" if transfer["verified"] else "not verified"),
        "wall time": f"{duration(summary['wall_time_s'])}: "
        + ", ".join(f"{name} {seconds:.2f} s" for name, seconds in summary["timings_s"].items()),
        **({"flight speed": filled("{realtime_factor:.0f} x real time", summary)} if simulated else {}),
        "files": summary["files"] or "not written",
        **({"see it": f"wbf-mission report {shlex.quote(summary['files'])}"} if summary["files"] else {}),
    }
    if summary["least_distance_m"] is not None:
        rows["least distance"] = distance(summary["least_distance_m"])
    return rows


def _decision_rows(result: Result) -> dict[str, str]:
    """Return the row about a policy's decisions, or no row for a planner or mission file."""
    if result.scenario.mission.policy is None:
        return {}
    from wbf_mission.replanning.record import PLANNED_PATH, SKIPPED

    records, skipped = result.decisions, result.skipped_flights
    changes = [change for record in records for change in record.changes]
    changes = [change for change in changes if change.outcome not in (PLANNED_PATH, SKIPPED)]
    flown = [change for change in changes if change.outcome == "flown"]
    times_s = [(change.sent_s, change.effect_s) for change in flown]
    delays = [effect - sent for sent, effect in times_s if sent is not None and effect is not None]
    refused = [record.refused for record in records if record.refused]
    text = f"{len(records)} questions, {len(flown)} of {len(changes)} changed paths flown"
    if delays:
        text += f", {sum(delays) / len(delays):.2f} s from decision to turn"
    if skipped:
        text += f"; {skipped} flight{'s' if skipped > 1 else ''} not worth making"
    if refused:
        text += f"; {len(refused)} answers not flown, the first: {refused[0]}"
    return {"decisions": text}


def _print_days(output: Output, result: Result) -> None:
    """Print a row for each day with the score, and each field's estimate with its 90 % interval."""
    from wbf_mission.maps.report import brief

    titles = [field.title for field in result.report.fields] if result.report is not None else []
    rows = []
    for values, day in zip(result.by_day(), result.days, strict=True):
        fields = [brief(field) for field in day.report.fields] if day.report is not None else []
        forms = ("{day}", "{flights}", "{observations}", "{score:.5f}", "{final_score:.5f}")
        rows.append([*(filled(form, values) for form in forms), *(fields or ["-"] * len(titles))])
    header = ["day", "flights", "observations", "score", "at its end", *titles]
    output.table(None, header, rows, title="Days")


def _print_fleet(output: Output, result: Result) -> None:
    """Print a table that has a row for each vehicle of the fleet."""
    rows = []
    for number in sorted({flight.system_id for flight in result.flights}):
        flights = [flight for flight in result.flights if flight.system_id == number]
        bad = next((flight for flight in flights if not flight.outcome.is_good), flights[0])
        batteries = [flight.battery_used for flight in flights if flight.battery_used is not None]
        rows.append(
            [
                str(number),
                flights[0].plan.vehicle.name,
                in_words(bad.outcome, bad.reason),
                str(len(flights)),
                distance(sum(flight.track.length_m for flight in flights)),
                duration(sum(flight.flight_time_s for flight in flights)),
                f"{max(batteries):.1%}" if batteries else "-",
                str(sum(flight.camera.images for flight in flights)),
            ]
        )
    header = ["vehicle", "name", "outcome", "flights", "flown", "time", "most battery", "images"]
    output.table(None, header, rows, title="Fleet", left=True)
