"""Ground station that flies one mission: upload, arming, start, and monitoring of the flight, sans-IO."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from mission.ground.arming_gate import ArmingGate
from mission.ground.changes import MissionChanges
from mission.ground.contact import Contact, Heartbeat
from mission.ground.images import ImageFetch
from mission.ground.link_state import LinkReport, SilenceWatch
from mission.ground.mission_end import MissionEnd
from mission.ground.modes import Maneuver
from mission.ground.orders import FlightOrders, NotFlyingError
from mission.ground.start import STARTING, MissionStart
from mission.ground.tracks import TrackRecorder, TrueState
from mission.ground.uploads import PlanUploads
from mission.ground.vehicle_state import SHARED_ID, Battery, VehicleState
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.typed import handler
from mission.model import Mission, MissionType
from mission.outcome import Outcome, Phase
from mission.transfer import CLIENT_MESSAGES, OWN_TRANSFERS, TransferMaker, TransferStatistics
from mission.transfer.wire import GROUND_STATION, command_long
from sensors.camera.wire import ObservationAssembler

_CONTACT_S = 30.0
_STATE_S, _STATE_BEHIND_LINK_S = 2.5, 5.0
"""Longest wait for the last mission state after disarming (s): of a simulated and of a real vehicle."""
_CLOCK_S = 5.0
"""Longest wait for the vehicle's clock after a silence (s); three round trips are added."""
_BEFORE_FLIGHT = frozenset({Phase.CONTACT, Phase.UPLOAD}) | STARTING
_BEFORE_ARMING = _BEFORE_FLIGHT - {Phase.ARM, Phase.START}
_OTHER_FLIES = "the motors run, but not by this program: somebody else flies the vehicle; disarm it first"
_STREAM_HZ = 4
_FAST = (int(m.MAVLINK_MSG_ID_GLOBAL_POSITION_INT), int(m.MAVLINK_MSG_ID_ATTITUDE))
_FAST_US = 100_000
_IMAGES = (int(m.MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED), int(m.MAVLINK_MSG_ID_DEBUG_FLOAT_ARRAY))
_OF_CAMERA = frozenset({*_IMAGES, int(m.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS)})
_ESTIMATES = (
    int(m.MAVLINK_MSG_ID_GPS_RAW_INT),
    int(m.MAVLINK_MSG_ID_EKF_STATUS_REPORT),
    int(m.MAVLINK_MSG_ID_ESTIMATOR_STATUS),
)
"""Messages that only `VehicleMonitor` reads."""


class GroundStation:
    """Ground station for one mission: waits for the vehicle, uploads, verifies, arms, starts and monitors.

    Parameters
    ----------
    assembler : ObservationAssembler or None
        Decoder of the camera's messages into observations.
    on_progress : callable, optional
        ``on_progress(done, total)``, called for each uploaded item.
    start_delay_s : float
        Delay between upload and start (s); unused with an arming gate.
    arming_gate : ArmingGate, optional
        Conditions for arming a real vehicle. A pilot may take over a real vehicle; then the station gives no
        more orders. None: the vehicle is simulated, and is armed after `start_delay_s`.
    force : bool
        Whether to send items that the autopilot would refuse or not fly, and to start a real vehicle whose
        motors run already.

    Attributes
    ----------
    reason : str
        Reason of the outcome, if possible the vehicle's text.
    pilot : PilotWatch
        Detector of other pilots who take over the vehicle.
    link : LinkState
        Quality of the link to a real vehicle.
    texts : list of tuple
        STATUSTEXTs of the vehicle: time (s), severity, text.
    text_log : TextLog
        Log of these texts, which drops the oldest of very many.
    transfers : list of TransferStatistics
        Statistics of each upload before the flight.
    changes : list of ChangeRecord
        Outcome of each change of the mission in flight.
    parameters_set : list of str
        Vehicle parameters that were set, with old and new value.
    started_s, ended_s : float or None
        Start time of the mission and end time of the run.
    """

    def __init__(
        self,
        mission: Mission,
        assembler: ObservationAssembler | None = None,
        *,
        vehicle_system_id: int = 1,
        system_id: int = GROUND_STATION[0],
        component_id: int = GROUND_STATION[1],
        on_progress: Callable[[int, int], None] | None = None,
        start_delay_s: float = 0.0,
        arming_gate: ArmingGate | None = None,
        maker: TransferMaker = OWN_TRANSFERS,
        force: bool = False,
    ) -> None:
        self.system_id, self.component_id = system_id, component_id
        self.vehicle_system_id = vehicle_system_id
        self.arming_gate, self._force = arming_gate, force
        self.phase = Phase.CONTACT
        self.outcome = Outcome.RUNNING
        self.reason = ""
        self.started_s: float | None = None
        self.ended_s: float | None = None
        self.battery_before = Battery()
        contact = self._contact = Contact(
            (vehicle_system_id, int(m.MAV_COMP_ID_AUTOPILOT1)),
            (system_id, component_id),
            maker=maker,
            is_real=arming_gate is not None,
        )
        self.link, self._monitor, self.text_log = contact.link, contact.monitor, contact.texts
        self._uploads = PlanUploads(mission, contact, on_progress=on_progress, force=force)
        self._start = MissionStart(contact, arming_gate, start_delay_s)
        self._changes = MissionChanges(contact, mission)
        self._end_of_mission = MissionEnd(contact, self._changes)
        self.pilot, self._failures = self._end_of_mission.pilot, self._end_of_mission.failures
        self._orders = FlightOrders(contact, self._changes, self.pilot)
        self.tracks, self._heartbeat, self._silences = TrackRecorder(), Heartbeat(), SilenceWatch()
        self.texts, self.transfers = contact.texts.texts, self._uploads.statistics
        self.changes, self.parameters_set = self._changes.records, self._changes.parameters_set
        self._assembler = assembler
        self._fetch: ImageFetch | None = None
        self._no_position = True  # no position was received since the last HEARTBEAT
        self._armed = self._flew = False
        self._texts_before = 0
        self._first_s: float | None = None
        self._disarmed_s: float | None = None
        self._started_boot_s = 0.0
        self._restarts = 0
        self._back_s, self._unsure_s = math.inf, -math.inf
        self._handlers: dict[int, Callable[[Any, float], list[Message] | None]] = {
            **dict(
                (
                    handler(m.MAVLink_heartbeat_message, self._on_heartbeat),
                    handler(m.MAVLink_command_ack_message, self._on_ack),
                    handler(m.MAVLink_statustext_message, self._on_text),
                    handler(m.MAVLink_global_position_int_message, self._on_position),
                    handler(
                        m.MAVLink_battery_status_message,
                        lambda message, _now_s: self._failures.on_battery_status(message),
                    ),
                    handler(m.MAVLink_sys_status_message, self._on_sys_status),
                    handler(m.MAVLink_mission_current_message, self._on_mission_current),
                    handler(
                        m.MAVLink_extended_sys_state_message,
                        lambda message, _now_s: self.tracks.on_landed_state(message),
                    ),
                    handler(m.MAVLink_hil_state_quaternion_message, self._on_truth),
                    handler(m.MAVLink_sim_state_message, self._on_truth),
                )
            ),
            # `MissionChanges` handles the message.
            int(m.MAVLINK_MSG_ID_PARAM_VALUE): _ignore,
            **dict.fromkeys(CLIENT_MESSAGES, self._on_transfer),
        }
        if assembler is not None:
            fetch = self._fetch = ImageFetch(assembler, vehicle_system_id, contact.round_trip)
            self._handlers |= dict.fromkeys(_IMAGES, lambda message, _now_s: assembler.add(message))
            self._handlers[m.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS] = lambda message, _now_s: (
                fetch.on_capture_status(message)
            )
        if arming_gate is not None:
            self._handlers[m.MAVLINK_MSG_ID_SYSTEM_TIME] = self._on_system_time
            self._handlers[m.MAVLINK_MSG_ID_MISSION_ITEM_REACHED] = lambda message, now_s: (
                self._end_of_mission.on_reached(message, now_s) if self._flies_mission else None
            )
            self._handlers |= dict.fromkeys(_ESTIMATES, _ignore)
        # The link quality of a real vehicle counts every frame.
        self.wanted: frozenset[int] | None = None if arming_gate is not None else frozenset(self._handlers)

    @property
    def done(self) -> bool:
        """Whether the run has ended."""
        return self.phase is Phase.DONE

    @property
    def mission(self) -> Mission:
        """Mission that the vehicle holds, or that will be uploaded."""
        return self._changes.held

    @property
    def all_transfers(self) -> list[TransferStatistics]:
        """Statistics of the uploads before the flight, and of the changes in flight."""
        again = sum(change.retries for change in self.changes)
        changes = TransferStatistics(MissionType.MISSION, 0, 0, 0, again, 0.0, verified=True)
        return [*self.transfers, *([changes] if again else [])]

    @property
    def flight_time_s(self) -> float:
        """Time from the start of the mission to the reported landing (s)."""
        if self.started_s is None:
            return 0.0
        return max(0.0, self.tracks.aloft_ms / 1e3 - self._started_boot_s)

    @property
    def clock_offset_s(self) -> float:
        """Time of the station's clock minus time of a real vehicle's clock (s); 0 before the mission."""
        if self.arming_gate is None or self.started_s is None:
            return 0.0
        return self.started_s - self._started_boot_s

    @property
    def battery_lowest(self) -> Battery:
        """Lowest battery reading with running motors since the start of the mission."""
        return self._monitor.lowest_battery

    @property
    def vehicle_state(self) -> VehicleState:
        """State of the vehicle from its last telemetry."""
        return self._monitor.state

    @property
    def is_told_anew(self) -> bool:
        """Whether HEARTBEAT and MISSION_CURRENT have arrived since the last silence."""
        heard_s = self._monitor.mode_heard_s, self._monitor.item_heard_s
        return self._back_s == math.inf or all(
            time_s >= self._back_s or time_s == -math.inf for time_s in heard_s
        )

    @property
    def mode(self) -> str:
        """Name of the vehicle's flight mode, empty before the first heartbeat."""
        return self._monitor.mode

    @property
    def changing(self) -> bool:
        """Whether a change of the mission is in progress."""
        return self._changes.running

    @property
    def changes_aside(self) -> bool:
        """Whether the vehicle leaves the mission mode during a change."""
        return self._changes.aside

    def change(self, mission: Mission, resume_at: int, now_s: float) -> list[Message]:
        """Begin a change of the mission in flight, by the safest method for the autopilot.

        After the change, `changes` has the outcome, and the property `mission` is the mission on the vehicle.

        Parameters
        ----------
        mission : Mission
            Mission with the new items. Fence, rally points and home do not change.
        resume_at : int
            Item of `mission` to fly to next. DO items directly before this item are executed if they change
            the present settings.

        Raises
        ------
        NotFlyingError
            Before or after the flight, or during another change.
        MissionError, LocalTransferError
            If the mission must not be sent to a vehicle in flight (`mission.ground.changes.check_change`).
        """
        if self.phase is not Phase.FLIGHT or self._disarmed_s is not None:
            msg = f"the mission cannot be changed in this phase of the flight ({self.phase.value})"
            raise NotFlyingError(msg)
        self._orders.check_mission()
        out = self._changes.begin(mission, resume_at, self._uploads.seconds_an_item, now_s)
        if not self._end_of_mission.says_finished:
            self.pilot.on_new_mission()
        return out

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Handle one message; return the messages to send."""
        number = type(message).id
        is_autopilot = (message.get_srcSystem(), message.get_srcComponent()) == self._contact.vehicle
        if self.arming_gate is not None and is_autopilot:
            is_news = self.link.receive(message, now_s)
            if given_up := self._look_at_clock(now_s):
                return given_up
            if not is_news:
                return []
        handle = self._handlers.get(number)
        if handle is None or message.get_srcSystem() != self.vehicle_system_id:
            return []
        # A real vehicle may carry a simulated camera, which can be heard even if the vehicle is silent.
        if self.phase is Phase.FLIGHT and (is_autopilot or self.arming_gate is None):
            self._on_contact(now_s)
        if not is_autopilot:
            return handle(message, now_s) or [] if number in _OF_CAMERA else []
        self._monitor.receive(message, now_s)
        out = handle(message, now_s) or []
        return out + self._changes.receive(message, now_s) if self.phase is Phase.FLIGHT else out

    def poll(self, now_s: float) -> list[Message]:
        """Return the messages that are due: heartbeat, repeated orders, transfers, image requests."""
        out = self._heartbeat.poll(now_s)
        if self._first_s is None:
            self._first_s = now_s
        if not self.done:
            out += self.link.poll(now_s)
        out += self._look_at_clock(now_s)
        if self.phase is Phase.CONTACT and now_s - self._first_s > _CONTACT_S:
            why = f"no heartbeat of system {self.vehicle_system_id} in {_CONTACT_S:.0f} s"
            self._end(Outcome.NO_CONTACT, why, now_s)
        if self.phase is Phase.UPLOAD:
            out += self._after_upload(self._uploads.poll(now_s), now_s)
        if self.phase in STARTING:
            out += self._after_start(self._start.poll(now_s), now_s)
        out += self._orders.poll(now_s)
        if self.phase is Phase.FLIGHT:
            out += self._changes.poll(now_s)
        self.pilot.poll(now_s, unsure=now_s < self._unsure_s)
        if self.phase is Phase.FLIGHT and self._disarmed_s is not None and not self.pilot.in_doubt:
            state_s = _STATE_S if self.arming_gate is None else _STATE_BEHIND_LINK_S
            if now_s >= max(self._disarmed_s + state_s, self._unsure_s):
                self._land(*self._end_of_mission.cause(self._texts_before), now_s)
        if self._fetch is not None and self._fetches and now_s >= self._fetch.due_s:
            asked = self._fetch.ask(now_s)
            out += asked
            if not asked and self.phase is Phase.FETCH:
                self.phase = Phase.DONE
        return out

    def next_deadline(self) -> float:
        """Return the time of the next `poll` that has an effect; infinity after the end."""
        if self.done:
            return math.inf
        due_s = [
            self._heartbeat.due_s,
            self.link.next_deadline(),
            self._uploads.next_deadline(),
            self._start.next_deadline(),
            self.pilot.next_deadline(),
            self._orders.next_deadline(),
        ]
        if self.phase is Phase.FLIGHT:
            due_s.append(self._changes.next_deadline())
        if self._fetch is not None and self._fetches:
            due_s.append(self._fetch.due_s)
        return min(due_s)

    @property
    def link_report(self) -> LinkReport | None:
        """Link quality over the flight of a real vehicle, or None for a simulated vehicle."""
        if self.arming_gate is None:
            return None
        link, silences = self.link, self._silences
        return LinkReport(
            link.frames, link.lost_frames, link.round_trip.seconds, silences.worst_s, silences.silent_s
        )

    @property
    def silent_s(self) -> float:
        """Total silence of the vehicle during the flight (s)."""
        return self._silences.silent_s

    @property
    def _fetches(self) -> bool:
        """Whether lost images may be requested."""
        return self.phase in (Phase.FLIGHT, Phase.FETCH)

    def interrupt(self, outcome: Outcome, reason: str, now_s: float) -> None:
        """End the run before its own end; received data and the outcome of a finished flight are kept."""
        if self.phase is Phase.FETCH:
            self.phase = Phase.DONE
        if not self.done:
            self._end(outcome, reason, now_s)

    def goodbye(self) -> list[Message]:
        """Return the messages to send before the link closes: disarm a vehicle that may just have armed."""
        return self._start.goodbye()

    # Received messages.

    def _on_contact(self, now_s: float) -> None:
        """Record contact with the vehicle; after a silence, request the images that were lost."""
        if self._silences.on_message(now_s):
            # The vehicle was armed at the start of the mission, even if no armed HEARTBEAT arrived.
            self._flew = True
            self._back_s = now_s
            self._unsure_s = now_s + _CLOCK_S + 3.0 * (self.link.round_trip.seconds or 0.0)
            if self._fetch is not None:
                self._fetch.look_back(now_s, self._started_boot_s)

    def _on_heartbeat(self, message: m.MAVLink_heartbeat_message, now_s: float) -> list[Message]:
        self._armed = bool(message.base_mode & m.MAV_MODE_FLAG_SAFETY_ARMED)
        self._flew |= self._armed and self.phase is Phase.FLIGHT
        if self.phase is Phase.FLIGHT:
            self._failures.on_heartbeat(message, self.text_log.count - self._texts_before)
            # Nobody else can fly a simulated vehicle, so only its response to orders matters.
            if self.arming_gate is not None or self.pilot.ordered is not None:
                self.pilot.on_heartbeat(
                    message,
                    now_s,
                    expects_change=self.changing or self.flies_home,
                    flies_home=self.flies_home,
                    unsure=now_s < self._unsure_s,
                    ends_in=self._orders.end_modes,
                )
        if self._armed and self.phase in _BEFORE_ARMING and self.arming_gate is not None and not self._force:
            self._end(Outcome.NOT_STARTED, _OTHER_FLIES, now_s)
            return []
        if self.phase in STARTING:
            self._start.on_heartbeat()
            self._after_start([], now_s)
        if self.phase is Phase.CONTACT:
            self.phase = Phase.UPLOAD
            self._texts_before = self.text_log.count
            begun = self._uploads.start(now_s)
            self._changes.held = self._uploads.mission
            return self._ask_for_streams() + self._after_upload(begun, now_s)
        if self.phase is Phase.FLIGHT and self._flew and not self._armed and self._disarmed_s is None:
            # The mission state may arrive shortly after the disarming.
            self._disarmed_s = now_s
            if self._end_of_mission.is_complete:
                self._land(*self._end_of_mission.completed(self._texts_before), now_s)
        return self._ask_for_streams()

    def _ask_for_streams(self) -> list[Message]:
        """Request telemetry until positions arrive, if the autopilot sends telemetry only on request."""
        silent, self._no_position = self._no_position, True
        if not silent or not self._contact.profile.streams_on_request:
            return []
        vehicle = self._contact.vehicle
        return [
            m.MAVLink_request_data_stream_message(*vehicle, m.MAV_DATA_STREAM_ALL, _STREAM_HZ, 1),
            *(command_long(vehicle, m.MAV_CMD_SET_MESSAGE_INTERVAL, kind, _FAST_US) for kind in _FAST),
        ]

    @property
    def _flies_mission(self) -> bool:
        """Whether item numbers in the telemetry count in the current mission, flown by an armed vehicle."""
        return self.phase is Phase.FLIGHT and self._armed and not self.changing

    def _on_mission_current(self, message: m.MAVLink_mission_current_message, now_s: float) -> None:
        end = self._end_of_mission
        # After a reboot, which a silence may hide, the vehicle may hold no mission or an old one.
        rebooted = now_s < self._unsure_s or self.pilot.restarted
        started_s = None if self.arming_gate is None or rebooted else self.started_s
        end.on_mission_current(message, now_s, flies_mission=self._flies_mission, started_s=started_s)
        is_over = end.is_complete and (self._disarmed_s is not None or end.ends_flight)
        if self.phase is Phase.FLIGHT and is_over:
            self._land(*end.completed(self._texts_before), now_s)
        self._orders.on_mission_current()

    def _on_position(self, message: m.MAVLink_global_position_int_message, now_s: float) -> None:
        self._no_position = False
        self._on_clock(now_s)
        if self.phase is Phase.FLIGHT:
            monitor = self._monitor
            is_rover = monitor.vehicle_type == m.MAV_TYPE_GROUND_ROVER
            self.tracks.on_position(message, round(1e3 * monitor.boot_s), is_rover=is_rover)

    def _on_system_time(self, message: m.MAVLink_system_time_message, now_s: float) -> None:
        """Handle SYSTEM_TIME; after a reboot, it arrives earlier than the first position."""
        self._monitor.clock.take(message.time_boot_ms, now_s)
        self._on_clock(now_s)

    def _on_clock(self, now_s: float) -> None:
        """Handle a new reading of the vehicle's clock, which may show a reboot; one in flight is reported."""
        unsure, self._unsure_s = now_s < self._unsure_s, -math.inf
        clock = self._monitor.clock
        if clock.is_shared and self.phase in _BEFORE_FLIGHT and self.arming_gate is not None:
            self._end(Outcome.NOT_STARTED, f"{SHARED_ID}; give each vehicle its own system id", now_s)
        elif clock.restarts > self._restarts:
            self._restarts = clock.restarts
            heard_since = unsure and self._monitor.mode_heard_s >= self._back_s
            if self.phase not in _BEFORE_FLIGHT:
                self.pilot.on_restart(self._monitor.heartbeat if heard_since else None, now_s)
            if self._assembler is not None:
                self._assembler.move_clock(clock.offset_ms / 1e3)
        elif unsure:
            self.pilot.settle()

    def _on_truth(self, message: TrueState, now_s: float) -> None:
        self.tracks.on_truth(message, now_s, flying=self.phase is Phase.FLIGHT)

    def _on_sys_status(self, message: m.MAVLink_sys_status_message, now_s: float) -> None:
        if self.phase is Phase.FLIGHT:
            self._failures.on_sys_status(message)
        self._start.on_sys_status(message, now_s)

    def _on_text(self, message: m.MAVLink_statustext_message, now_s: float) -> None:
        self.text_log.on_text(message, now_s)
        if self.arming_gate is not None:
            self.arming_gate.on_text(message.text)
        if self.phase is Phase.FLIGHT and self._armed:
            self._end_of_mission.on_text(message, now_s)

    def _on_transfer(self, message: Message, now_s: float) -> list[Message]:
        if self.phase is not Phase.UPLOAD:
            return []
        return self._after_upload(self._uploads.receive(message, now_s), now_s)

    def _on_ack(self, message: m.MAVLink_command_ack_message, now_s: float) -> list[Message]:
        if self.phase in STARTING:
            return self._after_start(self._start.on_ack(message, now_s), now_s)
        self._orders.on_ack(message, now_s)
        return []

    # Transitions.

    def _after_upload(self, out: list[Message], now_s: float) -> list[Message]:
        """Start the flight after the uploads, or end the run if an upload failed."""
        if self._uploads.failure:
            reason = self.text_log.explain(self._uploads.failure, self._texts_before)
            silent = self.arming_gate is not None and self._uploads.fell_silent
            outcome = Outcome.NO_ANSWER if silent else Outcome.UPLOAD_FAILED
            self._end(outcome, reason, now_s)
        elif self._uploads.done:
            out += self._after_start(self._start.begin(self.mission.home, self._texts_before, now_s), now_s)
        return out

    def _look_at_clock(self, now_s: float) -> list[Message]:
        """If the program was suspended, end the start; in flight, repeat no order."""
        if self.arming_gate is None or self.done:
            return []
        if self.phase not in _BEFORE_FLIGHT:
            if self.arming_gate.outlived_s() > 0.0:
                self._back_s = now_s
                self._monitor.doubt(now_s)
                self._orders.end_repeats(now_s)
            return []
        out = self._start.look_at_clock(now_s)
        return out if self._start.failure is None else self._after_start(out, now_s)

    def _after_start(self, out: list[Message], now_s: float) -> list[Message]:
        """Take over the phase of the start; begin the flight, or end the run if the start failed."""
        start = self._start
        self.phase = start.phase
        if start.failure is not None:
            self._end(*start.failure, now_s)
        elif self.phase is Phase.FLIGHT:
            self.started_s = self._started_boot_s = now_s
            if self.arming_gate is not None:
                # A real vehicle's clock counts from its boot.
                self._started_boot_s = self._monitor.boot_s
            self.battery_before = self._monitor.battery
            self._monitor.begin_flight()
            self._silences.on_message(now_s)
            self._texts_before = self.text_log.count
        return out

    @property
    def flies_home(self) -> bool:
        """Whether the vehicle has passed all waypoints of the mission."""
        return self._end_of_mission.flies_home

    def maneuver(self, kind: Maneuver, now_s: float) -> list[Message]:
        """Order the vehicle to hold, return, land, or resume its mission.

        Raises NotFlyingError before or after the flight, while another pilot flies the vehicle, and if the
        vehicle has no mode for the order. An order to resume also raises NotFlyingError if the vehicle flies
        its mission, or if an aborted change has left the vehicle with an unknown mission.
        """
        self._check_in_flight()
        return self._orders.maneuver(kind, now_s)

    def choose_item(self, item: int, now_s: float) -> list[Message]:
        """Order the vehicle to continue its mission at ``item``, counted from 0 like `Mission.items`.

        Raises NotFlyingError like `maneuver`, during a change of the mission, and if the item does not exist.
        """
        self._check_in_flight()
        return self._orders.choose_item(item, now_s)

    def _check_in_flight(self) -> None:
        if self.phase is not Phase.FLIGHT or self._disarmed_s is not None:
            raise NotFlyingError(f"the vehicle does not fly in this phase ({self.phase.value})")

    def _land(self, outcome: Outcome, reason: str, now_s: float) -> None:
        """End the flight, and request the images that were lost, if any."""
        self.outcome, self.reason, self.ended_s = outcome, reason, now_s
        missing = self._fetch is not None and self._fetch.begin(now_s, self._started_boot_s)
        self.phase = Phase.FETCH if missing else Phase.DONE

    def _end(self, outcome: Outcome, reason: str, now_s: float) -> None:
        self.outcome, self.reason, self.phase = outcome, reason, Phase.DONE
        if self.ended_s is None:
            self.ended_s = now_s


def _ignore(_message: Message, _now_s: float) -> None:
    """Do nothing more with a message that is handled elsewhere (by `VehicleMonitor`, `MissionChanges`)."""
