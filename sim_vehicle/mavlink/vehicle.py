"""The simulated vehicle as a MAVLink component: what it hears, what it answers, what it tells by itself."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from dataclasses import replace

from geo.frame import LocalFrame
from mission.errors import LinkError
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.frames import Message
from mission.link.codec.signing import Signing
from mission.model import Command, GeoPoint, MissionItem, MissionType
from mission.transfer import wire
from mission.transfer.events import (
    Event,
    FailureReason,
    Output,
    PlanCleared,
    PlanReplaced,
    StatusText,
    TransferFailed,
    TransferStarted,
)
from mission.transfer.server import MissionServer
from mission.transfer.storage import UncheckedItem
from sim_vehicle.airframe.sensor_errors import NavigationErrors, Sensed, SensorNoise
from sim_vehicle.airframe.spec import VehicleSpec
from sim_vehicle.autopilot import adapt_vehicle, get_autopilot
from sim_vehicle.autopilot.autopilot import Autopilot
from sim_vehicle.autopilot.modes import Mode
from sim_vehicle.component import NEVER
from sim_vehicle.execution.items import DO_COMMANDS, NAV_COMMANDS
from sim_vehicle.execution.state import CameraCommand, FlightEvent, HomeMoved, ItemReached
from sim_vehicle.mavlink import commands, setpoint_messages
from sim_vehicle.mavlink.camera_commands import CAMERA, CameraOrders
from sim_vehicle.mavlink.parameters import ParameterSet
from sim_vehicle.mavlink.schedule import Schedule
from sim_vehicle.mavlink.telemetry import BUILDERS, STREAMS
from sim_vehicle.pilot.notices import RefusedError, Severity
from sim_vehicle.pilot.outcome import Outcome
from sim_vehicle.pilot.pilot import Pilot
from sim_vehicle.weather.wind import Wind

__all__ = ["SimVehicle"]

_AUTOPILOT = int(m.MAV_COMP_ID_AUTOPILOT1)
_PLANNER = int(m.MAV_COMP_ID_MISSIONPLANNER)
_TICK_S = 0.1
_TRUTH_HZ = 10.0
_TEXT_BYTES = 50
_DEFAULT_EPOCH_S = 1_780_315_200.0  # 2026-06-01T12:00:00Z, so that equal runs give equal bytes
AREA_COMMANDS = frozenset(
    {*range(Command.NAV_FENCE_RETURN_POINT, Command.NAV_FENCE_CIRCLE_EXCLUSION + 1), Command.NAV_RALLY_POINT}
)
_MISSION_IDS = frozenset(wire.SERVER_MESSAGES)
_KNOWN_ITEMS = NAV_COMMANDS | DO_COMMANDS | frozenset(range(5000, 5005)) | {int(Command.NAV_RALLY_POINT)}
_COMMAND_IDS = frozenset({m.MAVLINK_MSG_ID_COMMAND_LONG, m.MAVLINK_MSG_ID_COMMAND_INT})
_PARAMETER_IDS = frozenset(
    {
        m.MAVLINK_MSG_ID_PARAM_REQUEST_LIST,
        m.MAVLINK_MSG_ID_PARAM_REQUEST_READ,
        m.MAVLINK_MSG_ID_PARAM_SET,
    }
)


class SimVehicle:
    """A vehicle that speaks MAVLink.

    Parameters
    ----------
    spec : VehicleSpec
        What it can do.
    home : GeoPoint
        Where it stands at the start; the altitude is that of the ground.
    wind : Wind, optional
    autopilot : Autopilot, optional
        Whom it shows itself as; the default autopilot without.
    system_id : int
    yaw_deg : float
        Compass heading at the start.
    epoch_unix_s : float
        Time of day at the host's time 0, seconds since 1970.
    signing : Signing, optional
        The host's, so that SETUP_SIGNING can change its key where it may.
    noise : SensorNoise, optional
        How wrong it believes to be where it is; exact without.

    Attributes
    ----------
    pilot : Pilot
        The vehicle without MAVLink: state, mode, outcome.
    schedule : Schedule
        Message intervals.
    sensed : Sensed
        Where it is, in truth and by its sensors.

    Examples
    --------
    >>> from sim_vehicle.airframe.catalog import get_vehicle
    >>> vehicle = SimVehicle(get_vehicle("quad"), GeoPoint(28.05, -82.15, 10.0))
    >>> [message.get_type() for message in vehicle.poll(0.0)][:2]
    ['HEARTBEAT', 'SYS_STATUS']
    >>> vehicle.outcome.value
    'running'
    """

    builders = BUILDERS

    def __init__(
        self,
        spec: VehicleSpec,
        home: GeoPoint,
        *,
        wind: Wind | None = None,
        autopilot: Autopilot | None = None,
        system_id: int = 1,
        yaw_deg: float = 0.0,
        epoch_unix_s: float = _DEFAULT_EPOCH_S,
        signing: Signing | None = None,
        noise: SensorNoise | None = None,
    ) -> None:
        self.autopilot = get_autopilot() if autopilot is None else autopilot
        spec = adapt_vehicle(spec, self.autopilot)
        self.firmware = firmware = self.autopilot.for_vehicle(spec.kind)
        persona = firmware.persona
        self._signing = signing
        self.errors = NavigationErrors(noise) if noise is not None and not noise.is_off else None
        self.sensed = Sensed.exact((0.0, 0.0, 0.0))
        self.system_id = system_id
        self.component_id = _AUTOPILOT
        self.home = home
        self.home_e7 = (
            round(home.latitude_deg * 1e7),
            round(home.longitude_deg * 1e7),
            round(home.altitude_m * 1e3),
        )
        frame = LocalFrame(home.latitude_deg, home.longitude_deg, home.altitude_m)
        self.pilot = Pilot(
            spec,
            frame,
            wind=wind,
            yaw_rad=math.radians(yaw_deg % 360.0),
            mode=persona.modes.boot,
            takes_off=firmware.takes_off,
            after_takeoff=persona.modes.after_takeoff,
            rules=firmware.rules,
            epoch_unix_s=epoch_unix_s,
        )
        self.place = self.home_e7
        self.schedule = self._default_schedule()
        self.has_camera = False
        self.now_us = 0
        self.boot_ms = 0
        self.unix_us = round(epoch_unix_s * 1e6)
        self._epoch_us = self.unix_us
        self._boot_us = 0
        self._tick_s = 0.0
        self._outbox: list[Message] = []
        self._texts = 0
        self._uploading = False
        self._returning = -1
        self._progress: tuple[object, ...] = ()
        self._camera = CameraOrders(system_id, self.say_warning)
        self._reached: tuple[int, int, float] | None = None
        self._current_due_s = NEVER
        self.plan_ids = (0, 0, 0)
        self._last_orders: dict[tuple[int, int], tuple[commands.Order, int]] = {}
        self._shown: tuple[object, ...] = ()
        self._parameters = ParameterSet(
            firmware.parameters(spec, system_id),
            self.pilot.parameters,
            persona.parameter_encoding,
            self.pilot.apply_parameters,
            self.say_warning,
            self._totals(),
        )
        self._missions = MissionServer(
            system_id,
            _AUTOPILOT,
            profile=firmware.profile,
            home=home,
            validator=self._check_item,
        )
        self._handlers: dict[int, Callable[[Message], None]] = {
            **dict.fromkeys(_COMMAND_IDS, self._on_command),
            **dict.fromkeys(_PARAMETER_IDS, self._on_parameter),
            **dict.fromkeys(_MISSION_IDS, self._on_mission),
            m.MAVLINK_MSG_ID_COMMAND_ACK: self._on_ack,
            m.MAVLINK_MSG_ID_HEARTBEAT: self._on_heartbeat,
            m.MAVLINK_MSG_ID_MISSION_SET_CURRENT: self._on_set_current,
            m.MAVLINK_MSG_ID_PING: self._on_ping,
            m.MAVLINK_MSG_ID_REQUEST_DATA_STREAM: self._on_data_stream,
            m.MAVLINK_MSG_ID_SET_MODE: self._on_set_mode,
            m.MAVLINK_MSG_ID_SETUP_SIGNING: self._on_setup_signing,
            m.MAVLINK_MSG_ID_TIMESYNC: self._on_timesync,
            **dict.fromkeys(setpoint_messages.MESSAGES, self._on_setpoint),
        }
        self.wanted: frozenset[int] | None = frozenset(self._handlers)

    @property
    def outcome(self) -> Outcome:
        """How the run ended, or that it has not."""
        return self.pilot.outcome

    @property
    def outcome_text(self) -> str:
        """Why it ended so."""
        return self.pilot.outcome_text

    @property
    def finished(self) -> bool:
        """Whether the run has ended and the vehicle is down and disarmed."""
        return self.pilot.outcome.is_over and not self.pilot.armed

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Take a message and return the answers; what is not for this vehicle is ignored."""
        handler = self._handlers.get(type(message).id)
        if handler is None or not self._is_mine(message):
            return []
        if type(message).id != m.MAVLINK_MSG_ID_HEARTBEAT:
            self._advance(now_s)
            handler(message)
            self._show_changes()
            return self._sent()
        if message.type == m.MAV_TYPE_GCS:
            self.pilot.failsafe.on_gcs_heartbeat(now_s)
        handler(message)
        return []

    def poll(self, now_s: float) -> list[Message]:
        """Fly up to now and return the telemetry and whatever else is due."""
        self._advance(now_s)
        if self._camera.next_deadline() <= now_s:
            self._outbox += self._camera.retry(now_s)
        self._repeat_reached(now_s)
        if self._current_due_s <= now_s:
            self._current_due_s = NEVER
            self._outbox += self.built(m.MAVLINK_MSG_ID_MISSION_CURRENT)
        deadline_s = self._missions.next_deadline()
        if deadline_s is not None and deadline_s <= now_s:
            self._take(self._missions.poll(now_s))
        self._show_changes()
        outbox = self._outbox
        for message_id in self.schedule.due(self.now_us):
            outbox.append(BUILDERS[message_id](self))
        return self._sent()

    def next_deadline(self) -> float:
        """When the next telemetry, retry or piece of flight is due."""
        deadline_s = self.schedule.next_us / 1e6
        if self.pilot.armed:
            deadline_s = min(deadline_s, self._tick_s + _TICK_S)
        deadline_s = min(deadline_s, self._camera.next_deadline())
        if self._reached is not None:
            deadline_s = min(deadline_s, self._reached[2])
        deadline_s = min(deadline_s, self._current_due_s)
        transfer_s = self._missions.next_deadline()
        return deadline_s if transfer_s is None else min(deadline_s, transfer_s)

    def _sent(self) -> list[Message]:
        outbox, self._outbox = self._outbox, []
        return outbox

    def _is_mine(self, message: Message) -> bool:
        system = getattr(message, "target_system", 0)
        if system not in (0, self.system_id):
            return False
        component = getattr(message, "target_component", 0)
        if component == _PLANNER:
            return type(message).id in _MISSION_IDS
        return component in (0, self.component_id)

    def _advance(self, now_s: float) -> None:
        """Fly up to now and say what happened."""
        now_us = round(now_s * 1e6)
        if now_us <= self.now_us and self._shown:
            return
        self.now_us = now_us
        since_boot_us = now_us - self._boot_us
        self.boot_ms = since_boot_us // 1000 & 0xFFFFFFFF
        self.unix_us = self._epoch_us + now_us
        self._tick_s = now_s
        pilot = self.pilot
        events = pilot.advance(now_s)
        place, errors = pilot.state.position_m, self.errors
        self.sensed = Sensed.exact(place) if errors is None else errors.sense(place, now_s)
        east, north, up = self.sensed.believed_m
        latitude, longitude = pilot.frame.to_wgs84(east, north)
        self.place = (
            round(latitude * 1e7),
            round(longitude * 1e7),
            round(1000.0 * (up + self.home.altitude_m)),
        )
        for event in self._merged(events) if self.firmware.persona.reached_merged else events:
            self._tell(event, now_s)

    def _merged(self, events: list[FlightEvent]) -> list[FlightEvent]:
        """Keep of items that ended together the last; a return that follows counts as reached already."""
        last = {event.time_s: event for event in events if isinstance(event, ItemReached)}
        items = self._missions.plan(MissionType.MISSION).items
        kept: list[FlightEvent] = []
        for event in events:
            if not isinstance(event, ItemReached):
                kept.append(event)
            elif event.seq == self._returning:
                self._returning = -1
            elif last[event.time_s] is event:
                following = event.seq + 1
                if following < len(items) and items[following].command == Command.NAV_RETURN_TO_LAUNCH:
                    self._returning = following
                    kept.append(replace(event, seq=following))
                else:
                    kept.append(event)
        return kept

    def _tell(self, event: FlightEvent, now_s: float) -> None:
        if isinstance(event, ItemReached):
            seq = self.wire_seq(event.seq)
            self._outbox.append(m.MAVLink_mission_item_reached_message(seq))
            repeats = self.firmware.persona.reached_repeats
            self._reached = (seq, repeats, now_s + 1.0) if repeats else None
        elif isinstance(event, HomeMoved):
            self.moved_home()
        elif isinstance(event, CameraCommand):
            item = event.item
            first = (item.param1, item.param2, item.param3, item.param4)
            params = tuple(math.nan if value is None else value for value in first)
            self.command_camera(item.command, (*params, item.x, item.y, item.z))

    def _show_changes(self) -> None:
        """Send at once what peers wait for (mode, arming, landing, progress) and what is to be said."""
        pilot = self.pilot
        if self._camera.shooting and (pilot.mode in (Mode.RTL, Mode.LAND) or not pilot.armed):
            self._outbox += self._camera.stop(self.now_us / 1e6)
        for notice in pilot.notices():
            self._say(notice.severity, notice.text)
        shown = (
            (pilot.mode, pilot.armed),
            pilot.landed,
            (pilot.mission.current_seq, pilot.mission_state, pilot.mission.size),
        )
        if shown == self._shown:
            return
        self._missions.current_sequence = pilot.mission.current_seq
        before = self._shown or shown
        self._shown = shown
        kinds = (
            m.MAVLINK_MSG_ID_HEARTBEAT,
            m.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
            m.MAVLINK_MSG_ID_MISSION_CURRENT,
        )
        self._missions.locked = pilot.armed and pilot.mode is Mode.MISSION
        steps_on = self._progress[1:] == shown[2][1:]
        self._progress = shown[2]
        for message_id, old, new in zip(kinds, before, shown, strict=True):
            if old == new:
                continue
            if message_id == m.MAVLINK_MSG_ID_MISSION_CURRENT and steps_on:
                self._current_due_s = self.now_us / 1e6 + self.firmware.persona.current_lag_s
            else:
                self._outbox.append(BUILDERS[message_id](self))

    def _say(self, severity: int, text: str) -> None:
        """Send a STATUSTEXT, in chunks where it is longer than one message holds."""
        data = text.encode("ascii", "replace")
        if len(data) <= _TEXT_BYTES:
            self._outbox.append(m.MAVLink_statustext_message(int(severity), data))
            return
        self._texts = self._texts % 65535 + 1
        # A last chunk that is not full (perhaps empty) tells the reader that the text is complete.
        for number in range(len(data) // _TEXT_BYTES + 1):
            piece = data[number * _TEXT_BYTES : (number + 1) * _TEXT_BYTES]
            self._outbox.append(m.MAVLink_statustext_message(int(severity), piece, self._texts, number))

    def say_warning(self, text: str) -> None:
        """Tell the operator why something was refused."""
        self.pilot.note(Severity.WARNING, text)

    def moved_home(self) -> None:
        """Tell where home is now."""
        latitude, longitude = self.pilot.frame.to_wgs84(*self.pilot.home_m)
        self.home_e7 = (round(latitude * 1e7), round(longitude * 1e7), self.home_e7[2])
        self._missions.home = GeoPoint(latitude, longitude, self.home.altitude_m)
        self._outbox += self.built(m.MAVLINK_MSG_ID_HOME_POSITION)

    def goodbye(self) -> list[Message]:
        """A last HEARTBEAT, of a vehicle that is powered off."""
        (heartbeat,) = self.built(m.MAVLINK_MSG_ID_HEARTBEAT)
        heartbeat.system_status = m.MAV_STATE_POWEROFF
        return [heartbeat]

    def built(self, message_id: int) -> tuple[Message, ...]:
        """Return the message with this id from the state now, nothing when there is none."""
        builder = BUILDERS.get(message_id)
        return () if builder is None else (builder(self),)

    def wire_seq(self, seq: int) -> int:
        """Number of one of our mission items on the wire (ArduPilot counts home as item 0)."""
        return seq + self.firmware.profile.home_at_zero

    def own_seq(self, seq: int) -> int:
        """Undo `wire_seq`; home itself is the first item."""
        return max(0, seq - 1) if self.firmware.profile.home_at_zero else seq

    def set_custom_mode(self, number: int) -> None:
        """Take the mode with this custom number; RefusedError when it is unknown or not possible now."""
        mode = self.firmware.persona.modes.mode_of(number)
        if mode is None:
            msg = f"Mode refused: unknown number {number}"
            raise RefusedError(msg, denied=True)
        self.pilot.set_mode(mode)

    def available_modes(self, index: int) -> tuple[Message, ...]:
        """Return AVAILABLE_MODES for one mode (from 1) or, with 0, for all."""
        modes = list(self.firmware.persona.modes.numbers.items())
        chosen = range(1, len(modes) + 1) if index == 0 else [index] if 1 <= index <= len(modes) else []
        return tuple(
            m.MAVLink_available_modes_message(
                len(modes), i, 0, modes[i - 1][1], 0, modes[i - 1][0].value.encode()
            )
            for i in chosen
        )

    def reboot(self) -> None:
        """Start again: time since boot, mode, message rates; the plans are kept."""
        self._boot_us = self.now_us
        self.boot_ms = 0
        self.pilot.modes.override(self.firmware.persona.modes.boot)
        self.schedule = self._default_schedule()

    def _default_schedule(self) -> Schedule:
        """Rates of the firmware, at most one message per motion step; the true state where it differs."""
        most_hz = 1.0 / self.pilot.spec.step_s
        rates_hz = {kind: min(rate, most_hz) for kind, rate in self.firmware.persona.rates_hz.items()}
        if self.errors is not None:
            rates_hz[self.firmware.persona.truth_message] = min(_TRUTH_HZ, most_hz)
        return Schedule(rates_hz)

    def position_error(self, boot_us: float) -> tuple[float, float]:
        """Return how far east and north of the truth it believed to be, at a time of its own clock."""
        if self.errors is None:
            return 0.0, 0.0
        error = self.errors.at((boot_us + self._boot_us) / 1e6)
        return error.east_m, error.north_m

    def command_camera(self, command: int, params: tuple[float, ...]) -> None:
        """Send a command to the camera, until it is acknowledged or was sent three times."""
        self._outbox.append(self._camera.command(command, params, self.now_us / 1e6))

    def _repeat_reached(self, now_s: float) -> None:
        if self._reached is None or self._reached[2] > now_s:
            return
        seq, left, due_s = self._reached
        self._outbox.append(m.MAVLink_mission_item_reached_message(seq))
        self._reached = (seq, left - 1, due_s + 1.0) if left > 1 else None

    def _on_command(self, message: Message) -> None:
        order = commands.order_of(message)
        source = order.source
        last = self._last_orders.get(source)
        if order.again and last is not None and last[0].is_same(order):
            self._acknowledge(order, last[1])
            return
        answer, reason = commands.execute(self, order)
        if reason:
            self.say_warning(reason)
        if len(self._last_orders) > 256:
            self._last_orders.clear()
        self._last_orders[source] = (order, answer.result)
        self._acknowledge(order, answer.result)
        self._outbox += answer.messages

    def _acknowledge(self, order: commands.Order, result: int) -> None:
        self._outbox.append(m.MAVLink_command_ack_message(order.command, result, 0, 0, *order.source))

    def _on_ack(self, message: Message) -> None:
        if message.get_srcSystem() != self.system_id or message.get_srcComponent() != CAMERA:
            return
        self._camera.acknowledged(message.command, message.result)

    def _on_heartbeat(self, message: Message) -> None:
        if message.get_srcSystem() == self.system_id and message.get_srcComponent() == CAMERA:
            self.has_camera = True

    def _on_parameter(self, message: Message) -> None:
        self._outbox += self._parameters.handle(message)
        if (banner := self.firmware.persona.identity.banner) and type(
            message
        ).id == m.MAVLINK_MSG_ID_PARAM_REQUEST_LIST:
            self.pilot.note(Severity.INFO, banner)

    def _on_mission(self, message: Message) -> None:
        self._take(self._missions.receive(message, self.now_us / 1e6))

    def _take(self, output: Output) -> None:
        """Send what the mission server answers and take the plans that it was given."""
        self._outbox += output.messages
        for event in output.events:
            self._on_transfer(event)

    def _on_transfer(self, event: Event) -> None:
        if isinstance(event, StatusText):
            self._say(event.severity, event.text)
            return
        if isinstance(event, PlanReplaced | PlanCleared):
            mission, fence, rally = (self._missions.plan(kind).opaque_id for kind in MissionType)
            self.plan_ids = (mission, fence, rally)
        if isinstance(event, PlanReplaced | PlanCleared) and event.mission_type is not MissionType.MISSION:
            items = event.items if isinstance(event, PlanReplaced) else ()
            sound = [item for item in items if not isinstance(item, UncheckedItem)]
            is_fence = event.mission_type is MissionType.FENCE
            (self.pilot.set_fence if is_fence else self.pilot.set_rally)(sound)
        if event.mission_type is not MissionType.MISSION:
            return
        if isinstance(event, PlanReplaced) and event.changed:
            bad = next((i for i, item in enumerate(event.items) if isinstance(item, UncheckedItem)), None)
            if bad is not None:
                self.pilot.load(())
                self.pilot.reject_mission(f"item {bad}: its place or its numbers make no sense")
                self.pilot.note(Severity.CRITICAL, f"Mission rejected: item {bad} makes no sense")
                return
            self._returning = -1
            flying = self.pilot.armed and self.pilot.mode is Mode.MISSION
            self.pilot.load(event.items)
            if flying and (text := self.firmware.persona.mission_changed_text):
                self.pilot.note(Severity.INFO, text)
            if event.start_sequence and not self.pilot.mission.why_not:
                with contextlib.suppress(RefusedError):
                    self.pilot.set_current(event.start_sequence)
        elif isinstance(event, PlanCleared):
            self.pilot.load(())
        elif isinstance(event, TransferStarted):
            self._uploading = event.upload
        elif isinstance(event, TransferFailed) and self._uploading and event.reason is FailureReason.REFUSED:
            self.pilot.reject_mission(event.text)

    def _check_item(self, item: MissionItem) -> int:
        """Judge one mission item for the transfer: MAV_MISSION_RESULT."""
        known = item.command in _KNOWN_ITEMS
        return int(wire.ACCEPTED if known else wire.UNSUPPORTED)

    def _on_set_current(self, message: Message) -> None:
        try:
            self.pilot.set_current(self.own_seq(message.seq))
        except RefusedError as refusal:
            self.say_warning(str(refusal))
            return
        self._outbox += self.built(m.MAVLINK_MSG_ID_MISSION_CURRENT)

    def _on_setpoint(self, message: Message) -> None:
        setpoints = self.pilot.setpoints
        if type(message).id == m.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET:
            setpoints.complain("Setpoint refused: attitudes are not flown")
        elif setpoints.listens_in(self.pilot.mode):
            try:
                self.pilot.take_setpoint(
                    setpoint_messages.setpoint_of(
                        message,
                        self.pilot.state,
                        self.pilot.frame,
                        body_positions=not self.pilot.failsafe.rules.needs_stream,
                    )
                )
            except RefusedError as refusal:
                setpoints.complain(str(refusal))

    def _on_set_mode(self, message: Message) -> None:
        try:
            self.set_custom_mode(message.custom_mode)
        except RefusedError as refusal:
            self.say_warning(str(refusal))

    def _on_ping(self, message: Message) -> None:
        if message.target_system == 0 and message.target_component == 0:
            source = (message.get_srcSystem(), message.get_srcComponent())
            self._outbox.append(m.MAVLink_ping_message(message.time_usec, message.seq, *source))

    def _on_timesync(self, message: Message) -> None:
        if message.tc1 == 0:
            self._outbox.append(m.MAVLink_timesync_message(self.unix_us * 1000, message.ts1))

    def _on_setup_signing(self, message: Message) -> None:
        if message.target_system != self.system_id:  # a key is never for everybody
            return
        if self.pilot.armed or self._signing is None:
            why = "armed" if self.pilot.armed else "not over this link"
            self.say_warning(f"Signing setup refused: {why}")
            return
        try:
            self._signing.setup(bytes(message.secret_key), message.initial_timestamp)
        except LinkError:
            self.say_warning("Signing setup refused: not over this link")

    def _totals(self) -> dict[str, Callable[[], float]]:
        """Return the parameters that count the plans, as ArduPilot names them."""
        return {
            "MIS_TOTAL": lambda: self._missions.count(MissionType.MISSION),
            "FENCE_TOTAL": lambda: self._missions.count(MissionType.FENCE),
            "RALLY_TOTAL": lambda: self._missions.count(MissionType.RALLY),
        }

    def _on_data_stream(self, message: Message) -> None:
        if not self.firmware.persona.data_streams:
            return
        rate = message.req_message_rate if message.start_stop else 0
        interval_us = round(1e6 / rate) if rate else -1
        for message_id in STREAMS.get(message.req_stream_id, ()):
            self.schedule.set_interval(message_id, interval_us, self.now_us)
