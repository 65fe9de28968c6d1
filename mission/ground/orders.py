"""Orders to a vehicle in flight: hold, return, land, resume the mission, continue at an item."""

from __future__ import annotations

import math

from geo.errors import WbfMissionError
from mission.ground.changes import MissionChanges
from mission.ground.contact import Answer, Contact, Order, StateBefore, result_name
from mission.ground.items import next_flown_to
from mission.ground.modes import Maneuver, ModeError
from mission.ground.pilot_watch import PilotWatch
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m

_NAV_LAST = 95
"""Largest MAV_CMD of navigation commands."""


class NotFlyingError(WbfMissionError, RuntimeError):
    """An order or change is impossible now: the vehicle flies no mission, or a change is in progress."""


class FlightOrders:
    """Orders to a vehicle in flight; a new order replaces the pending order.

    An order is repeated until the vehicle answers or obeys, unless a pilot or a failsafe has acted since.
    """

    def __init__(self, contact: Contact, changes: MissionChanges, pilot: PilotWatch) -> None:
        self._contact, self._monitor = contact, contact.monitor
        self._changes, self._pilot = changes, pilot
        self._order: Order | None = None
        self._ordered_before: tuple[Maneuver | None, str] = (None, "")  # `ordered` and `obeyed` of the pilot.
        self._before = StateBefore.of(self._monitor, -math.inf)  # State when the pending order was given.
        self._modes: frozenset[str] = frozenset()  # Modes that the pending order leads to.
        self._chosen = range(0)  # Current items that show that the pending set-item was obeyed.

    @property
    def end_modes(self) -> frozenset[str]:
        """Flight modes in which the vehicle may be after the end of the mission."""
        items = self._changes.held.items
        return self._monitor.modes.ends(int(items[-1].command) if items else 0)

    def _check_pilot(self) -> None:
        """Raise NotFlyingError while another pilot flies the vehicle, or may fly it."""
        mode = self._pilot.mode
        if self._pilot.somebody_else_flies:
            raise NotFlyingError(f"somebody else flies the vehicle (mode {mode}); the order was not sent")
        if self._pilot.in_doubt:
            raise NotFlyingError(
                f"the vehicle left its mission (mode {mode}); the order was not sent; wait 5 s,"
                " until it is known whether the mission ended or somebody else flies"
            )

    def check_mission(self) -> None:
        """Raise NotFlyingError during a change of the mission, and if the vehicle's mission is unknown."""
        if self._changes.running:
            raise NotFlyingError("the mission is being changed; wait until that is over")
        self._check_mission_known()

    def _check_mission_known(self) -> None:
        why = "another station has sent another mission" if self._pilot.replaced else ""
        if self._changes.broken_off:
            why = "the vehicle was taken out of its mission during a change"
        if why:
            raise NotFlyingError(f"{why}, so its mission is unknown; order the vehicle to return or to land")

    def maneuver(self, kind: Maneuver, now_s: float) -> list[Message]:
        """Order a maneuver; raises like `GroundStation.maneuver`."""
        self._check_pilot()
        if kind is Maneuver.RESUME:
            if not self._pilot.taken_out:
                raise NotFlyingError("the vehicle flies its mission")
            self._check_mission_known()
        try:
            command, params = self._monitor.modes.maneuver(kind)
        except ModeError as error:
            raise NotFlyingError(
                f"the vehicle has no flight mode to {kind.value}; the order was not sent; order the vehicle"
                " to return or to land"
            ) from error
        self._changes.drop()
        out = self._give(self._contact.order(command, *params), now_s)
        self._modes = self._monitor.modes.shows(kind)
        self._pilot.order(kind)
        return out

    def choose_item(self, item: int, now_s: float) -> list[Message]:
        """Order the vehicle to continue at an item; raises like `GroundStation.choose_item`."""
        self._check_pilot()
        items = self._changes.held.items
        if not 0 <= item < len(items):
            raise NotFlyingError(f"item {item + 1} does not exist; there are {len(items)} items")
        self.check_mission()
        profile, vehicle = self._contact.profile, self._contact.vehicle
        seq = item + (1 if profile.home_at_zero else 0)
        by_message = None if profile.item_command else m.MAVLink_mission_set_current_message(*vehicle, seq)
        order = self._contact.order(m.MAV_CMD_DO_SET_MISSION_CURRENT, float(seq), message=by_message)
        out = self._give(order, now_s)
        # The vehicle runs a DO command at once, and reports the next navigation item as current.
        passes = items[item].command > _NAV_LAST
        self._chosen = range(item, (next_flown_to(items, item) if passes else item) + 1)
        return out

    def _give(self, order: Order, now_s: float) -> list[Message]:
        """Send an order, which replaces an order that is still pending."""
        self._ordered_before = self._pilot.ordered, self._pilot.obeyed
        self._order, self._chosen = order, range(0)
        self._before, self._modes = StateBefore.of(self._monitor, now_s), frozenset()
        return order.send(now_s)

    def on_ack(self, message: m.MAVLink_command_ack_message, now_s: float) -> None:
        """Handle a COMMAND_ACK, which may answer the pending order."""
        answer = Answer.NONE if self._order is None else self._order.answer(message, now_s)
        if answer is Answer.REFUSED:
            self._refused(result_name(message.result), now_s)
        elif answer is Answer.ACCEPTED:
            self._order, self._chosen = None, range(0)

    def on_mission_current(self) -> None:
        """Handle MISSION_CURRENT after the monitor, which may show that a chosen item was accepted."""
        item = self._monitor.item
        if self._chosen and item is not None:
            first, before = self._chosen.start, self._before.item
            passed = first < item and (before is None or not first <= before <= item)
            if item in self._chosen or passed:
                self._chosen, self._order = range(0), None

    def end_repeats(self, now_s: float) -> None:
        """Repeat the pending order no more: the program was suspended, so the order is old."""
        if self._order is not None:
            self._order.end_repeats(now_s)

    def next_deadline(self) -> float:
        """Return the time at which the pending order is repeated or given up; infinity if there is none."""
        return math.inf if self._order is None else self._order.due_s

    def poll(self, now_s: float) -> list[Message]:
        """Return the pending order if it is to be repeated now."""
        if self._order is None or now_s < self._order.due_s:
            return []
        monitor = self._monitor
        if self._order.is_given_up:
            self._pilot.on_no_answer(self._pilot.ordered, now_s)
            self._refused("no answer", now_s)
        elif monitor.mode != self._before.mode and monitor.mode in self._modes:
            self._order = None  # obeyed, only the COMMAND_ACK was lost
        elif self._is_overruled():
            self._refused(f"mode {monitor.mode} since" if monitor.is_armed else "disarmed since", now_s)
        else:
            # A repeated set-item could turn back a vehicle that has taken the order and flown on.
            heard = monitor.item_heard_s > self._before.given_s
            repeats = not self._chosen or (heard and monitor.item == self._before.item)
            return self._order.send(now_s)[: int(repeats)]
        return []

    def _is_overruled(self) -> bool:
        """Whether a pilot or a failsafe has acted since the pending order was given."""
        modes, (ordered, _) = self._monitor.modes, self._ordered_before
        mission = modes.shows(Maneuver.RESUME)
        expected = frozenset() if ordered is None else modes.shows(ordered)
        if self._before.mode in mission:
            expected |= mission | self.end_modes
        return bool(mission) and self._before.is_overruled(self._monitor, expected)

    def _refused(self, why: str, now_s: float) -> None:
        """Restore the state from before the order, and report the refusal to the operator."""
        self._order, self._chosen = None, range(0)
        if self._pilot.ordered is not self._ordered_before[0]:
            self._pilot.order(*self._ordered_before)
        self._contact.texts.note(f"{why}: the vehicle did not take the order", now_s)
