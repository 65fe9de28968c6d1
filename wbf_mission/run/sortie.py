"""One vehicle's flight, as handled on the ground: task, plan, leaf camera and ground station."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from statistics import median

import numpy as np

from geo.errors import WbfMissionError
from mission.ground.arming_gate import ArmingGate
from mission.ground.change import ChangeOutcome
from mission.ground.items import leads_home, revised_mission
from mission.ground.link_state import SILENCE_S
from mission.ground.station import GroundStation
from mission.ground.tracks import FlownLength
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.model import Command, Mission, MissionItem
from mission.outcome import Outcome, Phase
from mission.planners.cornering import Waypoints
from mission.planners.path import Points, path_length
from mission.policies.observation import Status, VehicleReport
from mission.transfer import OWN_TRANSFERS, TransferMaker
from mission.transfer.wire import GROUND_STATION
from sensors.camera.leaf_camera import Camera
from sensors.camera.wire import ObservationAssembler
from sensors.observations import Observations
from sim_vehicle.prediction.onward import InFlight
from wbf_mission.planning import PlanResult
from wbf_mission.planning.assignment import SortieNumber
from wbf_mission.planning.budget import is_same_path
from wbf_mission.planning.fleet import Vehicle
from wbf_mission.planning.station_range import ENDING_S
from wbf_mission.replanning.record import FLOWN_ALREADY, PathChange
from wbf_mission.run.record import FlightRecord
from wbf_mission.scenario.parts import MOST_VEHICLES

_SLOWEST_FLIGHT_M_S = 0.1
SILENT_S = 30.0
"""A policy sees a vehicle as lost after this silence (s). Beyond radio range, the silence counts from the
time at which the vehicle should be back in range."""
SLOWEST_M_S = 0.3
_REAL_GROUNDS = (GROUND_STATION[1], *range(m.MAV_COMP_ID_USER1, m.MAV_COMP_ID_USER1 + MOST_VEHICLES))
"""Component ids of the ground stations of real vehicles. Real vehicles expect a ground station with system id
255 (ArduPilot: MAV_GCS_SYSID), so the stations of several vehicles differ by component id."""
_NO_REST: tuple[tuple[MissionItem, ...], int, Points] = ((), -1, np.empty((0, 2)))


class Sortie:
    """One vehicle's flight from the first heartbeat to the landing.

    With `force`, items that the autopilot would refuse or not fly are uploaded, too. `place` is the index in
    a joint flight.
    """

    def __init__(
        self,
        number: SortieNumber,
        vehicle: Vehicle,
        plan: PlanResult,
        leaf_camera: Camera,
        on_transfer: Callable[[int, int], None] | None = None,
        start_delay_s: float = 0.0,
        arming_gate: ArmingGate | None = None,
        maker: TransferMaker = OWN_TRANSFERS,
        *,
        force: bool = False,
        place: int = 0,
    ) -> None:
        task = vehicle.task
        self._station_range = task.builder.station_range
        planned, planned_s = plan.prediction, plan.prediction.duration_s or math.inf
        self._mean_speed_m_s = max(planned.path_length_m / planned_s, _SLOWEST_FLIGHT_M_S)
        # Mean cost of a second of flight, in Wh and in the unit of the budget
        self._mean_wh_s = planned.energy_wh / planned_s
        level, step_s = task.builder.level, plan.vehicle.step_s
        a_second = {"m": level.speed_m_s, "steps": 1.0 / step_s, "Wh": self._mean_wh_s}
        self._cost_a_second = a_second.get(task.request.budget.unit, 1.0)
        farm = plan.farm
        self.start_delay_s = start_delay_s
        self.number, self.task, self.plan = number, task, plan
        # This callback also receives the messages of a real vehicle's autopilot.
        self.follow: Callable[[Message, float], None] = lambda _message, _now_s: None
        # The host sets these: a function that sends the ground station's messages, and a function that counts
        # images never taken because the link was dead.
        self.send: Callable[[list[Message]], None] = _nobody_sends
        self.images_missed: Callable[[], int] = lambda: 0
        self.vehicle = vehicle
        self.leaf_camera = leaf_camera
        fields = leaf_camera.options.fields.names
        self.assembler = ObservationAssembler(farm, day=number.day, fields=fields)
        self.ground = GroundStation(
            plan.mission,
            self.assembler,
            vehicle_system_id=number.system_id,
            system_id=GROUND_STATION[0] - (number.system_id - 1 if arming_gate is None else 0),
            component_id=GROUND_STATION[1] if arming_gate is None else _REAL_GROUNDS[place],
            on_progress=on_transfer,
            start_delay_s=start_delay_s,
            arming_gate=arming_gate,
            maker=maker,
            force=force,
        )
        self.ordered: list[str] = []  # Orders of a watcher that were carried out, with their times
        self._flown = FlownLength(self.ground.tracks, farm.frame)
        self._travel_cost = task.travel_cost_in_flight(plan.path_m)
        self._last_item = 0
        self._passed = 0
        # For each path with added waypoints (at corners or round obstacles): items, path and waypoints.
        self._led: list[tuple[tuple[MissionItem, ...], Points, Waypoints]] = []
        if self._leads and vehicle.mission.file is None:
            sent = task.builder.waypoints(plan.path_m, task.request.start_xy_m)
            # The path of a sortie that was cut from a mission already includes the added waypoints.
            if len(sent.points_m) == len(self._waypoints_of(plan.mission.items, 0)):
                self._led = [(plan.mission.items, plan.path_m, sent)]
        self._rest_known = _NO_REST
        self._on_path = len(self._rest_points())
        self._ending_told: int | None = None
        self._open: list[tuple[int, PathChange]] = []

    @property
    def system_id(self) -> int:
        """The vehicle's MAVLink system id."""
        return self.number.system_id

    @property
    def _leads(self) -> bool:
        """Whether the mission may have waypoints that are not points of the path."""
        builder = self.task.builder
        return builder.cornering.overshoot_m > 0.0 or builder.keep_out is not None

    @property
    def done(self) -> bool:
        """Whether the flight is over."""
        return self.ground.done

    @property
    def path_m(self) -> Points:
        """Points of the vehicle's whole current path, in metres of the farm frame."""
        items = self.ground.mission.items
        return self._points_of(items, self._waypoints_of(items, 0))

    def held_mission(self) -> Mission:
        """Return the mission that the vehicle holds."""
        return self.ground.mission

    def is_changing(self) -> bool:
        """Return whether the vehicle's mission is being changed."""
        return self.ground.changing

    def take(self) -> Observations:
        """Return the observations that arrived since the last call."""
        seen, offset_s = self.assembler.take(), self.ground.clock_offset_s
        # Vehicles are switched on at different times; the offset converts their clocks to a common clock.
        return replace(seen, time_s=seen.time_s + offset_s) if offset_s and len(seen) else seen

    @property
    def _rest(self) -> list[int]:
        """Item numbers of the remaining waypoints."""
        return self._waypoints_of(self.ground.mission.items, self._item)

    @staticmethod
    def _waypoints_of(items: Sequence[MissionItem], begin: int) -> list[int]:
        return [k for k in range(begin, len(items)) if items[k].command == Command.NAV_WAYPOINT]

    @property
    def _item(self) -> int:
        """The mission item that the vehicle reported last; a mission change does not reset it."""
        told = self.ground.vehicle_state.item
        if told is not None:
            self._last_item = told
        return self._last_item

    def _rest_points(self) -> Points:
        """Return the remaining points of the path, in metres of the farm frame."""
        items, item = self.ground.mission.items, self._item
        known_items, known_item, known = self._rest_known
        if known_items is not items or known_item != item:
            known = self._points_of(items, self._rest)
            self._rest_known = items, item, known
        return known.copy()

    def _points_of(self, items: tuple[MissionItem, ...], left: list[int]) -> Points:
        """Return the path points of the mission items with the indices `left`, the last items of a path."""
        for held, path_m, sent in self._led:
            if held is items:
                return path_m[sent.of_point[-len(left)] :] if left else path_m[:0]
        rest = np.array([(items[k].x, items[k].y) for k in left]).reshape(-1, 2)
        return np.column_stack(self.plan.farm.frame.from_wgs84(rest[:, 0], rest[:, 1]))

    @property
    def waypoints_reached(self) -> int:
        """Number of waypoints that the vehicle has passed, over all its paths."""
        return self._passed + self._on_path - len(self._rest_points())

    def is_ending(self, now_s: float) -> bool:
        """Return whether the path is about to end; True only once for each number of remaining points."""
        if self.status(now_s) is not Status.FLYING:
            return False
        rest = self._rest_points()
        if self._ending_told == len(rest):
            return False
        path = np.vstack((self.ground.vehicle_state.position_m(self.plan.farm.frame), rest))
        length_m = path_length(path)
        speed_m_s = max(self.ground.vehicle_state.ground_speed_m_s, SLOWEST_M_S)
        # The last point counts as reached within the acceptance radius.
        left_m = length_m - self.task.builder.cornering.radius_m
        ends = left_m < speed_m_s * (ENDING_S + self._delay_s)
        if ends:
            self._ending_told = len(rest)
        return ends

    def report(self, now_s: float, ahead_s: float = 0.0) -> VehicleReport:
        """Return the vehicle's state from its telemetry; `spent` includes the next `ahead_s` seconds."""
        state, frame = self.ground.vehicle_state, self.plan.farm.frame
        task = self.task
        heard = state.heard_s > -math.inf
        position_m = state.position_m(frame) if heard else task.request.start_xy_m
        velocity_m_s = state.velocity_in(frame) if heard else (0.0, 0.0)
        in_flight = InFlight(
            position_m, max(state.height_m, 0.0), velocity_m_s, state.velocity_m_s[2], state.heading_rad
        )
        rest_m = self._rest_points()
        return VehicleReport(
            system_id=self.system_id,
            request=task.request,
            status=self.status(now_s),
            position_m=position_m,
            velocity_m_s=velocity_m_s,
            age_s=now_s - state.heard_s if heard else 0.0,
            spent=self._spent(now_s) + ahead_s * self._cost_a_second,
            rest_m=rest_m,
            travel_cost=self._travel_cost(in_flight, rest_m, self.ground.changes_aside),
            battery=state.battery.remaining,
            delay_s=self._delay_s,
            contact=None if self._station_range is None else self._station_range.contact_area(self._delay_s),
        )

    def status(self, now_s: float) -> Status:
        """Return the vehicle's status, from its telemetry."""
        ground, state = self.ground, self.ground.vehicle_state
        if ground.phase in (Phase.DONE, Phase.FETCH):
            return Status.ENDED if ground.outcome.is_good else Status.LOST
        if ground.phase is not Phase.FLIGHT:
            return Status.READY
        silent_s = now_s - state.heard_s
        if silent_s > SILENT_S + self._absence_s(silent_s):
            return Status.LOST
        if silent_s > SILENCE_S or not ground.is_told_anew:
            return Status.SILENT
        if ground.pilot.taken_out:
            return Status.PILOTED
        if ground.changing:
            return Status.CHANGING
        items = ground.mission.items
        if self._item < len(items) and items[self._item].command == Command.NAV_TAKEOFF:
            return Status.CLIMBING
        return Status.FLYING if self._rest else Status.RETURNING

    def _absence_s(self, silent_s: float) -> float:
        """Return how long (s) the vehicle may be silent because its path leads beyond radio range."""
        if self._station_range is None or not SILENT_S < silent_s < math.inf:
            return 0.0
        onward = np.vstack((self._rest_points(), self._end_m()))
        here_m = self.ground.vehicle_state.position_m(self.plan.farm.frame)
        return self._station_range.absence_s(here_m, onward, self._mean_speed_m_s)

    def _end_m(self) -> Points:
        """Return home, float64[1, 2], if the mission leads home after its path; else an empty array."""
        home = self.task.request.start_xy_m
        return np.array([home]) if leads_home(self.ground.mission.items) else np.empty((0, 2))

    def give_up_lost(self, now_s: float) -> None:
        """End the flight of a vehicle that is lost because its path ends beyond radio range."""
        stays = self._station_range is not None and not len(self._end_m())
        if stays and not self.done and self.status(now_s) is Status.LOST:
            silent_s = now_s - self.ground.vehicle_state.heard_s
            why = f"its path ends beyond radio range; nothing was heard for {silent_s:.0f} s"
            self.ground.interrupt(Outcome.LINK_LOST, why, now_s)

    def _spent(self, now_s: float) -> float:
        """Return how much of its budget the flight has spent, in the unit of the budget."""
        ground, budget, vehicle = self.ground, self.task.request.budget, self.plan.vehicle
        if ground.started_s is None:
            return 0.0
        # A simulator's clock may be faster than the host's clock; the later of both times counts.
        flown_s = max(now_s - ground.started_s, ground.flight_time_s)
        if budget.unit == "m":
            # During silence no track is known, so those seconds count as flown at full speed.
            return self._flown.measure() + ground.silent_s * self.task.builder.level.speed_m_s
        if budget.unit == "steps":
            return math.floor(flown_s / vehicle.step_s + 1e-6)
        if budget.unit == "Wh":
            return self._drawn_wh(flown_s)
        return flown_s

    def _drawn_wh(self, flown_s: float) -> float:
        """Return the energy drawn (Wh), plus the part of the budget that the battery lacked at the start.

        A real PX4 reports percent and not energy; a real battery may be only half full at the start.
        """
        ground, battery = self.ground, self.plan.vehicle.battery
        before, now = ground.battery_before, ground.vehicle_state.battery
        if ground.arming_gate is None or battery is None:
            return now.consumed_wh or 0.0
        full = 1.0 if before.remaining is None else before.remaining
        known = []
        if now.remaining is not None:
            known.append((full - now.remaining) * battery.capacity_wh)
        if now.consumed_wh is not None and before.consumed_wh is not None:
            known.append(now.consumed_wh - before.consumed_wh)
        held_wh = (full - battery.reserve_fraction) * battery.capacity_wh
        lacked_wh = max(0.0, self.task.request.budget.limit - held_wh)
        return max(known, default=self._mean_wh_s * flown_s) + lacked_wh

    @property
    def _delay_s(self) -> float:
        known = [change.delay_s for change in self.ground.changes if change.delay_s is not None]
        return median(known) if known else 0.0

    def steer(self, points_m: Points, now_s: float) -> PathChange:
        """Start a change of the vehicle's path; the returned record is updated when the outcome is known."""
        ground, frame = self.ground, self.plan.farm.frame
        started_s = ground.started_s or 0.0
        position_m = ground.vehicle_state.position_m(frame)
        change = PathChange(self.system_id, position_m, points_m, math.nan, sent_s=now_s - started_s)
        if ground.changes_aside and is_same_path(points_m, self._rest_points()):
            change.outcome = FLOWN_ALREADY
            return change
        station = self._station_range
        if station is not None and station.is_near_border(position_m, self._delay_s):
            change.outcome = "not sent: the vehicle might leave radio range during the change"
            return change
        builder = self.task.builder
        if not len(points_m) and not len(self._end_m()):
            # The mission does not lead home, so the path ends at the vehicle's position.
            points_m = np.array([position_m])
        sent = builder.waypoints(points_m, position_m)
        latitude, longitude = frame.to_wgs84(sent.points_m[:, 0], sent.points_m[:, 1])
        mission, resume_at = revised_mission(
            ground.mission,
            self._item,
            list(zip(latitude.tolist(), longitude.tolist(), strict=True)),
            altitude_m=builder.level.altitude_m,
            acceptance_radius_m=sent.radius_m,
        )
        if self._leads:
            self._led = [*self._led[-1:], (mission.items, points_m, sent)]
            self._rest_known = _NO_REST
        try:
            messages = ground.change(mission, resume_at, now_s)
        except WbfMissionError as error:
            change.outcome = str(error)
            return change
        self._passed, self._on_path = self.waypoints_reached, len(points_m)
        self._ending_told = None
        self._open.append((len(ground.changes), change))
        self.send(messages)
        return change

    def note_changes(self) -> None:
        """Update the records of the open path changes."""
        started_s = self.ground.started_s or 0.0
        still = []
        for number, change in self._open:
            if number >= len(self.ground.changes):
                if self.done and self.ground.outcome.is_good and not len(change.path_m):
                    # The change ended the flight before the vehicle confirmed the change.
                    change.outcome, change.effect_s = "flown", self.ground.flight_time_s
                    continue
                still.append((number, change))
                continue
            record = self.ground.changes[number]
            done = record.outcome is ChangeOutcome.DONE
            change.outcome = "flown" if done else f"{record.outcome.value}: {record.text}"
            turned = record.turned_s if record.turned_s is not None else record.in_effect_s
            change.effect_s = None if turned is None else turned - started_s
        self._open = still

    def record(self) -> FlightRecord:
        """Return the record of the flight."""
        ground, battery = self.ground, self.plan.vehicle.battery
        before, lowest, used = ground.battery_before, ground.battery_lowest, None
        if battery is not None:
            used = lowest.used_since(before, battery.capacity_wh)
        frame = self.plan.farm.frame
        track = ground.tracks.track(frame)
        return FlightRecord(
            day=self.number.day,
            flight=self.number.flight,
            system_id=self.system_id,
            plan=self.plan,
            outcome=ground.outcome,
            reason=ground.reason,
            track=replace(track, time_s=track.time_s + ground.clock_offset_s),
            true_track=ground.tracks.true_track(frame),
            camera=self.assembler.statistics,
            transfers=ground.all_transfers,
            battery_used=used,
            battery_readings=(before.remaining, lowest.remaining),
            flight_time_s=ground.flight_time_s,
            texts=ground.texts,
            link=ground.link_report,
            missing_images=self._missing_images,
            warnings=[
                *self.plan.warnings,
                *filter(None, [self.assembler.mismatch(), self._missing(), self._not_repeatable()]),
            ],
        )

    @property
    def _missing_images(self) -> int:
        """Number of images that were lost in transfer, or never taken because the link was dead."""
        return len(self.assembler.missing()) + self.images_missed()

    def _not_repeatable(self) -> str | None:
        """Return the warning that orders changed a simulated flight, or None without orders."""
        if not self.ordered or self.ground.arming_gate is not None:
            return None
        return f"ordered by hand: {', '.join(self.ordered)}; the seed cannot repeat this flight"

    def _missing(self) -> str | None:
        """Return the warning about missing images of a real flight, or None if there are none."""
        missing, report = self._missing_images, self.ground.link_report
        if report is None or not missing:
            return None
        silent = f"; nothing was heard of the vehicle for {report.silent_s:.0f} s" if report.silent_s else ""
        return f"about {missing} images are missing for good{silent}"


def _nobody_sends(_messages: list[Message]) -> None:
    raise RuntimeError("no host flies the sortie")
