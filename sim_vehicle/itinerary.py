"""From mission items to legs: what the vehicle flies without asking again, and what follows."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np

from mission.model import Command, Frame, MissionItem

if TYPE_CHECKING:
    from collections.abc import Sequence

    from geo.frame import LocalFrame
    from sim_vehicle.spec import VehicleSpec

# Items that are executed between two places.
DO_COMMANDS = frozenset(
    {112, 114, 115, 177, 178, 189, 195, 197, 201, 203, 205, 206, 214, 530}
    | {1000, 1001, 2000, 2001, 2003, 2500, 2501}
)
CAMERA_COMMANDS = frozenset({203, 206, 214, 530, 2000, 2001, 2003})
CONDITIONS = frozenset({int(Command.CONDITION_DELAY), int(Command.CONDITION_DISTANCE)})
PLACE_COMMANDS = frozenset({16, 17, 18, 19, 31})
NAV_COMMANDS = PLACE_COMMANDS | {20, 21, 22, 93}
HERE_COMMANDS = frozenset({17, 18, 19, 21, 22, 31})
LOITER_RADIUS_M = 10.0
MAX_TURNS = 100.0
MAX_LEGS = 4096
SLOW_LANDING_M = 5.0
KEEP = math.inf
# Plain numbers: an enumeration's member costs too much where a plan is made over thousands of items.
_WAYPOINT = int(Command.NAV_WAYPOINT)
ALONG = math.nan

Row = tuple[float, float, float, float, float, float, float]


class Ending(Enum):
    """What follows the last leg."""

    NEXT = "the next item"
    WAIT = "a pause"
    FOREVER = "nothing, it stays"
    TOUCHDOWN = "the ground"


@dataclass(slots=True)
class Settings:
    """What items change for the items after them.

    Parameters
    ----------
    speed_m_s : float
        Ground speed.
    heading_rad : float
        Heading of items that set none; NaN looks along the path.
    jumps : dict
        How often each jump was taken, by its item.
    """

    speed_m_s: float
    heading_rad: float = ALONG
    jumps: dict[int, int] = field(default_factory=dict)

    def copy(self) -> Settings:
        """Return an independent copy."""
        return replace(self, jumps=dict(self.jumps))


@dataclass(slots=True)
class Itinerary:
    """Legs and what they complete.

    Parameters
    ----------
    rows : list of (x, y, z, radius, speed, heading, near)
        Rows of `sim_vehicle.motion.model.Route`.
    seqs : list of int
        The item that each leg belongs to, -1 outside a mission.
    done : list of bool
        Whether the leg completes its item.
    ending : Ending
    wait_s : float
        Of a WAIT.
    open : bool
        Whether it was cut short, so it has to be planned again before its end.
    unsure : bool
        Whether something between its items waits for a condition, which may change it.
    """

    rows: list[Row] = field(default_factory=list)
    seqs: list[int] = field(default_factory=list)
    done: list[bool] = field(default_factory=list)
    ending: Ending = Ending.NEXT
    wait_s: float = 0.0
    open: bool = False
    unsure: bool = False

    def add(self, row: Row, seq: int = -1, *, done: bool = False) -> None:
        """Append a leg."""
        self.rows.append(row)
        self.seqs.append(seq)
        self.done.append(done)

    def prepend(self, row: Row, seq: int) -> None:
        """Put a leg before all others; it completes nothing."""
        self.rows.insert(0, row)
        self.seqs.insert(0, seq)
        self.done.insert(0, False)


def number(value: float | None, default: float = 0.0) -> float:
    """Return a parameter, or the default when it is not set."""
    return default if value is None else value


def item_places(items: Sequence[MissionItem], frame: LocalFrame) -> list[tuple[float, float, float]]:
    """Return east, north, up about home of each item; NaN where it has no place of its own."""
    places = np.full((len(items), 3), np.nan)
    index = [i for i, item in enumerate(items) if item.has_place]
    if index:
        latitude = np.array([items[i].x for i in index])
        longitude = np.array([items[i].y for i in index])
        x, y = frame.from_wgs84(latitude, longitude)
        ground = np.array([frame.altitude_m if items[i].frame == Frame.GLOBAL else 0.0 for i in index])
        height = np.array([items[i].z for i in index]) - ground
        here = (latitude == 0.0) & (longitude == 0.0)
        if here.any():
            here &= np.array([items[i].command in HERE_COMMANDS for i in index])
        places[index] = np.column_stack([np.where(here, np.nan, x), np.where(here, np.nan, y), height])
    return [(x, y, z) for x, y, z in places.tolist()]


def do_items(
    items: Sequence[MissionItem], start: int, settings: Settings, top_speed_m_s: float
) -> tuple[list[int], int]:
    """Execute the items before the next place on the settings.

    Returns
    -------
    done : list of int
        The items that were executed, in order.
    next : int
        The next place item or condition; ``len(items)`` at the end, -1 if jumps never lead to a place.
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
            speed = number(item.param2, -1.0)
            if speed > 0.0 and number(item.param1) in (0.0, 1.0):
                settings.speed_m_s = min(speed, top_speed_m_s)
        elif command == Command.CONDITION_YAW:
            settings.heading_rad = math.radians(number(item.param1))
        seq += 1
    return done, seq


def condition_items(items: Sequence[MissionItem], start: int) -> list[int]:
    """Return the condition at ``start`` and the items that wait for it, up to the next place or jump."""
    group = []
    for seq in range(start, len(items)):
        command = items[seq].command
        if command not in DO_COMMANDS or command == Command.DO_JUMP:
            break
        group.append(seq)
    return group


def plan_item_legs(
    items: Sequence[MissionItem],
    places: Sequence[tuple[float, float, float]],
    seq: int,
    settings: Settings,
    spec: VehicleSpec,
    here: tuple[float, float, float],
) -> Itinerary:
    """Return the legs from the place item ``seq`` on, as far as they are flown without a pause.

    ``settings`` is a copy to look ahead with; ``here`` is where the vehicle is.
    """
    plan = Itinerary()
    last = here
    while True:
        item = items[seq]
        last = _item_legs(plan, item, places[seq], seq, settings, spec, last)
        if plan.ending is not Ending.NEXT:
            return plan
        if len(plan.rows) >= MAX_LEGS:
            plan.open = True
            return plan
        following = seq + 1
        while following < len(items) and items[following].command != _WAYPOINT:
            _, following = do_items(items, following, settings, spec.top_speed_m_s)
            if not 0 <= following < len(items) or items[following].command not in CONDITIONS:
                break
            plan.unsure = True
            # What waits for a condition is not known now: the legs are planned again when it has changed
            # something.
            following = condition_items(items, following)[-1] + 1
        if not 0 <= following < len(items) or items[following].command != _WAYPOINT:
            return plan
        seq = following


def _item_legs(
    plan: Itinerary,
    item: MissionItem,
    place: tuple[float, float, float],
    seq: int,
    settings: Settings,
    spec: VehicleSpec,
    last: tuple[float, float, float],
) -> tuple[float, float, float]:
    """Append the legs of one item and return where they end."""
    command = item.command
    x, y, z = place
    if math.isnan(x):
        x, y = last[0], last[1]
    speed = settings.speed_m_s
    radius = spec.acceptance_radius_m
    heading = settings.heading_rad
    if command == _WAYPOINT:
        if item.param4 is not None:
            heading = math.radians(item.param4)
        hold = item.param1 or 0.0
        if hold > 0.0:
            plan.add((x, y, z, 0.0, speed, heading, 0.0), seq)
            plan.ending, plan.wait_s = Ending.WAIT, hold
        else:
            plan.add((x, y, z, item.param2 or radius, speed, heading, 0.0), seq, done=True)
        return x, y, z
    if item.param4 is not None and command in (17, 19, 22, 31):
        heading = math.radians(item.param4)
    if command == Command.NAV_TAKEOFF:
        keep = KEEP if item.param4 is None else heading
        aside = math.hypot(x - last[0], y - last[1]) > radius
        plan.add((last[0], last[1], max(z, last[2]), radius, speed, keep, 0.0), seq, done=not aside)
        if aside:
            plan.add((x, y, z, radius, speed, heading, 0.0), seq, done=True)
            return x, y, z
        return last[0], last[1], max(z, last[2])
    if command == Command.NAV_RETURN_TO_LAUNCH:
        for row in return_rows(spec, last, speed):
            plan.add(row, seq)
        plan.ending = Ending.TOUCHDOWN
        return 0.0, 0.0, 0.0
    if command == Command.NAV_LAND:
        for row in landing_rows(spec, (x, y, last[2]), last, speed):
            plan.add(row, seq)
        plan.ending = Ending.TOUCHDOWN
        return x, y, 0.0
    if command == Command.NAV_DELAY:
        plan.add((*last, 0.0, speed, KEEP, 0.0), seq)
        plan.ending, plan.wait_s = Ending.WAIT, number(item.param1)
        return last
    if command == Command.NAV_LOITER_TURNS:
        rows = circle_rows(item, (x, y, z), last, speed, spec)
        for row in rows:
            plan.add(row, seq, done=row is rows[-1])
        return rows[-1][0], rows[-1][1], rows[-1][2]
    plan.add((x, y, z, 0.0, speed, heading, 0.0), seq)
    plan.ending = Ending.FOREVER if command == Command.NAV_LOITER_UNLIM else Ending.WAIT
    plan.wait_s = number(item.param1) if command == Command.NAV_LOITER_TIME else 0.0
    return x, y, z


def landing_rows(
    spec: VehicleSpec, above: tuple[float, float, float], last: tuple[float, float, float], speed: float
) -> list[Row]:
    """Return the legs to a place at the height ``above[2]`` and down to the ground there."""
    x, y, z = above
    rows: list[Row] = []
    if math.hypot(x - last[0], y - last[1]) > 0.05:
        rows.append((x, y, z, 0.0, speed, ALONG, 0.0))
    if z > SLOW_LANDING_M:
        rows.append((x, y, SLOW_LANDING_M, 0.3, -spec.descent_speed_m_s, KEEP, 0.0))
    rows.append((x, y, 0.0, 0.0, -spec.landing_speed_m_s, KEEP, 0.0))
    return rows


def return_rows(spec: VehicleSpec, last: tuple[float, float, float], speed: float) -> list[Row]:
    """Return the legs home: up to the return altitude unless home is right below, over home, and down."""
    x, y, z = last
    if math.hypot(x, y) <= spec.acceptance_radius_m:
        return landing_rows(spec, (0.0, 0.0, z), last, speed)
    rows: list[Row] = []
    if z < spec.return_altitude_m:
        z = spec.return_altitude_m
        rows.append((x, y, z, spec.acceptance_radius_m, speed, KEEP, 0.0))
    return rows + landing_rows(spec, (0.0, 0.0, z), (x, y, z), speed)


def circle_rows(
    item: MissionItem,
    centre: tuple[float, float, float],
    last: tuple[float, float, float],
    speed: float,
    spec: VehicleSpec,
) -> list[Row]:
    """Return chords of 10 degrees for a circle that begins at its point nearest to the vehicle."""
    x, y, z = centre
    radius = number(item.param3) or LOITER_RADIUS_M
    sense = -1.0 if radius > 0.0 else 1.0
    radius = abs(radius)
    begin = math.atan2(last[1] - y, last[0] - x)
    chords = max(1, round(36.0 * number(item.param1)))
    step = sense * math.radians(10.0)
    slow = min(speed, math.sqrt(0.5 * spec.acceleration_m_s2 * radius))
    accept = min(spec.acceptance_radius_m, 0.3 * radius * abs(step))
    return [
        (
            x + radius * math.cos(begin + k * step),
            y + radius * math.sin(begin + k * step),
            z,
            accept,
            speed if k == 0 else slow,
            ALONG,
            0.0,
        )
        for k in range(chords + 1)
    ]
