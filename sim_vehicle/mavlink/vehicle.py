"""Simulated vehicle as a MAVLink component: messages received, answers, telemetry."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeAlias, get_args

from geo.frame import LocalFrame
from mission.errors import LinkError
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.signing import Signing
from mission.link.codec.typed import CommandMessage, handler, is_a
from mission.model import GeoPoint, MissionItem, MissionType
from mission.outcome import Outcome
from mission.transfer import wire
from sim_vehicle.airframe.navigation_errors import NavigationErrors, SensorNoise
from sim_vehicle.airframe.spec import VehicleSpec
from sim_vehicle.autopilot import Autopilot, Firmware, adapt_vehicle, get_autopilot
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.component import UNHEARD
from sim_vehicle.errors import VehicleError
from sim_vehicle.execution.items import CAMERA_COMMANDS, NAV_COMMANDS
from sim_vehicle.execution.state import EPOCH_UNIX_S, CameraCommand, FlightEvent, HomeMoved, ItemReached
from sim_vehicle.mavlink.commands import CommandReceiver, set_custom_mode
from sim_vehicle.mavlink.extras import Timed, extras_of
from sim_vehicle.mavlink.parameters import ParameterMessage, ParameterSet
from sim_vehicle.mavlink.plan_receiver import PlanReceiver
from sim_vehicle.mavlink.reports import (
    STREAMS,
    ItemReports,
    Schedule,
    StatusTexts,
    group_number,
)
from sim_vehicle.mavlink.telemetry import BUILDERS
from sim_vehicle.mavlink.vehicle_command import CAMERA, CameraCommands, camera_feedback, command_of
from sim_vehicle.mavlink.wire_state import WireState
from sim_vehicle.pilot.controls import RefusedError, Severity
from sim_vehicle.pilot.pilot import Pilot
from sim_vehicle.weather.wind import Wind

_AUTOPILOT = int(m.MAV_COMP_ID_AUTOPILOT1)
_PLANNER = int(m.MAV_COMP_ID_MISSIONPLANNER)
# Longest interval between two updates of an armed vehicle.
_TICK_S = 0.1
_ITEM_AFTER_MODE_S = 0.03
# Value of ``current`` in a MISSION_ITEM to which the vehicle flies at once in GUIDED.
_GUIDED_ITEM = 2
_TRUTH_HZ = 10.0
_MISSION_IDS = frozenset(wire.SERVER_MESSAGES)
_SETPOINTS = ("SET_POSITION_TARGET_LOCAL_NED", "SET_POSITION_TARGET_GLOBAL_INT", "SET_ATTITUDE_TARGET")
_Handler: TypeAlias = Callable[[Any], Iterable[Message] | None]


def _each(kinds: Any, handle: _Handler) -> dict[int, _Handler]:
    """Return the same handler for each message type of a union, by message id."""
    return {kind.id: handle for kind in get_args(kinds)}


class SimVehicle:
    """Simulated vehicle that speaks MAVLink.

    Parameters
    ----------
    spec : VehicleSpec
        Limits, battery and power of the vehicle.
    home : GeoPoint
        Start position, at ground altitude.
    autopilot : Autopilot, optional
        Autopilot to simulate; by default the result of `get_autopilot`.
    yaw_deg : float
        Compass heading at the start.
    epoch_unix_s : float
        Unix time at the host's time 0.
    signing : Signing, optional
        Signing state of the host; SETUP_SIGNING changes its key if the host allows that.
    noise : SensorNoise, optional
        Sensor errors; by default the sensors are exact.
    sd_card : bool
        Whether plan storage on an SD card starts at its largest size, if a parameter sets that size
        (BRD_SD_MISSION and BRD_SD_FENCE of ArduPilot).
    cold : bool
        Whether the vehicle boots at the first message, with the autopilot's boot stages; by default the
        vehicle is already up.
    sitl_rates : bool
        Whether telemetry has the rates of the autopilot's own simulator; the default rates are lower.

    Attributes
    ----------
    pilot : Pilot
        Vehicle without MAVLink: state, mode, outcome.
    link : str
        Name of the link of the message that is being received.
    state : WireState
        Source of the telemetry: clocks, position, plan ids.
    firmware : Firmware
        Firmware of the autopilot for this kind of vehicle.
    errors : NavigationErrors or None
        Navigation sensor errors; None if the sensors are exact.

    Raises
    ------
    VehicleError
        If the boot stages of this autopilot are unknown for this kind of vehicle.

    Examples
    --------
    >>> from sim_vehicle.airframe.catalog import get_vehicle
    >>> vehicle = SimVehicle(get_vehicle("quad"), GeoPoint(28.05, -82.15, 10.0))
    >>> vehicle.poll(0.0)[0].get_type()
    'HEARTBEAT'
    >>> vehicle.outcome.value
    'running'
    """

    def __init__(
        self,
        spec: VehicleSpec,
        home: GeoPoint,
        *,
        wind: Wind | None = None,
        autopilot: Autopilot | None = None,
        system_id: int = 1,
        yaw_deg: float = 0.0,
        epoch_unix_s: float = EPOCH_UNIX_S,
        signing: Signing | None = None,
        noise: SensorNoise | None = None,
        sd_card: bool = False,
        cold: bool = False,
        sitl_rates: bool = False,
    ) -> None:
        self.autopilot = get_autopilot() if autopilot is None else autopilot
        spec = adapt_vehicle(spec, self.autopilot)
        firmware = self.autopilot.for_vehicle(spec.kind)
        self._boots = firmware.cold_boot if cold else None
        if cold and self._boots is None:
            msg = f"the boot of {self.autopilot.title} on a {spec.kind} is unknown: leave the cold boot out"
            raise VehicleError(msg)
        self.system_id = system_id
        self.component_id = _AUTOPILOT
        self.firmware: Firmware = firmware
        self.home = home
        self.pilot = pilot = Pilot(
            spec,
            LocalFrame(home.latitude_deg, home.longitude_deg, home.altitude_m),
            firmware,
            wind=wind,
            yaw_rad=math.radians(yaw_deg % 360.0),
            epoch_unix_s=epoch_unix_s,
            estimate_errors=None if noise is None else noise.of_estimate,
        )
        self.state = state = WireState(
            pilot, home, system_id=system_id, epoch_unix_s=epoch_unix_s, noise=noise
        )
        self.errors: NavigationErrors | None = state.errors
        self.link = ""
        self._sitl_rates = sitl_rates
        self._heard_ids: frozenset[int] | None = None
        self._heard_components: set[int] = set()
        self.has_camera = False
        self._contacted = False
        # Intervals (us) set by a data stream for messages that extras cannot send yet, by message id.
        self._later_us: dict[int, int] = {}
        self._signing = signing
        self._tick_s = 0.0
        self._outbox: list[Message] = []
        self._progress: tuple[object, ...] = ()
        self._shown: tuple[object, ...] = ()
        for card in firmware.profile.cards.values() if sd_card else ():
            if card.parameter not in pilot.parameters.settings:
                pilot.parameters.stored[card.parameter] = card.largest_kib
        self._texts = StatusTexts()
        self._reports = ItemReports(state)
        self._plans = PlanReceiver(state, _AUTOPILOT, self._texts, self._reports)
        self._camera = CameraCommands(state)
        self._commands = CommandReceiver(self)
        self._parameters = ParameterSet(pilot, firmware.parameters(spec, system_id), self._plans.totals())
        self._schedules = {"": self._default_schedule("")}
        self.extras = extras_of(state, self._parameters, self._plans)
        pilot.extras += self.extras
        self.builders = dict(BUILDERS)
        for extra in self.extras:
            state.capabilities |= extra.capabilities
            self.builders |= extra.builders
        # Parts that send messages at the time `due_s`, in the order in which they send.
        self._timed: tuple[Timed, ...] = (
            self._camera,
            self._reports,
            self._plans,
            self._parameters,
            *(part for extra in self.extras for part in extra.timed),
        )
        self._handlers = self._message_handlers()
        self.wanted: frozenset[int] | None = frozenset(self._handlers)
        for name in _SETPOINTS:
            if getattr(m, f"MAVLINK_MSG_ID_{name}") not in self._handlers:  # No extra flies these setpoints.
                state.capabilities &= ~getattr(m, f"MAV_PROTOCOL_CAPABILITY_{name}")

    def _message_handlers(self) -> dict[int, _Handler]:
        """Return handlers by message id; messages that a handler puts in the outbox precede its answers."""
        handlers: dict[int, _Handler] = {
            **_each(CommandMessage, self._commands.receive),
            **_each(ParameterMessage, self._on_parameter),
            **dict.fromkeys(_MISSION_IDS, self._on_mission),
        }
        handlers |= (
            handler(m.MAVLink_command_ack_message, self._on_ack),
            handler(m.MAVLink_heartbeat_message, self._on_heartbeat),
            handler(m.MAVLink_mission_set_current_message, self._on_set_current),
            handler(m.MAVLink_ping_message, self._on_ping),
            handler(m.MAVLink_request_data_stream_message, self._on_data_stream),
            # The vehicle has an origin and keeps it; the answer is this origin.
            handler(
                m.MAVLink_set_gps_global_origin_message,
                lambda _: self.built(m.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN),
            ),
            handler(m.MAVLink_set_mode_message, self._on_set_mode),
            handler(m.MAVLink_setup_signing_message, self._on_setup_signing),
            handler(m.MAVLink_timesync_message, self._on_timesync),
        )
        if self.pilot.behaviour.tells_shots:
            handlers[m.MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED] = self._on_image
        for extra in self.extras:
            for kind, handle in extra.handlers.items():
                handlers[kind] = self._then(handlers.get(kind), handle)
        return handlers

    def _then(
        self, own: _Handler | None, handle: Callable[[Any, float], Iterable[Message] | None]
    ) -> _Handler:
        """Return a handler that calls `own` and then the handler of an extra."""

        def both(message: Any) -> list[Message]:
            return [*((own and own(message)) or ()), *(handle(message, self._now_s) or ())]

        return both

    @property
    def true_position_m(self) -> tuple[float, float, float]:
        """True position relative to the start: east, north, up (m)."""
        return self.state.sensed.true_m

    def position_error(self, boot_us: float) -> tuple[float, float]:
        """Return the error of the estimated position (east, north) at a time since boot."""
        return self.state.position_error(boot_us)

    def camera_attitude(self, boot_us: float) -> tuple[float, float, float] | None:
        """Return roll, pitch and heading (rad) of the camera at a time since boot; None if straight down."""
        attitudes = (extra.camera_attitude(boot_us) for extra in self.extras)
        return next((attitude for attitude in attitudes if attitude is not None), None)

    @property
    def plans(self) -> tuple[tuple[MissionItem, ...], ...]:
        """Uploaded items of the mission, the fence and the rally points, in the order of `MissionType`."""
        return tuple(tuple(self._plans.server.plan(kind).items) for kind in MissionType)

    @property
    def outcome(self) -> Outcome:
        """Outcome of the run; RUNNING until the run ends."""
        return self.pilot.outcome

    @property
    def outcome_text(self) -> str:
        """Reason for the outcome."""
        return self.pilot.outcome_text

    @property
    def finished(self) -> bool:
        """Whether the run has ended and the vehicle is disarmed."""
        return self.pilot.outcome.is_over and not self.pilot.armed

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Handle a message and return the answers; messages to other components are ignored."""
        handle = self._handlers.get(type(message).id)
        if handle is None or not self._is_mine(message):
            return []
        if not self._contacted:
            self._contacted = True
            if self._boots is not None:
                self.state.set_time(round(now_s * 1e6))
                self._restart()
        if not is_a(message, m.MAVLink_heartbeat_message):
            self._advance(now_s)
            self._outbox += handle(message) or ()
            self._show_changes()
            return self._sent()
        if message.type == m.MAV_TYPE_GCS:
            self.pilot.failsafe.on_gcs_heartbeat(now_s)
        handle(message)
        return []

    def poll(self, now_s: float) -> list[Message]:
        """Advance the vehicle to `now_s` and return the messages that are due."""
        self._advance(now_s)
        for part in self._timed:
            self._outbox += part.poll(now_s)
        self._show_changes()
        if len(self._schedules) == 1:
            self._outbox += self._due(self._schedules[""])
        return self._sent()

    def _due(self, schedule: Schedule) -> list[Message]:
        """Return the telemetry that is due."""
        messages: list[Message] = []
        heard, boot = self._heard_ids, self.state.boot
        for message_id in schedule.due(self.state.now_us):
            if boot is not None and message_id in boot.untold:
                continue
            is_heard = heard is None or message_id in heard
            messages += self.built(message_id) if is_heard else (UNHEARD,)
        return messages

    @property
    def schedule(self) -> Schedule:
        """Message intervals on the link over which the present message came."""
        return self._schedules.get(self.link, self._schedules[""])

    def open_links(self, names: frozenset[str]) -> None:
        """Send telemetry on further links, with message rates for each link."""
        for name in sorted(names - self._schedules.keys()):
            self._schedules[name] = self._default_schedule(name)

    def streamed(self) -> list[tuple[str, list[Message]]]:
        """Return, for each link, the telemetry that was due at the last `poll`."""
        if len(self._schedules) == 1:
            return []
        due = ((link, self._due(schedule)) for link, schedule in self._schedules.items())
        return [(link, messages) for link, messages in due if messages]

    def only_heard(self, message_ids: frozenset[int] | None) -> None:
        """Build only scheduled messages with these ids; None stands for all ids."""
        self._heard_ids = message_ids

    def next_deadline(self) -> float:
        """Return the time at which the next telemetry message, retry or motion step is due (s)."""
        next_us = min([schedule.next_us for schedule in self._schedules.values()])
        deadline_s = min(next_us / 1e6, *[part.due_s for part in self._timed])
        return min(deadline_s, self._tick_s + _TICK_S) if self.pilot.armed else deadline_s

    def _sent(self) -> list[Message]:
        outbox, self._outbox = self._outbox, []
        return outbox

    def _is_mine(self, message: Message) -> bool:
        system = getattr(message, "target_system", 0)
        if system not in (0, self.system_id):
            return False
        component = getattr(message, "target_component", 0)
        plans = component == _PLANNER and type(message).id in _MISSION_IDS
        if plans or component in (0, self.component_id):
            return True
        # Rule 1e of ArduPilot's ``MAVLink_routing.cpp``
        return self.firmware.profile.answers_unheard and component not in self._heard_components

    def _advance(self, now_s: float) -> None:
        """Advance the vehicle to `now_s` and send its events."""
        now_us = round(now_s * 1e6)
        if now_us <= self.state.now_us and self._shown:
            return
        self.state.set_time(now_us)
        self._tick_s = now_s
        if (boots := self._boots) is not None:
            before = self.state.boot
            stage = self.state.boot = boots.at(self.state.boot_ms / 1e3 if self._contacted else 0.0)
            self.pilot.arming.block = boots.problem(stage, self.pilot.mode)
            if before is not None and stage is not before:
                self.pilot.note(Severity.INFO, stage.text)
                for message_id in before.untold - stage.untold:
                    self._send(message_id)
        events = self.pilot.advance(now_s)
        self.state.sense(now_s)
        for extra in self.extras:
            extra.advance()
        for event in self._reports.merged(events, self._plans.mission):
            self._on_event(event, now_s)

    def _on_event(self, event: FlightEvent, now_s: float) -> None:
        if isinstance(event, ItemReached):
            self._outbox.append(self._reports.reached(event.seq, now_s))
            items = self.pilot.mission.items
            if event.seq < len(items) and items[event.seq].command in NAV_COMMANDS:
                self._outbox += self._camera.resume(now_s)
        elif isinstance(event, HomeMoved):
            self.on_home_moved()
        elif isinstance(event, CameraCommand):
            command = command_of(event.item, (self.system_id, _AUTOPILOT))
            if command.id in CAMERA_COMMANDS:
                self.command_camera(command.id, command.params)
            for extra in self.extras:
                extra.execute(command)

    def _show_changes(self) -> None:
        """Send notices, and at once report changes of mode, arming, landing and progress."""
        pilot = self.pilot
        self._outbox += self._camera.watch(self._now_s)
        for extra in self.extras:
            extra.watch()
        for message_id in [later for later in self._later_us if self.is_ready(later)]:
            interval_us = self._later_us.pop(message_id)
            self.schedule.set_interval(message_id, interval_us, self.state.now_us)
        for severity, text in pilot.notices():
            self._outbox += self._texts.messages(severity, text)
        shown = (
            (self.state.custom_mode, pilot.armed),
            pilot.landed,
            (pilot.mission.current_seq, pilot.mission.state, pilot.mission.size),
        )
        if shown == self._shown:
            return
        before, self._shown = self._shown or shown, shown
        server, guarded = self._plans.server, not pilot.behaviour.clears_in_flight
        server.current_sequence = pilot.mission.current_seq
        server.locked = guarded and pilot.armed and pilot.mode is Mode.MISSION
        steps_on = self._progress[1:] == shown[2][1:]
        self._progress = shown[2]
        lag_s = self.state.mavlink.current_lag_s
        if pilot.mission.returns and pilot.mode is Mode.MISSION:
            # The autopilot reports the return mode before it reports the item that leads to the return.
            steps_on, lag_s = True, (pilot.behaviour.return_lag_s or 0.0) + _ITEM_AFTER_MODE_S
        changed = [old != new for old, new in zip(before, shown, strict=True)]
        if changed[0]:
            self._send(m.MAVLINK_MSG_ID_HEARTBEAT)
        if changed[1]:
            self._send(m.MAVLINK_MSG_ID_EXTENDED_SYS_STATE)
        if changed[2] and steps_on:
            self._reports.send_current(self._now_s + lag_s)
        elif changed[2]:
            self._send(m.MAVLINK_MSG_ID_MISSION_CURRENT)

    def on_home_moved(self) -> None:
        """Send the position of home."""
        self._plans.server.home = self.state.move_home()
        self._send(m.MAVLINK_MSG_ID_HOME_POSITION)

    def log_frame(self, frame: bytes, message_id: int, now_s: float) -> None:
        """Log a frame that was sent or received."""
        for extra in self.extras:
            extra.log_frame(frame, message_id, now_s)

    def goodbye(self) -> list[Message]:
        """Return the last HEARTBEAT of a vehicle that is switched off."""
        (heartbeat,) = self.built(m.MAVLINK_MSG_ID_HEARTBEAT)
        assert is_a(heartbeat, m.MAVLink_heartbeat_message)
        heartbeat.system_status = m.MAV_STATE_POWEROFF
        return [heartbeat]

    def built(self, message_id: int) -> tuple[Message, ...]:
        """Return the message with this id for the present state; empty if there is none to send."""
        builder = self.builders.get(message_id)
        message = None if builder is None else builder(self.state)
        return () if message is None else (message,)

    def metadata(self) -> tuple[Message, ...]:
        """Return COMPONENT_METADATA messages; empty if no extra has metadata."""
        return tuple(message for extra in self.extras for message in extra.metadata())

    def _send(self, message_id: int) -> None:
        """Send a message for the present state."""
        self._outbox += self.built(message_id)

    @property
    def _now_s(self) -> float:
        return self.state.now_us / 1e6

    def _restart(self) -> None:
        self.state.reboot()
        for extra in self.extras:
            extra.reboot()

    def reboot(self) -> None:
        """Reboot: reset the time since boot, plan ids, message rates and transfers, but keep the plans.

        On the ground, the vehicle comes up in its boot mode. In flight, the vehicle keeps its mode; this
        simplified watchdog reboot suffices for tests of ground stations.
        """
        self._restart()
        self._plans.reboot(self._now_s)
        if not self.pilot.armed:
            self.pilot.modes.override(self.state.mavlink.modes.boot)
        self._schedules = {link: self._default_schedule(link) for link in self._schedules}

    @property
    def link_names(self) -> frozenset[str]:
        """Names of the links that have their own message rates."""
        return frozenset(self._link_rates_hz) - {""}

    @property
    def _link_rates_hz(self) -> Mapping[str, Mapping[int, float]]:
        mavlink = self.state.mavlink
        return mavlink.sitl_rates_hz if self._sitl_rates else mavlink.link_rates_hz

    def _default_schedule(self, link: str) -> Schedule:
        """Return the firmware's rates on a link, limited to one message per motion step (two at SITL rates).

        A vehicle with sensor errors also sends its true state.
        """
        mavlink = self.state.mavlink
        rates_hz = dict(self._link_rates_hz.get(link) or self._link_rates_hz.get("", mavlink.rates_hz))
        if self._sitl_rates:
            for group, parameter in mavlink.stream_parameters.items():
                rate = self._parameters.value(parameter)
                rates_hz |= dict.fromkeys(STREAMS[group_number(group)], rate) if rate > 0.0 else {}
        if self.errors is not None and not link:
            rates_hz[mavlink.truth_message] = _TRUTH_HZ
        # A second message between two motion steps would repeat the same state.
        most_hz = (2.0 if self._sitl_rates else 1.0) / self.pilot.spec.step_s
        return Schedule({kind: min(rate, most_hz) for kind, rate in rates_hz.items()})

    def command_camera(self, command: int, params: tuple[float, ...]) -> None:
        """Send a command to the camera, at most three times until the camera acknowledges it."""
        self._outbox.append(self._camera.command(command, params, self._now_s))

    def _is_own_camera(self, message: Message) -> bool:
        return (message.get_srcSystem(), message.get_srcComponent()) == (self.system_id, CAMERA)

    def _on_ack(self, message: m.MAVLink_command_ack_message) -> None:
        if self._is_own_camera(message):
            self._camera.acknowledged(message.command, message.result)

    def _on_heartbeat(self, message: m.MAVLink_heartbeat_message) -> None:
        self.has_camera |= self._is_own_camera(message)
        if message.get_srcSystem() == self.system_id:
            self._heard_components.add(message.get_srcComponent())

    def _on_image(self, message: m.MAVLink_camera_image_captured_message) -> list[Message]:
        """Report an image that this vehicle has commanded, like the camera driver of an autopilot."""
        own = self._is_own_camera(message) and self._camera.shooting and message.capture_result == 1
        return [camera_feedback(message, self.pilot.state)] if own else []

    def _on_parameter(self, message: ParameterMessage) -> list[Message]:
        answers = self._parameters.handle(message, self._now_s)
        if is_a(message, m.MAVLink_param_request_list_message):
            self.pilot.note(Severity.INFO, self.state.mavlink.identity.banner)
        return answers

    def _on_mission(self, message: Message) -> list[Message]:
        guided = self.state.mavlink.guided_items
        if guided and wire.is_item(message) and message.current == _GUIDED_ITEM:
            return [self._plans.fly_to(message)]
        return self._plans.receive(message, self._now_s)

    def _on_set_current(self, message: m.MAVLink_mission_set_current_message) -> tuple[Message, ...]:
        refusals = self.state.mavlink.refusals
        if self._plans.server.busy and refusals.current_item_busy:
            self.pilot.warn(refusals.current_item_busy)
            return ()
        try:
            self.pilot.set_current(self.state.own_seq(message.seq))
        except RefusedError:
            self.pilot.warn(refusals.current_item)
            return ()
        return self.built(m.MAVLINK_MSG_ID_MISSION_CURRENT)

    def _on_set_mode(self, message: m.MAVLink_set_mode_message) -> None:
        try:
            set_custom_mode(self, message.custom_mode)
        except RefusedError as refusal:
            self.pilot.warn(refusal.text)

    def _on_ping(self, message: m.MAVLink_ping_message) -> list[Message]:
        if message.target_system != 0 or message.target_component != 0:
            return []
        source = (message.get_srcSystem(), message.get_srcComponent())
        return [m.MAVLink_ping_message(message.time_usec, message.seq, *source)]

    def _on_timesync(self, message: m.MAVLink_timesync_message) -> list[Message]:
        answers = message.tc1 == 0
        return [m.MAVLink_timesync_message(self.state.unix_us * 1000, message.ts1)] if answers else []

    def _on_setup_signing(self, message: m.MAVLink_setup_signing_message) -> None:
        if message.target_system != self.system_id:  # A broadcast must not change keys.
            return
        if self.pilot.armed or self._signing is None:
            why = "armed" if self.pilot.armed else "not over this link"
            self.pilot.warn(f"Signing setup refused: {why}")
            return
        try:
            self._signing.setup(bytes(message.secret_key), message.initial_timestamp)
        except LinkError:
            self.pilot.warn("Signing setup refused: not over this link")

    def _on_data_stream(self, message: m.MAVLink_request_data_stream_message) -> None:
        if not self.state.firmware.profile.streams_on_request:
            return
        rate = message.req_message_rate if message.start_stop else 0
        interval_us = round(1e6 / rate) if rate else -1
        for message_id in STREAMS.get(message.req_stream_id, ()):
            if self.is_ready(message_id):
                self.schedule.set_interval(message_id, interval_us, self.state.now_us)
            else:
                self._later_us[message_id] = interval_us

    def is_ready(self, message_id: int) -> bool:
        """Return whether the vehicle and its extras can send this message, even if it is not due now."""
        return message_id in self.builders and all(extra.is_ready(message_id) for extra in self.extras)
