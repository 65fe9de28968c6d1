"""From mission items to legs: what the vehicle flies without asking again, and what follows."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from mission.model import Command, Frame, MissionItem
from sim_vehicle.autopilot import flight_procedures
from sim_vehicle.execution.fixed_wing_items import (
    fixed_wing_leg,
    lands,
    next_move,
    next_position,
)
from sim_vehicle.execution.legs import AfterLastLeg, LegPlan, circle_legs, spline_legs
from sim_vehicle.motion.legs import ALONG, KEEP, Heading, Leg, LegKind

if TYPE_CHECKING:
    from collections.abc import Sequence

    from geo.frame import LocalFrame
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.legs import Position

# Items that are executed between two positions.
DO_COMMANDS = frozenset(
    {112, 114, 115, 177, 178, 179, 189, 195, 197, 201, 203, 205, 206, 214, 530}
    | {1000, 1001, 2000, 2001, 2003, 2500, 2501}
)
CAMERA_COMMANDS = frozenset({203, 206, 214, 530, 2000, 2001, 2003})
GIMBAL_COMMANDS = frozenset({195, 197, 201, 205, 1000, 1001})
CONDITIONS = frozenset({int(Command.CONDITION_DELAY), int(Command.CONDITION_DISTANCE)})
POSITION_COMMANDS = frozenset({16, 17, 18, 19, 31, 82})
# Flown through to the next position without a pause.
PASSED_COMMANDS = frozenset({16, 82})
# What the vehicle does with them is known only when they are executed.
SURPRISING_COMMANDS = frozenset({115, 179, 195, 197, 201})
NAV_COMMANDS = POSITION_COMMANDS | {20, 21, 22, 93}
HERE_COMMANDS = frozenset({17, 18, 19, 21, 22, 31})
MAX_TURNS = 100.0
MAX_LEGS = 4096
# Climb of a landing that is broken off, where no take-off was flown.
_CLIMB_M, _CLIMB_DEG = 30.0, 10.0
# Plain numbers: an enumeration's member costs too much where a plan is made over thousands of items.
_WAYPOINT = int(Command.NAV_WAYPOINT)
_SPLINE = int(Command.NAV_SPLINE_WAYPOINT)


@dataclass(slots=True)
class Settings:
    """Settings that items change for the items after them."""

    speed_m_s: float
    """Ground speed."""
    heading: Heading = ALONG
    """Until the next position if that sets none."""
    # Vertical speeds, None for the vehicle's own.
    climb_m_s: float | None = None
    descent_m_s: float | None = None
    jumps: dict[int, int] = field(default_factory=dict)
    """How often each jump was taken, by its item."""
    default_m_s: float = 0.0
    """Ground speed to come back to."""
    yaw_rad: float = field(default=0.0, compare=False)
    """Heading now, from which a relative one counts."""

    def copy(self) -> Settings:
        """Return an independent copy."""
        return replace(self, jumps=dict(self.jumps))


def number(value: float | None, default: float = 0.0) -> float:
    """Return a parameter, or the default when it is not set."""
    return default if value is None else value


def item_positions(items: Sequence[MissionItem], frame: LocalFrame) -> list[Position]:
    """Return east, north, up about home of each item; NaN where it has no position of its own."""
    positions = np.full((len(items), 3), np.nan)
    index = [i for i, item in enumerate(items) if item.has_position]
    if index:
        latitude = np.array([items[i].x for i in index])
        longitude = np.array([items[i].y for i in index])
        x, y = frame.from_wgs84(latitude, longitude)
        ground = np.array([frame.altitude_m if items[i].frame == Frame.GLOBAL else 0.0 for i in index])
        height = np.array([items[i].z for i in index]) - ground
        here = (latitude == 0.0) & (longitude == 0.0)
        if here.any():
            here &= np.array([items[i].command in HERE_COMMANDS for i in index])
        positions[index] = np.column_stack([np.where(here, np.nan, x), np.where(here, np.nan, y), height])
    return [(x, y, z) for x, y, z in positions.tolist()]


def do_items(
    items: Sequence[MissionItem], start: int, settings: Settings, top_speed_m_s: float
) -> tuple[list[int], int]:
    """Execute the items before the next position on the settings.

    Returns
    -------
    done : list of int
        The items that were executed, in order.
    next : int
        The next item with a position or a condition; ``len(items)`` at the end, -1 when jumps go round.
    """
    done: list[int] = []
    seq = start
    while seq < len(items):
        item = items[seq]
        command = item.command
        if command not in DO_COMMANDS or command in CONDITIONS:
            return done, seq
        if len(done) > 2 * len(items) + 100:
            return done, -1
        done.append(seq)
        if command == Command.DO_JUMP:
            taken = settings.jumps.get(seq, 0)
            repeat = number(item.param2)
            if repeat < 0.0 or taken < repeat:
                settings.jumps[seq] = taken + 1
                seq = int(number(item.param1))
                continue
        elif command == Command.DO_CHANGE_SPEED:
            _change_speed(item, settings, top_speed_m_s)
        elif command == Command.CONDITION_YAW:
            settings.heading = Heading.fixed(_yaw(item, settings.yaw_rad))
        seq += 1
    return done, seq


def _change_speed(item: MissionItem, settings: Settings, top_speed_m_s: float) -> None:
    """Ground and air speed are one (0, 1); climb and descent (2, 3); -2 is the vehicle's own speed again."""
    kind, speed = number(item.param1), number(item.param2, -1.0)
    wanted = speed if speed > 0.0 else None
    if wanted is None and speed != -2.0:
        return
    if kind in (0.0, 1.0):
        settings.speed_m_s = min(wanted or settings.default_m_s or settings.speed_m_s, top_speed_m_s)
    elif kind == 2.0:
        settings.climb_m_s = wanted
    elif kind == 3.0:
        settings.descent_m_s = wanted


def _yaw(item: MissionItem, yaw_rad: float) -> float:
    """Return the heading that CONDITION_YAW asks for; the short way round, whatever its direction says."""
    angle = math.radians(number(item.param1))
    if number(item.param4) == 0.0:
        return angle
    return yaw_rad + (-angle if number(item.param3) < 0.0 else angle)


def time_of_day_wait_s(item: MissionItem, unix_s: float) -> float:
    """Return how long NAV_DELAY waits for its time of day (UTC): hour, minute, second, -1 is any.

    Examples
    --------
    >>> noon = 1_780_315_200.0
    >>> time_of_day_wait_s(MissionItem(93, 2, -1.0, 12.0, 30.0, 0.0), noon)
    1800.0
    >>> time_of_day_wait_s(MissionItem(93, 2, -1.0, -1.0, -1.0, 15.0), noon + 20.0)
    55.0
    """
    fields = [number(value, -1.0) for value in (item.param2, item.param3, item.param4)]
    period_s, wanted_s = 60.0, max(fields[2], 0.0)
    if fields[0] >= 0.0:
        period_s, wanted_s = 86_400.0, wanted_s + 3600.0 * fields[0] + 60.0 * max(fields[1], 0.0)
    elif fields[1] >= 0.0:
        period_s, wanted_s = 3600.0, wanted_s + 60.0 * fields[1]
    elif fields[2] < 0.0:
        return 0.0
    return (wanted_s - unix_s) % period_s


def condition_items(items: Sequence[MissionItem], start: int) -> list[int]:
    """Return the condition at ``start`` and the items that wait for it, up to the next position or jump."""
    group = []
    for seq in range(start, len(items)):
        command = items[seq].command
        if command not in DO_COMMANDS or command == Command.DO_JUMP:
            break
        group.append(seq)
    return group


def plan_item_legs(
    items: Sequence[MissionItem],
    positions: Sequence[Position],
    seq: int,
    settings: Settings,
    spec: VehicleSpec,
    here: Position,
    return_point: Position = (0.0, 0.0, 0.0),
) -> LegPlan:
    """Return the legs from item ``seq``, which has a position, as far as they are flown without a pause.

    ``settings`` is a copy to plan ahead with; ``here`` is where the vehicle is, ``return_point`` where it
    returns to and the least height of the path there.
    """
    plan = LegPlan()
    last = here
    tangent = (0.0, 0.0, 0.0)
    while True:
        item = items[seq]
        circle = None
        if spec.circles:
            position = _position_or_last(positions[seq], last)
            circle = fixed_wing_leg(
                item,
                position,
                settings.speed_m_s,
                spec,
                next_position(items, positions, seq),
                next_move(items, seq),
            )
        if circle is not None:
            last = position
            plan.add(circle.leg, seq, done=circle.goes_on)
            if circle.forever:
                plan.after_last = AfterLastLeg.FOREVER
            elif circle.wait_s is not None:
                plan.after_last, plan.wait_s = AfterLastLeg.WAIT, circle.wait_s
        elif item.command == _SPLINE:
            end = _position_or_last(positions[seq], last)
            ahead = _position_ahead(items, positions, seq)
            tangent = _spline_legs(plan, item, seq, settings, spec, (last, end, ahead), tangent)
            last = end
        else:
            before = last
            last = _item_legs(plan, item, positions[seq], seq, settings, spec, last, return_point)
            tangent = (0.0, 0.0, 0.0)
            if item.command == _WAYPOINT:
                tangent = (last[0] - before[0], last[1] - before[1], last[2] - before[2])
        settings.heading = ALONG
        if plan.after_last is not AfterLastLeg.NEXT:
            return plan
        if len(plan.legs) >= MAX_LEGS:
            plan.open = True
            return plan
        following = seq + 1
        while following < len(items) and items[following].command not in PASSED_COMMANDS:
            done, following = do_items(items, following, settings, spec.top_speed_m_s)
            plan.unsure |= any(_surprises(items[index]) for index in done)
            if not 0 <= following < len(items) or items[following].command not in CONDITIONS:
                break
            plan.unsure = True
            # What waits for a condition is not known now: the legs are planned again when it has changed
            # something.
            following = condition_items(items, following)[-1] + 1
        if not 0 <= following < len(items) or items[following].command not in PASSED_COMMANDS:
            return plan
        seq = following


def _surprises(item: MissionItem) -> bool:
    vertical = item.command == Command.DO_CHANGE_SPEED and number(item.param1) > 1.0
    return vertical or item.command in SURPRISING_COMMANDS


def _position_or_last(position: Position, last: Position) -> Position:
    return (last[0], last[1], position[2]) if math.isnan(position[0]) else position


def _position_ahead(items: Sequence[MissionItem], positions: Sequence[Position], seq: int) -> Position | None:
    """Return the position after a spline waypoint that is flown through to, None when it stops there."""
    if number(items[seq].param1) > 0.0:
        return None
    following = seq + 1
    while following < len(items) and items[following].command in DO_COMMANDS:
        if items[following].command == Command.DO_JUMP:
            return None
        following += 1
    if following >= len(items) or items[following].command not in PASSED_COMMANDS:
        return None
    return None if math.isnan(positions[following][0]) else positions[following]


def _spline_legs(
    plan: LegPlan,
    item: MissionItem,
    seq: int,
    settings: Settings,
    spec: VehicleSpec,
    path: tuple[Position, Position, Position | None],
    tangent: Position,
) -> Position:
    """Append the legs of a spline waypoint and return the direction of its end."""
    hold = number(item.param1)
    legs, after = spline_legs(path, tangent, settings.speed_m_s, settings.heading, spec)
    if hold > 0.0:
        legs[-1] = replace(legs[-1], radius_m=0.0)
    for leg in legs:
        plan.add(leg, seq, done=leg is legs[-1] and hold <= 0.0, speed=settings.speed_m_s)
    if hold > 0.0:
        plan.after_last, plan.wait_s = AfterLastLeg.WAIT, hold
    return after


def _item_legs(
    plan: LegPlan,
    item: MissionItem,
    position: Position,
    seq: int,
    settings: Settings,
    spec: VehicleSpec,
    last: Position,
    return_point: Position,
) -> Position:
    """Append the legs of one item and return where they end."""
    command = item.command
    x, y, z = _position_or_last(position, last)
    speed = settings.speed_m_s
    radius = spec.acceptance_radius_m
    heading = settings.heading
    if command == _WAYPOINT:
        if item.param4 is not None:
            heading = Heading.fixed(math.radians(item.param4))
        hold = item.param1 or 0.0
        if hold > 0.0:
            plan.add(Leg((x, y, z), speed, item.param2 or 0.0, heading), seq)
            plan.after_last, plan.wait_s = AfterLastLeg.WAIT, hold
        else:
            plan.add(Leg((x, y, z), speed, item.param2 or radius, heading), seq, done=True)
        return x, y, z
    if item.param4 is not None and command in (17, 19, 22, 31):
        heading = Heading.fixed(math.radians(item.param4))
    if command == Command.NAV_TAKEOFF:
        legs = flight_procedures(spec).takeoff_legs(spec, last, (x, y, z), speed, heading)
        if spec.circles:
            legs = [replace(leg, pitch_rad=math.radians(number(item.param1))) for leg in legs]
        for leg in legs:
            plan.add(leg, seq, done=leg is legs[-1])
        return legs[-1].end_m
    if command == Command.NAV_RETURN_TO_LAUNCH:
        legs = flight_procedures(spec).return_legs(spec, last, speed, return_point)
        for leg in legs:
            plan.add(leg, seq)
        # A fixed wing may only circle over home.
        plan.after_last = AfterLastLeg.NEXT if spec.circles and not lands(legs) else AfterLastLeg.TOUCHDOWN
        return return_point[0], return_point[1], 0.0
    if command == Command.NAV_LAND:
        for leg in flight_procedures(spec).landing_legs(spec, (x, y, last[2]), last, speed):
            plan.add(leg, seq)
        plan.after_last = AfterLastLeg.TOUCHDOWN
        return x, y, 0.0
    if command == Command.NAV_DELAY:
        plan.add(Leg(last, speed, heading=KEEP), seq)
        delay = number(item.param1)
        plan.after_last, plan.wait_s = AfterLastLeg.WAIT, delay if delay >= 0.0 else math.nan
        return last
    if command == Command.NAV_LOITER_TURNS:
        legs = circle_legs((x, y, z), last, number(item.param1), number(item.param3), speed, spec)
        for leg in legs:
            plan.add(leg, seq, done=leg is legs[-1])
        return legs[-1].end_m
    plan.add(Leg((x, y, z), speed, heading=heading), seq)
    plan.after_last = AfterLastLeg.FOREVER if command == Command.NAV_LOITER_UNLIM else AfterLastLeg.WAIT
    plan.wait_s = number(item.param1) if command == Command.NAV_LOITER_TIME else 0.0
    return x, y, z


def climb_leg(
    items: Sequence[MissionItem], seq: int, here: Position, speed: float, height_m: float | None
) -> Leg:
    """Return the climb straight ahead from a landing that is broken off (ArduPlane's ``do_land``).

    It leads to a height that is asked for, to that of the landing (its first parameter), or of the take-off.
    """
    takeoffs = [item for item in items[:seq] if item.command == Command.NAV_TAKEOFF]
    top = height_m or 0.0
    if top <= 0.0:
        top = number(items[seq].param1)
    if top <= 0.0:
        top = takeoffs[-1].z if takeoffs and takeoffs[-1].z > 0.0 else _CLIMB_M
    pitch = number(takeoffs[-1].param1) if takeoffs else 0.0
    return Leg(
        (here[0], here[1], top),
        speed,
        heading=KEEP,
        kind=LegKind.TAKEOFF,
        pitch_rad=math.radians(pitch if pitch > 0.0 else _CLIMB_DEG),
    )


def landing_start(items: Sequence[MissionItem], positions: Sequence[Position], here: Position) -> int | None:
    """Return the nearest item where a landing starts, None without one.

    One without a position of its own is where the next item is that has one.
    """
    starts = [seq for seq, item in enumerate(items) if item.command == Command.DO_LAND_START]
    if len(starts) < 2:
        return starts[0] if starts else None

    def distance(seq: int) -> float:
        places = (place for place in positions[seq:] if not math.isnan(place[0]))
        x, y, _ = next(places, (math.inf, math.inf, 0.0))
        return math.hypot(x - here[0], y - here[1])

    return min(starts, key=distance)


def landing_restart(
    items: Sequence[MissionItem], positions: Sequence[Position], seq: int, here: Position
) -> int | None:
    """Return the item at which a landing is begun anew: where it starts, or at the position before it.

    ArduPilot's ``AP_Landing::restart_landing_sequence``.
    """
    start = landing_start(items, positions, here)
    if start is not None:
        return start
    before = (
        index
        for index in range(seq - 1, -1, -1)
        if items[index].command in POSITION_COMMANDS and not math.isnan(positions[index][0])
    )
    return next(before, None)
