"""Studio: requests of the page for drawing a farm, planning, uploading and flying."""

from __future__ import annotations

import contextlib
import inspect
import re
import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any, TypeAlias, get_args
from urllib.parse import quote

import msgspec
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.routing import Route

from geo import Farm
from geo.errors import FarmError, WbfMissionError
from geo.geojson import farm_document
from geo.grid import Crop
from geo.texts import one_line, parse_number
from mission.outcome import in_words
from mission.planners import make_planner
from mission.planners.request import planner_parameters
from mission.policies.policy import policy_parameters
from mission.transfer.vehicles import Vehicle
from wbf_mission.addons.base.inquiry import VehicleSnapshot
from wbf_mission.addons.base.links import fitted_to, upload_checked
from wbf_mission.addons.web import drafts
from wbf_mission.addons.web.drafts import SupersededError
from wbf_mission.addons.web.schema import Background
from wbf_mission.addons.web.server import LiveServer
from wbf_mission.addons.web.shapes import farm_shape, plan_shape
from wbf_mission.addons.web.view import View
from wbf_mission.events import Event, EventStream, Planned, Progressed, RunBegun, RunEnded, VehicleMoved
from wbf_mission.flight import Simulated, fly
from wbf_mission.preflight.subject import Circumstances
from wbf_mission.scenario import Scenario, scenario_with
from wbf_mission.scenario.choice import names_of
from wbf_mission.scenario.option import Option
from wbf_mission.scenario.scenario import all_options

_FIRST = ("planner", "policy", "budget", "vehicle", "autopilot", "wind_speed_m_s", "wind_direction_deg")
"""Options shown first; all other options are in panels."""
_LONGEST_END_S = 5.0
_TYPES = {bool: "flag", int: "whole", float: "number"}
_REMEDIES = {"repair": "--repair", "crop": "--crop", "crs": "--farm-crs"}
_SURVEY_FLOWN = "images are taken where the survey camera would take them, but by the simulator's leaf camera"
Handler: TypeAlias = Callable[[Request, bytes], Any]


class Studio:
    """Handler of the studio page's requests; `start` is the initial scenario."""

    def __init__(self, start: Scenario) -> None:
        self.drafts = drafts.Drafts(start)
        self._flight = StudioFlight()
        self._background: Background | None = None

    def begin(self, server: LiveServer) -> None:
        """Connect to the server: its live page shows the flights, and its map tiles are the background.

        The initial scenario is planned in the background, which also compiles the code for later requests.
        """
        self._flight.show, self._background = server.show, server.background
        body = msgspec.json.encode({"farm": self.drafts.start.farm.name, "options": self._given()})
        threading.Thread(target=self._plan_quietly, args=(body,), name="studio", daemon=True).start()

    def close(self) -> None:
        """Stop the flight, if any, and delete the files."""
        self._flight.stop(_LONGEST_END_S)
        self.drafts.close()

    def routes(self) -> list[Route]:
        """Return the routes of the page's requests."""
        read = {"options": self.options, "farm": self.named_farm, "flight": self.flight}
        done = (self.farm, self.plan, self.cancel, self.export, self.upload, self.fly, self.stop)
        return [
            *(Route(f"/api/{name}", _answering(work), methods=["GET"]) for name, work in read.items()),
            *(Route(f"/api/{work.__name__}", _answering(work), methods=["POST"]) for work in done),
        ]

    def options(self, _request: Request, _body: bytes) -> Any:
        """Return the available options, and the initial options."""
        return {
            "options": [
                _described(key, draft_option) for key, draft_option in drafts.draft_options().items()
            ],
            "farms": names_of("farm"),
            "crops": [str(crop) for crop in Crop if crop is not Crop.NONE],
            "parameters": {
                "planner": {
                    name: _parameters(planner_parameters(make_planner(name))) for name in names_of("planner")
                },
                "policy": {name: _parameters(policy_parameters(name)) for name in names_of("policy")},
            },
            "formats": [
                {"name": name, "suffix": suffix} for suffix, name in drafts.written_suffixes().items()
            ],
            "background": self._background,
            "start": {"farm": self.drafts.start.farm.name, "options": self._given()},
        }

    def named_farm(self, request: Request, _body: bytes) -> Any:
        """Return a farm by name, for drawing and editing."""
        return _farm(self.drafts.farm_named(request.query_params.get("name", "")))

    def farm(self, request: Request, body: bytes) -> Any:
        """Return the farm of a file's content, or of a drawing, which has no file name."""
        asked = request.query_params
        name = asked.get("name", "")
        how = {"crop": asked.get("crop") or None, "crs": asked.get("crs") or None}
        try:
            return _farm(self.drafts.farm_of_file(body, name, **how, repair=asked.get("repair") == "true"))
        except FarmError as error:
            return self._refused(error, body, name, how)

    def plan(self, _request: Request, body: bytes) -> Any:
        """Plan and check a draft."""
        try:
            draft = self.drafts.draft(body)
        except FarmError as error:
            return self._refused(error, drafts.drawn_farm(body), "", {})
        found = self.drafts.plan(draft)
        return {
            "farm": farm_shape(found.draft.farm),
            "notes": [worded(note) for note in found.draft.farm.notes],
            "missions": [_mission(mission) for mission in found.missions],
            "vehicles": [
                result.summary() if cut is None else cut.summary()
                for result, cut in zip(found.results, found.cuts, strict=True)
            ],
            "coverage": found.coverage,
            "plan_s": found.plan_s,
            "check_s": found.check_s,
            "not_flown": found.not_flown,
            "flown_note": _SURVEY_FLOWN if found.surveys else "",
        }

    def cancel(self, _request: Request, _body: bytes) -> Any:
        """Cancel the current planning."""
        self.drafts.stop()
        return {}

    def export(self, request: Request, body: bytes) -> Response:
        """Return a mission as a file."""
        found = self.drafts.plan(self.drafts.draft(body))
        suffix = request.query_params.get("format", ".plan")
        name, content = found.file(_mission_asked(request), suffix, self.drafts.folder)
        headers = {"Content-Disposition": f"attachment; filename*=UTF-8''{quote(name)}"}
        return Response(content, media_type="application/octet-stream", headers=headers)

    def upload(self, request: Request, body: bytes) -> Any:
        """Upload a mission to a vehicle after confirmation, download it and compare."""
        link = request.query_params.get("link", "")
        found = self.drafts.plan(self.drafts.draft(body))
        sortie = found.mission(_mission_asked(request))
        if request.query_params.get("confirmed") != "true":
            raise drafts.DraftError(f"confirm that {len(sortie.plan.mission.items)} items are sent to {link}")
        wanted = _number(request, "system_id", 1, 255)
        system_id = None if wanted is None else int(wanted)
        vehicle = found.vehicles[sortie.system_id - 1]

        def around(snapshot: VehicleSnapshot) -> Circumstances:
            heard = Vehicle(snapshot.system_id, 1, snapshot.autopilot, snapshot.vehicle_type)
            named = {"vehicle": vehicle.vehicle.name, "autopilot": vehicle.vehicle.autopilot, "vehicles": 1}
            fitted = fitted_to(scenario_with(found.draft.scenario, named), heard)
            given = Circumstances.of(fitted, sortie.plan.farm, snapshot)
            return replace(
                given, imaging=sortie.plan.imaging, planner=sortie.plan.planner, coverage=found.coverage
            )

        try:
            report, checked = upload_checked(
                sortie.plan.mission, link, around, EventStream(), system_id=system_id
            )
        except KeyboardInterrupt:
            raise drafts.DraftError("the upload was interrupted") from None
        findings = [worded(finding) for finding in checked.findings]
        return {**report.summary(), "vehicle": report.vehicle, "findings": findings}

    def fly(self, request: Request, body: bytes) -> Any:
        """Fly a draft in the simulator, on the live page."""
        pace = _number(request, "pace", 0.01, 1e6)
        found = self.drafts.plan(self.drafts.draft(body))
        self._flight.start(found.flown(self.drafts.folder), pace, found.decider)
        return {}

    def stop(self, _request: Request, _body: bytes) -> Any:
        """Stop the flight."""
        return {"stopped": self._flight.stop()}

    def flight(self, _request: Request, _body: bytes) -> Any:
        """Return the state of the flight."""
        return self._flight.state

    def _refused(self, error: FarmError, content: bytes, name: str, how: Mapping[str, Any]) -> Any:
        """Return the reason for refusing a farm, and the page's remedy: "repair", "crop" or "crs"."""
        text = str(error)
        remedy = next((remedy for remedy, flag in _REMEDIES.items() if flag in text), "")
        if remedy == "repair":
            try:
                self.drafts.farm_of_file(content, name, **how, repair=True)
            except FarmError as unmended:
                text, remedy = str(unmended), ""
        return {"error": worded(text), "remedy": remedy}

    def _given(self) -> dict[str, Any]:
        """Return the initial options that differ from their defaults, in the page's form."""
        usual, start = Scenario(), self.drafts.start
        return {key: _plain(start[key]) for key in drafts.draft_options() if start[key] != usual[key]}

    def _plan_quietly(self, body: bytes) -> None:
        with contextlib.suppress(WbfMissionError):
            self.drafts.plan(self.drafts.draft(body))


def _answering(work: Handler) -> Callable[[Request], Any]:
    """Return an endpoint that answers with a function's result as JSON, or with {"error": message}.

    Errors have status 200: they are normal while typing, and browsers would log each in the console.
    """

    async def answer(request: Request) -> Response:
        body = bytearray()
        try:
            async for part in request.stream():
                body += part
                if len(body) > drafts.MAX_BODY_BYTES:
                    text = f"more than {drafts.MAX_BODY_BYTES >> 20} MiB: draw with fewer points"
                    return _json({"error": text}, 413)
            found = await run_in_threadpool(work, request, bytes(body))
        except SupersededError as error:
            return _json({"error": str(error), "superseded": error.why})
        except WbfMissionError as error:
            return _json({"error": worded(error)})
        except OSError as error:  # Writing draft files failed, for example on a full disk
            return _json({"error": worded(f"files for drafts: {error}")})
        except ClientDisconnect:
            return Response(status_code=400)  # The client has gone
        return found if isinstance(found, Response) else _json(found)

    return answer


def _json(value: Any, status: int = 200) -> Response:
    return Response(msgspec.json.encode(value), status_code=status, media_type="application/json")


def _farm(farm: Farm) -> dict[str, Any]:
    """Return a farm for drawing and editing."""
    return {
        "farm": farm_shape(farm),
        "document": farm_document(farm),
        "notes": [worded(note) for note in farm.notes],
    }


def _mission(sortie: drafts.PlannedMission) -> dict[str, Any]:
    """Return a sortie of one vehicle with its findings."""
    plan, prediction, found = sortie.plan, sortie.plan.prediction, sortie.report.findings
    planned = Planned(
        *(0.0, 0, 1, sortie.system_id, plan.mission, plan.path_m),
        duration_s=prediction.duration_s,
        length_m=plan.length_m,
        coverage=plan.coverage,
    )
    return {
        "name": sortie.name,
        "plan": plan_shape(planned, plan.farm),
        "battery_used": plan.battery_used,
        "energy_wh": prediction.energy_wh,
        # Omit warnings that the findings repeat.
        "warnings": [
            worded(text)
            for text in (*filter(None, (sortie.why_whole,)), *plan.warnings)
            if not any(finding.text in text for finding in found)
        ],
        "findings": [
            {
                **finding.summary(),
                "text": worded(finding.text),
                "fix": worded(finding.fix) or None,
                "where": finding.where,
                "told": worded(finding),
                "place_m": sortie.place_of(finding),
            }
            for finding in found
        ],
    }


def _described(key: str, option: Option) -> dict[str, Any]:
    """Return an option's description for the page."""
    shown = ("label", "panel", "unit", "low", "high", "kind", "needs", "not_with", "needs_fleet")
    kinds = [kind for kind in get_args(option.wanted) or (option.wanted,) if kind in _TYPES]
    is_text = option.read is not None or str in get_args(option.wanted)
    names = drafts.known_names(key) if option.kind or key in drafts.NAMED else option.choices
    return {
        **{name: getattr(option, name) for name in shown},
        "help": worded(option.help),
        "key": key,
        "type": "text" if is_text or not kinds else _TYPES[kinds[0]],
        "choices": names,
        "default": worded(option.default or _default(option.initial)),
        "first": key in _FIRST,
        "several": option.each or option.wanted not in (str, str | None, Any),
    }


def _default(initial: Any) -> str:
    """Return an option's default in words, or as a number."""
    if isinstance(initial, bool):
        return "yes" if initial else "no"
    plain = _plain(initial)
    return "none" if plain is None else f"{plain:g}" if isinstance(plain, float) else str(plain)


def _plain(value: Any) -> Any:
    """Return a value of an option in the page's form: a bool, a number or a text."""
    if value is None or isinstance(value, bool | int | float):
        return value
    if isinstance(value, Mapping):
        return ",".join(f"{name}={number:g}" for name, number in value.items())
    return ",".join(map(str, value)) if isinstance(value, tuple | list) else str(value)


def _parameters(known: Mapping[str, Any]) -> dict[str, str]:
    """Return the parameters of a planner or policy with their defaults in words."""
    return {
        name: "" if default is inspect.Parameter.empty else _default(default)
        for name, default in known.items()
    }


def _mission_asked(request: Request) -> int:
    return int(_number(request, "mission", 0, 1e6) or 0)


def _number(request: Request, name: str, low: float, high: float) -> float | None:
    """Return a number from the request's query; None without one."""
    text = request.query_params.get(name)
    if not text:
        return None
    try:
        value = parse_number(text)
    except ValueError as error:
        raise drafts.DraftError(f"{name}: {error}") from None
    if not low <= value <= high:
        raise drafts.DraftError(f"{name} {value:g} is out of range: give {low:g} to {high:g}")
    return value


class FlightState(msgspec.Struct, frozen=True):
    """State of the latest flight: "none", "preparing", "flying" or an outcome; `words` explains it."""

    outcome: str = "none"
    words: str = ""


class StudioFlight:
    """Runs one flight in the simulator; a new flight stops the previous one."""

    def __init__(self) -> None:
        self.show: Callable[[View], None] = lambda _view: None
        self._thread: threading.Thread | None = None
        self._flown = Flown(View())
        self._lock = threading.Lock()

    def start(self, scenario: Scenario, pace: float | None, decider: str) -> None:
        """Start a flight of a planned scenario, in place of the current flight."""
        with self._lock:
            self._flown.stopping.set()
            view = View()
            self._flown = Flown(view, "preparing", decider)
            self.show(view)
            work = partial(self._flown.fly, scenario, pace)
            self._thread = threading.Thread(target=work, name="studio flight", daemon=True)
            self._thread.start()

    @property
    def state(self) -> FlightState:
        """State of the latest flight."""
        return self._flown.state

    def stop(self, wait_s: float = 0.0) -> bool:
        """Stop the flight and wait for its end; return whether a flight was running."""
        with self._lock:
            self._flown.stopping.set()
            flies = self._thread is not None and self._thread.is_alive()
            if self._thread is not None:
                self._thread.join(wait_s)
            return flies


class Flown:
    """One flight that a view shows and that can be stopped."""

    def __init__(self, view: View, outcome: str = "none", decider: str = "") -> None:
        self._view, self.state, self._decider = view, FlightState(outcome), decider
        self.stopping = threading.Event()

    def fly(self, scenario: Scenario, pace: float | None) -> None:
        """Fly until the end or a stop; after a stop, the readings are evaluated as after Ctrl-C."""
        events = EventStream()
        events.listen(self._take)
        events.listen(self._stop_if_asked, VehicleMoved, Progressed)
        try:
            fly(scenario, by=Simulated(pace=pace), events=events)
        except WbfMissionError as error:
            self._take(RunEnded(0.0, "failed", worded(error)))
        except KeyboardInterrupt:
            begun = self.state.outcome == "flying"
            why = "stopped while its readings were evaluated" if begun else "stopped before the start"
            self._take(RunEnded(0.0, "interrupted", why))

    def _take(self, event: Event) -> None:
        if isinstance(event, RunBegun) and event.farm is not None:
            # The mission's file has an internal name: show the planner's or policy's name instead.
            title = f"{event.farm.name}, {self._decider}"
            event = replace(event, title=title, planner=self._decider)
        self._view.take(event)
        if isinstance(event, RunEnded):
            self.state = FlightState(event.outcome, in_words(event.outcome, event.reason))
        elif isinstance(event, VehicleMoved) and self.state.outcome == "preparing":
            self.state = FlightState("flying")

    def _stop_if_asked(self, _event: object) -> None:
        if self.stopping.is_set():
            self.stopping.clear()  # Stop only once: the readings must still be evaluated
            raise KeyboardInterrupt


_FLAG = re.compile(r"(?<![\w-])--[a-z][a-z0-9]*(-[a-z0-9]+)*")
_ONLY_THERE = re.compile(r",? --force does it nevertheless")
"""Advice that has no input on the page."""
_OTHERS = {
    "--crop": "Crop",
    "--farm-crs": "Coordinate system",
    "--repair": "Mend it",
    "--wind": "Wind speed",
    "--wind-shear": "Wind shear",
}
"""Names of inputs of the page that are not draft options, or that stand for several options."""


def worded(text: object) -> str:
    """Return a text on one line, with the page's input names in place of options.

    >>> worded("the polygon is not valid; --repair mends what is safe to mend")
    "the polygon is not valid; 'Mend it' mends what is safe to mend"
    >>> worded("give --budget, such as 8000m"), worded("fly slower, or a smaller --no-such-option")
    ("give 'Budget', such as 8000m", "fly slower, or a smaller 'No such option'")
    """
    return _FLAG.sub(_name, _ONLY_THERE.sub("", one_line(str(text))))


def _name(flag: re.Match[str]) -> str:
    text = flag[0]
    return f"'{_labels().get(text) or _capital(text[2:].replace('-', ' '))}'"


@lru_cache(maxsize=1)
def _labels() -> dict[str, str]:
    known = {str(option.flag): _capital(option.label) for _, _, option in all_options().values()}
    return known | _OTHERS


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
