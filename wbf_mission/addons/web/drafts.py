"""Turns a studio draft into a scenario and a checked plan; a newer draft cancels the older."""

from __future__ import annotations

import contextlib
import hashlib
import tempfile
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future, InvalidStateError
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Generic, TypeVar

import msgspec

from geo import Farm, load_farm
from geo.errors import FarmError, WbfMissionError
from geo.farm_file import farm_suffixes
from geo.farms import get_farm
from geo.geojson import MAX_FILE_BYTES
from geo.named import parse_named
from geo.texts import file_stem, one_line
from mission.files import Firmware, fitted, mission_formats, write_mission
from sensors.camera.optics import camera_names
from sensors.field_files import field_names
from wbf_mission.planning import PlanResult
from wbf_mission.planning.builder import coverage_together
from wbf_mission.planning.fleet import SingleVehicle, single_vehicles
from wbf_mission.planning.sorties import SortiePlan, sorties_of
from wbf_mission.preflight.finding import Finding, Report
from wbf_mission.preflight.run import check_plan
from wbf_mission.progress import Progress
from wbf_mission.run.plan import cut_if_too_long, plan_fleet, plan_for_batteries
from wbf_mission.scenario import Scenario, scenario_with
from wbf_mission.scenario.choice import names_of
from wbf_mission.scenario.option import Option
from wbf_mission.scenario.scenario import all_options
from wbf_mission.scenario.values import batteries_in

MAX_BODY_BYTES = MAX_FILE_BYTES
_KEPT = 8
"""Number of cached plans and farms: after an undo, the plan of the earlier draft is shown at once."""
_DRAWN = "farm.geojson"
"""Internal file name of a drawn farm."""
_LONGEST_NAME = 60
_FIXED = ("farm", "farm_crs", "crop", "repair", "mission", "terrain", "days", "flights_per_day")
"""Options that drafts cannot have: the farm is drawn, and a page must not name files."""


class DraftError(WbfMissionError, ValueError):
    """A draft cannot be read, or requests a forbidden option."""


class _Body(msgspec.Struct, forbid_unknown_fields=True):
    """A draft as sent by the page: a farm's name or its GeoJSON, and scenario options by key."""

    farm: msgspec.Raw
    options: dict[str, Any] = {}


class _Named(msgspec.Struct):
    """Name of a drawn farm in messages."""

    name: str = ""


@dataclass(frozen=True, slots=True)
class Draft:
    """A farm and a scenario, as drawn and chosen in the studio."""

    key: str
    scenario: Scenario = field(compare=False)
    farm: Farm = field(compare=False)


@dataclass(frozen=True, slots=True)
class PlannedMission:
    """Checked plan of one vehicle in one sortie."""

    name: str  # Name that distinguishes several missions; empty for a single mission
    system_id: int
    plan: PlanResult
    report: Report
    why_whole: str = ""  # Why a mission beyond the battery is not cut into sorties

    def place_of(self, finding: Finding) -> tuple[float, float] | None:
        """Return a finding's place on the farm (m); None if the finding is about the whole plan."""
        if finding.item is None:
            return None
        farm, mission = self.plan.farm, self.plan.mission
        items = {"fence": mission.fence, "rally": mission.rally}.get(finding.plan, mission.items)
        before = [item for item in items[: finding.item] if item.has_position and (item.x or item.y)]
        if not before:
            return farm.home_m
        x, y = farm.frame.from_wgs84(before[-1].x, before[-1].y)
        return float(x), float(y)


@dataclass(frozen=True, slots=True)
class PlannedDraft:
    """A draft with its missions: one for each vehicle, or for each of its sorties."""

    draft: Draft
    results: tuple[PlanResult, ...]  # Plans, one per vehicle
    cuts: tuple[SortiePlan | None, ...]  # Sorties of each vehicle, if one battery is not enough
    vehicles: tuple[SingleVehicle, ...]
    missions: tuple[PlannedMission, ...]
    coverage: float  # Fraction of the target land that all missions together cover
    plan_s: float  # Computing time of the plans
    check_s: float  # Computing time of the preflight check

    def mission(self, number: int) -> PlannedMission:
        """Return a mission by its number from 0; raise DraftError if there is none."""
        if not 0 <= number < len(self.missions):
            raise DraftError(f"mission {number}: there are {len(self.missions)} missions, numbered from 0")
        return self.missions[number]

    @property
    def decider(self) -> str:
        """Planner or policy of the draft, with its parameters."""
        mission = self.draft.scenario.mission
        return str(mission.policy or mission.planner)

    @property
    def surveys(self) -> bool:
        """Whether the plan uses a camera model (sensor and lens), which the simulator does not have."""
        return self.draft.scenario.camera.model is not None

    @property
    def not_flown(self) -> str:
        """Reason why the simulator cannot fly the draft; empty if it can."""
        mission = self.draft.scenario.mission
        if self.surveys and mission.policy is not None:
            return f"policy {mission.policy} needs leaf camera readings: choose a planner for a survey camera"
        if self.surveys and len(self.vehicles) > 1:
            return "the simulator flies a survey camera on one vehicle only: plan one vehicle, or save files"
        return ""

    def flown(self, folder: Path) -> Scenario:
        """Return the scenario that flies the plan; raise DraftError if the simulator cannot fly it.

        A number of batteries and a survey camera only affect the planned mission, not its flight.
        """
        scenario = self.draft.scenario
        if self.not_flown:
            raise DraftError(self.not_flown)
        if batteries_in(scenario.mission.budget) is None and not self.surveys:
            return scenario
        path = folder / f"{hashlib.sha256(self.draft.key.encode()).hexdigest()[:32]}.plan"
        whole = self.results[0]
        write_mission(whole.mission, path, firmware=Firmware(whole.mav_autopilot))
        leaf = replace(scenario.camera, model=None)
        return scenario_with(replace(without_budget(scenario), camera=leaf), {"mission": str(path)})

    def file(self, number: int, suffix: str, folder: Path) -> tuple[str, bytes]:
        """Return name and content of a mission's file; raise WbfMissionError if the format cannot hold it."""
        mission = self.mission(number)
        plan, planner = mission.plan, str(mission.plan.planner).partition(":")[0]
        name = file_stem(f"{plan.farm.name} {planner} {mission.name}"[:80].lower(), "mission") + suffix
        if suffix not in written_suffixes():
            raise DraftError(f"format {suffix!r:.40} is not known: choose one of the studio's formats")
        with tempfile.TemporaryDirectory(dir=folder) as own:
            path = Path(own) / name
            write_mission(fitted(plan.mission, path), path, firmware=Firmware(plan.mav_autopilot))
            return name, path.read_bytes()


class Drafts:
    """Farms and plans of a studio, cached by content, and a folder for its files.

    Only the scenario `start` may name files; drafts may not.
    """

    def __init__(self, start: Scenario) -> None:
        self.start = start
        self._own = tempfile.TemporaryDirectory(prefix="wbf-mission-studio-")
        self.folder = Path(self._own.name)
        self._farm = lru_cache(_KEPT)(self._load_farm)
        self.plan = lru_cache(_KEPT)(self._plan)
        self._planning = NewestOnly[PlannedDraft]()

    def close(self) -> None:
        """Cancel the planning and delete the files."""
        self.stop()
        self._own.cleanup()

    def farm_of_file(self, content: bytes, name: str, **how: Any) -> Farm:
        """Return the farm in a file's content; raise FarmError that names the faulty feature.

        An empty `name` means a drawn farm. `how` are options of `geo.load_farm`.
        """
        drawn, name = not name, name or _DRAWN
        suffix = Path(name).suffix.lower()
        if suffix not in farm_suffixes():
            raise FarmError(f"{name!r:.80} is not a farm file: give one of {', '.join(farm_suffixes())}")
        stem = file_stem(Path(name).stem[:60], "farm", r"\w .-")
        with tempfile.TemporaryDirectory(dir=self.folder) as own:
            path = Path(own) / f"{stem}{suffix}"
            path.write_bytes(content)
            return self._loaded(path, drawn=drawn, **how)

    def farm_named(self, name: str) -> Farm:
        """Return a built-in farm or the farm of `start`; raise WbfMissionError for any other name."""
        return self.draft(msgspec.json.encode({"farm": name})).farm

    def draft(self, body: bytes) -> Draft:
        """Read a draft; raise a WbfMissionError of one line if a part of it is invalid."""
        try:
            given = msgspec.json.decode(body, type=_Body)
            farm: Any = msgspec.json.decode(given.farm)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise DraftError(f"the draft cannot be read: {error}") from None
        options = {key: self._option(key, to) for key, to in given.options.items() if to not in (None, "")}
        if isinstance(farm, str):
            first = self.start.farm
            if farm != first.name:
                self._check_name("farm", farm)
            how = {"crop": first.crop, "farm_crs": first.crs, "repair": first.repair}
            options |= {"farm": farm, **(how if farm == first.name else {})}
        else:
            content = bytes(given.farm)
            folder = self.folder / hashlib.sha256(content).hexdigest()[:32]
            folder.mkdir(exist_ok=True)
            path = folder / _DRAWN
            if not path.exists():
                path.write_bytes(content)
            options["farm"] = str(path)
        scenario = Scenario(**options)
        key = msgspec.json.encode(scenario.to_dict(), order="deterministic").decode()
        of = scenario.farm
        return Draft(key, scenario, self._farm(of.name, of.crop, of.crs, of.repair))

    def stop(self) -> None:
        """Cancel the current planning."""
        self._planning.stop()

    def _plan(self, draft: Draft) -> PlannedDraft:
        """Plan and check a draft; raise SupersededError, or an error of `planned`."""
        return self._planning.do(draft.key, partial(planned, draft))

    def _load_farm(self, name: str, crop: str | None, crs: str | None, repair: bool) -> Farm:
        own = Path(name)
        if own.is_relative_to(self.folder):
            return self._loaded(own, drawn=True)
        return get_farm(name, crop=crop, crs=crs, repair=repair)

    def _loaded(self, path: Path, *, drawn: bool, **how: Any) -> Farm:
        try:
            return load_farm(path, **how)
        except FarmError as error:
            text = str(error)
            if drawn:
                try:
                    name = one_line(msgspec.json.decode(path.read_bytes(), type=_Named).name, _LONGEST_NAME)
                except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
                    name = ""
                text = text.replace(f"farm file {path}", f"farm {name!r}" if name else "the farm")
            raise FarmError(text.replace(str(path), path.name)) from None

    def _option(self, key: str, given: Any) -> Any:
        known = draft_options().get(key)
        if known is None:
            raise DraftError(f"{key!r:.60} is not an option of a draft")
        if known.kind or key in NAMED:
            if given == str(self.start[key]):
                return self.start[key]  # The value may be an object from a user's file
            self._check_name(key, given)
        return known.read(given) if known.read is not None and isinstance(given, str) else given

    @staticmethod
    def _check_name(key: str, given: Any) -> None:
        """Raise DraftError unless `given` is a known name, because a page must not name a file of code."""
        if not isinstance(given, str):
            raise DraftError(f"{key}: {given!r:.60} is not a text")
        known = known_names(key)
        one_name = all_options()[key][2].kind in ("planner", "policy", "estimator")
        for text in [parse_named(given)[0]] if one_name else given.split(","):
            if text.strip().lower() not in known:
                raise DraftError(f"{key} {text.strip()!r:.60}: the studio knows {', '.join(known)}")


NAMED: Mapping[str, Callable[[], tuple[str, ...]]] = {
    "fields": field_names,
    "camera_fields": field_names,
    "camera_model": camera_names,
}
"""Known names of options without an `Option.kind`."""


def known_names(key: str) -> tuple[str, ...]:
    """Return the known names of an option, in lower case."""
    names = NAMED[key]() if key in NAMED else names_of(all_options()[key][2].kind)
    return tuple(name.lower() for name in names)


def draft_options() -> dict[str, Option]:
    """Return the options of a draft by key, in the order of the scenario's parts."""
    return {key: option for key, (_, _, option) in all_options().items() if key not in _FIXED}


def drawn_farm(body: bytes) -> bytes:
    """Return the farm of a draft as sent by the page."""
    return bytes(msgspec.json.decode(body, type=_Body).farm)


def planned(draft: Draft, progress: Progress) -> PlannedDraft:
    """Plan a draft, in sorties if one battery is not enough, and check it; raises `plan_fleet`'s errors."""
    begun_s = time.perf_counter()
    scenario, vehicles = draft.scenario, single_vehicles(draft.scenario)

    results: tuple[PlanResult, ...]
    cuts: tuple[SortiePlan | None, ...]
    uncut: tuple[str, ...]
    batteries = batteries_in(scenario.mission.budget)
    if batteries is None:
        results = plan_fleet(scenario, farm=draft.farm, progress=progress)
        tried = [
            cut_if_too_long(plan, partial(sorties_of, one=vehicle))
            for plan, vehicle in zip(results, vehicles, strict=True)
        ]
        cuts, uncut = zip(*tried, strict=True)
    else:
        whole, sorties = plan_for_batteries(
            without_budget(scenario), batteries, partial(sorties_of, one=vehicles[0])
        )
        results, cuts, uncut = (whole,), (sorties,), ("",)
    planned_s, missions = time.perf_counter(), []
    coverage = coverage_together(results, scenario.camera.footprint)
    zipped = zip(results, cuts, uncut, vehicles, strict=True)
    for number, (result, pieces, why_whole, vehicle) in enumerate(zipped, start=1):
        plans = (result,) if pieces is None else pieces.plans
        for sortie, plan in enumerate(plans, start=1):
            which = [f"vehicle {number}"] * (len(results) > 1) + [f"sortie {sortie}"] * (len(plans) > 1)
            progress("checking", sortie, len(plans))
            missions.append(
                PlannedMission(", ".join(which), number, plan, check_plan(plan, vehicle, coverage), why_whole)
            )
    ended_s = time.perf_counter()
    return PlannedDraft(
        draft, results, cuts, vehicles, tuple(missions), coverage, planned_s - begun_s, ended_s - planned_s
    )


def written_suffixes() -> dict[str, str]:
    """Return the names of the mission formats that can be written, by their usual file suffix."""
    return {known.suffixes[0]: known.name for known in mission_formats() if known.dumps}


def without_budget(scenario: Scenario) -> Scenario:
    """Return a scenario whose budget is the battery."""
    return replace(scenario, mission=replace(scenario.mission, budget=None))


ANOTHER_PAGE, GIVEN_UP = "another page", "given up"
"""Reasons why the planning of a draft ended early."""
PATIENCE_S = 3.0
"""Maximum time that a new job waits for the end of the cancelled job (s)."""
T = TypeVar("T")


class SupersededError(WbfMissionError, RuntimeError):
    """The job was cancelled by a newer draft or by the user."""

    def __init__(self, why: str = ANOTHER_PAGE) -> None:
        super().__init__(f"superseded: {why}")
        self.why = why


class NewestOnly(Generic[T]):
    """One job at a time in its own thread; a newer job replaces the older.

    The caller of the older job gets an error at once. The older thread ends at its next progress report. The
    newer job waits for the older thread, but at most `PATIENCE_S` seconds.

    >>> NewestOnly[int]().do("a sum", lambda progress: 3 + 4)
    7
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._job: _Job[T] | None = None

    def do(self, what: str, work: Callable[[Progress], T]) -> T:
        """Return the result of `work`, or raise its error; callers with equal `what` share a job.

        Raises SupersededError when another job is requested, or `stop` is called.
        """
        with self._lock:
            job = self._job
            if job is None or job.what != what:
                job = self._job = _Job(what, work, job)
        return job.result()

    def stop(self) -> None:
        """Cancel the current job."""
        with self._lock:
            if self._job is not None:
                self._job.stop(GIVEN_UP)
            self._job = None


class _Job(Generic[T]):
    def __init__(self, what: str, work: Callable[[Progress], T], before: _Job[T] | None) -> None:
        self.what, self._work, self._before = what, work, before
        self._future, self._idle = Future[T](), threading.Event()
        if before is not None:
            before.stop()
        threading.Thread(target=self._run, name="studio plan", daemon=True).start()

    def result(self) -> T:
        return self._future.result()

    def stop(self, why: str = ANOTHER_PAGE) -> None:
        """Cancel the job for all callers that wait for its result."""
        with contextlib.suppress(InvalidStateError):
            self._future.set_exception(SupersededError(why))

    def _go_on(self, _what: str, _done: float, _total: float) -> None:
        """End the work of a cancelled job at a progress report."""
        if self._future.done():
            raise SupersededError

    def _run(self) -> None:
        if self._before is not None:
            # Two plans at once would slow each other down; a job that does not end is abandoned.
            self._before._idle.wait(PATIENCE_S)
            self._before = None
        with contextlib.suppress(InvalidStateError):  # The job was cancelled meanwhile
            if not self._future.done():
                try:
                    self._future.set_result(self._work(self._go_on))
                except BaseException as error:  # Raised in `result`
                    self._future.set_exception(error)
        self._idle.set()
