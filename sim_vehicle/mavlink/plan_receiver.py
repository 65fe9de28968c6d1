"""Vehicle side of the mission protocol, which passes received plans to the pilot."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

from mission.errors import MissionError
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.frames import FrameReader, FrameWriter
from mission.link.codec.typed import is_a
from mission.model import Command, MissionItem, MissionType
from mission.transfer import wire
from mission.transfer.events import (
    Event,
    FailureReason,
    Output,
    PlanCleared,
    PlanPart,
    PlanReplaced,
    StatusText,
    TransferFailed,
    TransferStarted,
)
from mission.transfer.server import MissionServer
from mission.transfer.storage import UncheckedItem
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.component import NEVER
from sim_vehicle.execution.items import DO_COMMANDS, NAV_COMMANDS
from sim_vehicle.pilot.controls import RefusedError, Severity
from sim_vehicle.pilot.mode_control import MissionChange

if TYPE_CHECKING:
    from sim_vehicle.mavlink.reports import ItemReports, StatusTexts
    from sim_vehicle.mavlink.wire_state import WireState

_FENCE_ITEMS = range(Command.NAV_FENCE_RETURN_POINT, Command.NAV_FENCE_CIRCLE_EXCLUSION + 1)
_KNOWN_ITEMS = NAV_COMMANDS | DO_COMMANDS | {*_FENCE_ITEMS, int(Command.NAV_RALLY_POINT)}


class PlanReceiver:
    """Receiver of missions, fences and rally points for the pilot; ``server`` implements the protocol."""

    def __init__(self, state: WireState, component_id: int, texts: StatusTexts, reports: ItemReports) -> None:
        self._state = state
        self._pilot = state.pilot
        self._texts = texts
        self._reports = reports
        self._uploading = False
        self._part_received_s = NEVER
        self.server = MissionServer(
            state.system_id,
            component_id,
            profile=state.firmware.profile,
            home=state.home,
            validator=lambda item: int(wire.ACCEPTED if item.command in _KNOWN_ITEMS else wire.UNSUPPORTED),
        )
        self._attach_cards()

    @property
    def mission(self) -> tuple[MissionItem, ...]:
        """Items of the mission as they were uploaded."""
        return tuple(self.server.plan(MissionType.MISSION).items)

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Handle a message of the mission protocol and return the answers."""
        self._load_part(now_s)
        return self._take(self.server.receive(message, now_s), now_s)

    def take_plan(
        self, mission_type: MissionType, items: Sequence[wire.ItemMessage], start: int | None
    ) -> bool:
        """Load a plan from a file by the rules of the mission protocol; return whether it was accepted.

        The items are numbered from 0. If `start` is given, the new items replace the items from `start` on.
        """
        now_s = self._state.now_us / 1e6
        if self.server.busy:
            return False
        own = (self.server.system_id, self.server.component_id)
        writer, reader = FrameWriter(*own), FrameReader()
        begin: Message = wire.count(own, len(items), mission_type)
        if start is not None:
            end = start + len(items) - 1
            begin = m.MAVLink_mission_write_partial_list_message(*own, start, end, int(mission_type))
        results = []
        for message in (begin, *items):
            for crossed in reader.feed(writer.encode(message)):
                answers = self.receive(crossed, now_s)
                results += [answer.type for answer in answers if is_a(answer, m.MAVLink_mission_ack_message)]
            if results:
                break
        accepted = results == [wire.ACCEPTED]
        if not accepted:
            self.restart(now_s)
        return accepted

    def fly_to(self, message: wire.ItemMessage) -> Message:
        """Fly to a waypoint that is not in the mission (DroneKit's `simple_goto`), and return the answer."""
        result, pilot = wire.ERROR, self._pilot
        with suppress(RefusedError, MissionError):
            item = wire.item_from_message(message)
            if item.command == Command.NAV_WAYPOINT and pilot.mode in (Mode.GUIDED, Mode.TAKEOFF):
                pilot.goto(item.x, item.y, self._state.above_start(item.z, item.frame), mode=Mode.GUIDED)
                result = wire.ACCEPTED
        source = (message.get_srcSystem(), message.get_srcComponent())
        return wire.ack(source, result, MissionType.MISSION)

    def poll(self, now_s: float) -> list[Message]:
        """Handle timeouts and return the messages that are due."""
        self._load_part(now_s)
        return self._take(self.server.poll(now_s), now_s) if self.due_s <= now_s else []

    def restart(self, now_s: float) -> None:
        """Abort the running transfer."""
        self._take(self.server.restart(now_s), now_s)

    def reboot(self, now_s: float) -> None:
        """Abort the running transfer, and read the sizes of the plan storage again, as at boot."""
        self.restart(now_s)
        self._attach_cards()

    def _attach_cards(self) -> None:
        for kind, card in self._state.firmware.profile.cards.items():
            self.server.set_card(kind, self._pilot.parameters.kept(card.parameter, 0.0))

    @property
    def due_s(self) -> float:
        """Time of the next timeout or retry (s); infinite if there is none."""
        deadline_s = self.server.next_deadline()
        return NEVER if deadline_s is None else deadline_s

    def totals(self) -> dict[str, Callable[[], float]]:
        """Return the parameters that count the plan items, by ArduPilot's names."""
        return {
            "MIS_TOTAL": lambda: self.server.count(MissionType.MISSION),
            "FENCE_TOTAL": lambda: self.server.count(MissionType.FENCE),
            "RALLY_TOTAL": lambda: self.server.count(MissionType.RALLY),
        }

    def _load_part(self, now_s: float) -> None:
        """If a mission takes effect item by item, load the items received so far, once per time step."""
        if now_s <= self._part_received_s or not self._flies:
            return
        self._part_received_s = NEVER
        self._announce_change(self._pilot.load(self.server.live_plan(MissionType.MISSION), whole=False))

    @property
    def _flies(self) -> bool:
        return self._pilot.armed and self._pilot.mode is Mode.MISSION

    def _announce_change(self, change: MissionChange) -> None:
        """Send the status text of a mission change in flight, if the autopilot has one."""
        pilot = self._pilot
        behaviour = pilot.behaviour
        if change is MissionChange.TURNED:
            seq = self._state.wire_seq(pilot.mission.current_seq)
            for text in behaviour.changed_texts:
                pilot.note(Severity.INFO, text.format(seq))
        elif change is MissionChange.LOST:
            pilot.note(Severity.CRITICAL, behaviour.restart_failed_text)

    def _take(self, output: Output, now_s: float) -> list[Message]:
        sent = list(output.messages)
        for event in output.events:
            if isinstance(event, StatusText):
                sent += self._texts.messages(event.severity, event.text)
            else:
                self._on_transfer(event, now_s)
        return sent

    def _on_transfer(self, event: Event, now_s: float) -> None:
        if isinstance(event, PlanReplaced | PlanCleared):
            mission, fence, rally = (self.server.plan(kind).opaque_id for kind in MissionType)
            self._state.plan_ids = (mission, fence, rally)
            if event.mission_type is not MissionType.MISSION:
                self._set_fence_or_rally(event)
        if event.mission_type is not MissionType.MISSION:
            return
        if isinstance(event, PlanPart):
            self._part_received_s = now_s
        elif isinstance(event, PlanReplaced):
            self._part_received_s = NEVER
            self._replace_mission(event, now_s)
        elif isinstance(event, PlanCleared):
            self._pilot.load(())
        elif isinstance(event, TransferStarted):
            self._uploading = event.upload
        elif isinstance(event, TransferFailed) and self._uploading and event.reason is FailureReason.REFUSED:
            self._pilot.reject_mission(event.text)

    def _set_fence_or_rally(self, event: PlanReplaced | PlanCleared) -> None:
        items = event.items if isinstance(event, PlanReplaced) else ()
        sound = [item for item in items if not isinstance(item, UncheckedItem)]
        is_fence = event.mission_type is MissionType.FENCE
        (self._pilot.set_fence if is_fence else self._pilot.set_rally)(sound)

    def _replace_mission(self, event: PlanReplaced, now_s: float) -> None:
        pilot, behaviour = self._pilot, self._pilot.behaviour
        marked = event.start_sequence if behaviour.obeys_mark else None
        flies = self._flies
        if not event.changed and not (flies and behaviour.restarts_leg):
            if flies and marked is not None and marked != pilot.mission.current_seq:
                pilot.set_current(marked)
            return
        if not event.complete and flies and tuple(event.items) == tuple(pilot.mission.items):
            return  # The vehicle took over these items as they arrived.
        bad = next((i for i, item in enumerate(event.items) if isinstance(item, UncheckedItem)), None)
        if bad is not None:
            pilot.load(())
            pilot.reject_mission(f"item {bad + 1}: its position or one of its parameters is invalid")
            pilot.note(Severity.CRITICAL, f"Mission rejected: item {bad + 1} is invalid")
            return
        self._reports.restart()
        self._announce_change(pilot.load(event.items, marked=marked))
        if flies:
            self._state.forget_item(now_s + behaviour.unknown_current_s)
