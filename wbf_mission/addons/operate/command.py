"""``wbf-mission monitor`` and ``wbf-mission command``."""

from __future__ import annotations

import contextlib
import math
import sys
from collections.abc import Iterable
from typing import TYPE_CHECKING, Annotated, Any

import typer

from geo.texts import printable
from wbf_mission.cli import options, signals
from wbf_mission.cli.command import Command
from wbf_mission.cli.live import LivePage
from wbf_mission.cli.options import option
from wbf_mission.cli.output import Output, filled, to_stdout
from wbf_mission.events import RunBegun, RunEnded
from wbf_mission.exit_codes import ExitCode

if TYPE_CHECKING:
    from geo.farm import Farm
    from mission.ground.command import OperatorCommand
    from mission.ground.contact import Contact
    from sim_vehicle.component import Component
    from wbf_mission.addons.operate.command_session import CommandSession
    from wbf_mission.addons.operate.watching import FleetWatch

MONITOR_EXAMPLES = """
Examples
wbf-mission monitor udpin:127.0.0.1:14550
wbf-mission monitor udpin:127.0.0.1:14550 --farm waterberry --live 0 --open
wbf-mission monitor tcp:127.0.0.1:5760 --json --duration 10
"""
COMMAND_EXAMPLES = """
Examples
wbf-mission command udpin:127.0.0.1:14550 arm
wbf-mission command udpin:127.0.0.1:14550 takeoff 10
wbf-mission command udpin:127.0.0.1:14550 mission --arm
wbf-mission command tcp:127.0.0.1:5760 mode LOITER
"""
_COLUMNS = {
    "time": (8, "{now_s:.1f} s"),
    "vehicle": (7, "{system_id}"),
    "autopilot": (9, "{autopilot}"),
    "mode": (9, "{mode}"),
    "armed": (5, "{yes_or_no}"),
    "item": (10, "{item}{of_items}"),
    "height": (8, "{height_m:.1f} m"),
    "speed": (8, "{ground_speed_m_s:.1f} m/s"),
    "battery": (7, "{battery:.0%}"),
    "GPS": (13, "fix {gps_fix}, {of_satellites} sat"),
    "link": (14, "{link}"),
}
"""Columns of the lines: heading, width, and the format of the cell."""
_REPEATS_S = 30.0
_JSON_LINES = Annotated[
    bool, option("Print a line of JSON for each vehicle and each text.", "--json", panel="Output")
]


@options.scenario_options("farm", without=(*options.OF_DAYS, "fields", "seed"), defaults={"farm": None})
@options.speaks(json=_JSON_LINES)
@options.gives("page", LivePage)
def monitor_command(
    given: options.Given,
    output: Output,
    *,
    page: LivePage,
    url: Annotated[str, typer.Argument(help=f"The link: {options.LINKS}")],
    duration: Annotated[
        float | None, option("Seconds to watch.  [default: until Ctrl-C]", parser=options.number)
    ] = None,
    interval: Annotated[float, option("Seconds between two reports.", parser=options.number)] = 1.0,
) -> int:
    """Show the telemetry of the vehicles on a link: mode, item, position, battery, link, texts.

    The first report of an impossible value (a latitude of 95, a battery at 120 %) causes a warning; its
    column is marked with "!". A repeated text is printed at most every 30 s, with the number of times.

    With --live, a page also shows a map of the vehicles, their missions and (if it is given) the farm.
    """
    from sim_vehicle.host.server import Server
    from sim_vehicle.host.simulation import StopReason
    from wbf_mission.addons.operate.control_station import ControlStation
    from wbf_mission.addons.operate.telemetry_events import TelemetryEvents
    from wbf_mission.addons.operate.watching import FleetWatch
    from wbf_mission.scenario import ScenarioError

    if not 0.05 <= interval <= 3600.0 or not (duration is None or 0.0 < duration <= 1e7):
        raise ScenarioError("--interval takes 0.05 to 3600 seconds, --duration up to 10000000")
    farm = _watched_farm(given, page)
    output.notes(() if farm is None else farm.notes, "farm")
    orders = page.orders(output)
    watch = FleetWatch(output.warn if page.wanted else None)
    printer = _Printer(output, watch)
    components: list[Component] = [watch] if orders is None else [watch, ControlStation(orders)]
    # Ctrl-C is the normal way to end `monitor`, at any moment.
    with (
        contextlib.suppress(KeyboardInterrupt),
        page.serve(output, output.events, orders),
        Server(components, [url]) as server,
    ):
        looks = None
        if page.wanted:
            title = url if farm is None else f"{farm.name}, {url}"
            begun = RunBegun(title, farm, None, simulated=False)
            looks = TelemetryEvents(output.events, watch, begun, named=_named).look
        output.note(f"listening on {server.urls[0]}; Ctrl-C ends it")
        end_s = math.inf if duration is None else duration
        while server.now_s < end_s:
            if server.run(until=looks, limit_s=min(interval, end_s - server.now_s)) is StopReason.STOPPED:
                break
            printer.report(server.now_s)
        printer.report(server.now_s, last=True)
        output.events.tell(RunEnded(server.now_s, "ended", ""))
    code = signals.exit_code(ExitCode.GOOD)
    if code not in (ExitCode.GOOD, ExitCode.INTERRUPTED):
        return code
    if not watch.vehicles:
        output.warn(f"{url}: no vehicle was heard")
    return ExitCode.GOOD if watch.vehicles else ExitCode.NO_VEHICLE


def _watched_farm(given: options.Given, page: LivePage) -> Farm | None:
    """Return the farm of the live page, or None; raise ScenarioError for a farm without a page."""
    from wbf_mission.scenario import ScenarioError

    farm = given.farm(None if given.file is None else given.scenario().farm.name)
    if farm is None:
        return None
    if not page.wanted:
        raise ScenarioError("a farm is shown on the live page only: add --live PORT, or leave out the farm")
    return farm.load()


def _named(heard: Contact) -> tuple[str, str]:
    """Return name and kind of a discovered vehicle."""
    from sim_vehicle.airframe.kind import kind_of_type

    return heard.profile.name, kind_of_type(heard.monitor.vehicle_type)


class _Printer:
    """Prints a watched fleet: one header, then a line for each report of a vehicle, and the vehicle's texts.

    A repeated text is printed at most every 30 s, with the number of times.
    """

    def __init__(self, output: Output, watch: FleetWatch) -> None:
        self._output, self._watch = output, watch
        self._texts: dict[int, int] = {}
        # By vehicle, severity and text: time of the last print, time of the last receipt, unprinted repeats.
        self._waiting: dict[tuple[int, int, str], tuple[float, float, int]] = {}
        self._wrong: dict[int, set[str]] = {}
        self._headed = False

    def report(self, now_s: float, *, last: bool = False) -> None:
        """Print the state of each vehicle, and the texts since the last report."""
        for number, vehicle in self._watch.vehicles.items():
            said, self._texts[number] = vehicle.texts.begun_until(self._texts.get(number, 0))
            for time_s, severity, text in said:
                key = (number, severity, text)
                printed_s, _, times = self._waiting.get(key, (-math.inf, 0.0, 0))
                self._waiting[key] = (printed_s, time_s, times + 1)
        self._print_texts(now_s, last=last)
        for vehicle in () if last else self._watch.vehicles.values():
            state = vehicle.summary(now_s)
            self._warn(state)
            if self._output.as_json:
                _json_line({"time_s": now_s, **state})
                continue
            if not self._headed:
                self._headed = True
                _line(_aligned(_COLUMNS))
            _line(_aligned(_row(state, now_s, silent=vehicle.is_silent(now_s))))

    def _print_texts(self, now_s: float, *, last: bool) -> None:
        for (number, severity, text), (printed_s, time_s, times) in list(self._waiting.items()):
            if now_s - printed_s < _REPEATS_S and not last:
                continue
            if not times:
                del self._waiting[number, severity, text]
                continue
            self._waiting[number, severity, text] = (now_s, time_s, 0)
            if self._output.as_json:
                said = {"time_s": time_s, "system_id": number, "severity": severity, "text": text}
                _json_line(said | {"times": times})
            else:
                often = f" ({times} times)" if times > 1 else ""
                self._output.note(f"vehicle {number}: {text}{often}", publish=False)

    def _warn(self, state: dict[str, Any]) -> None:
        """Warn once of each value that has become impossible."""
        number, wrong = state["system_id"], state["impossible"]
        fresh = {key: value for key, value in wrong.items() if key not in self._wrong.get(number, ())}
        self._wrong[number] = set(wrong)
        if fresh and not self._output.as_json:
            values = ", ".join(f"{key} {value}" for key, value in fresh.items())
            self._output.warn(f"vehicle {number}: impossible values: {values}")


def _json_line(values: dict[str, Any]) -> None:
    """Print one line of JSON and flush it."""
    import msgspec

    _line(msgspec.json.encode(values).decode())


def _line(text: str) -> None:
    with to_stdout():
        sys.stdout.write(printable(text) + "\n")


def _aligned(cells: Iterable[str]) -> str:
    """Return cells as one line, aligned with the headings."""
    widths = (width for width, _ in _COLUMNS.values())
    return "  ".join(cell.ljust(width) for cell, width in zip(cells, widths, strict=True)).rstrip()


def _row(state: dict[str, Any], now_s: float, *, silent: bool) -> list[str]:
    """Return the cells of a vehicle's line."""
    from mission.ground.link_state import milliseconds

    link = filled("{link_quality:.0%}", state)
    if state["round_trip_s"] is not None:
        link += f", {milliseconds(state['round_trip_s'])}"
    more = {
        "now_s": now_s,
        "yes_or_no": "yes" if state["armed"] else "no",
        "of_items": "" if state["items"] is None else f" of {state['items']}",
        "of_satellites": str(state["satellites"]),
        "link": f"silent for {state['silent_s']:.0f} s" if silent else link,
    }
    forms = [form for _, form in _COLUMNS.values()]
    cells = [filled(form, state | more) for form in forms]
    marks = ("!" if any(f"{{{key}" in form for key in state["impossible"]) else "" for form in forms)
    return [cell + mark for cell, mark in zip(cells, marks, strict=True)]


@options.speaks()
def command_command(
    output: Output,
    url: Annotated[str, typer.Argument(help=f"The link: {options.LINKS}")],
    order: Annotated[
        str,
        typer.Argument(
            help="arm, disarm, takeoff HEIGHT, mission, hold, resume, return, land, set-item NUMBER or mode"
            " NAME."
        ),
    ],
    value: Annotated[str, typer.Argument(help="Height (m), item number or mode name for the order.")] = "",
    arm: Annotated[
        bool, option("Allow a PX4 to start its motors and take off on the order mission.", "--arm")
    ] = False,
    system_id: options.SystemId = None,
    wait: options.Wait = 10.0,
) -> None:
    """Give a vehicle one order, and wait until its telemetry shows that it obeys."""
    from mission.ground.command import MotorsStandError, OperatorCommand

    session = _give(OperatorCommand(order, value, arm), url, system_id, wait)
    assert session.vehicle is not None
    number = session.vehicle[0]
    if isinstance(session.error, MotorsStandError) and _lets_start(number, output):
        # The answer is about this vehicle, although another may be heard first now.
        session = _give(OperatorCommand(order, value, arms=True), url, number, wait)
    for text in session.texts:
        output.note(f"vehicle: {text}")
    if session.error is not None:
        raise session.error
    done = {"system_id": number, "order": order, "value": value or None, "mode": session.mode}
    text = f"{order} {value}".strip()
    output.result(done, {"vehicle": f"system {number}", "done": text, "mode": session.mode})


def _lets_start(number: int, output: Output) -> bool:
    """Ask at the terminal whether the motors of a vehicle may start; without a terminal they may not."""
    from wbf_mission.addons.operate.console import discard_typed

    if not sys.stdin.isatty():
        return False
    discard_typed()
    state = f"system {number}: the motors stand still: the order starts them for take-off"
    output.note(f"{state}; start the motors? [y/N]")
    return sys.stdin.readline().strip().lower() in ("y", "yes")


def _give(wanted: OperatorCommand, url: str, system_id: int | None, wait: float) -> CommandSession:
    """Open a link and give an order; return the ended session. Raises NoVehicleError without a vehicle."""
    from sim_vehicle.host.server import Server
    from sim_vehicle.host.simulation import StopReason
    from wbf_mission.addons.operate.command_session import CommandSession

    session = CommandSession(wanted, system_id=system_id)
    with Server([session], [url]) as server:
        reason = server.run(until=lambda _now_s: session.done or session.vehicle is not None, limit_s=wait)
        if reason is StopReason.FINISHED:
            reason = server.run(until=lambda _now_s: session.done)
        name = server.urls[0]
    if reason is StopReason.STOPPED:
        raise KeyboardInterrupt
    if session.vehicle is None:
        raise session.error or session.search.failure(name, wait)
    return session


MONITOR = Command(monitor_command, MONITOR_EXAMPLES)
COMMAND = Command(command_command, COMMAND_EXAMPLES, ignore_unknown_options=True)  # -5 may be a height
