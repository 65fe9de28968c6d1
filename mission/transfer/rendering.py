"""Conversion of a plan for an autopilot, with remarks on items that it would refuse, change or ignore.

The conversion needs no link: all remarks are known before the first byte is sent.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from mission.autopilots.dialect import ArmingCondition, Severity
from mission.autopilots.profile import Profile
from mission.link.codec.dialect import mavlink
from mission.model import GLOBAL_FRAMES, Command, Frame, Mission, MissionItem, MissionType, has_position
from mission.transfer.events import LocalTransferError
from mission.transfer.remarks import Remark, area_remarks, count_remarks, frame_name

_PARAMETERS = ("param1", "param2", "param3", "param4")
_QUADROTOR = int(mavlink.MAV_TYPE_QUADROTOR)


@dataclass(frozen=True, slots=True)
class Rendered:
    """Plan converted for an autopilot.

    Parameters
    ----------
    mission : Mission
        Plan to send, and to compare with the plan read back.
    remarks : tuple of Remark
        Remarks in the order of plans and items, with the item numbers of the original plan. Equal remarks on
        several items are merged into one, on the first item.
    origins : tuple of int
        For each item of ``mission.items``, the number of the item in the original plan.
    """

    mission: Mission
    remarks: tuple[Remark, ...]
    origins: tuple[int, ...]

    @property
    def errors(self) -> tuple[Remark, ...]:
        """Remarks on items that the autopilot would refuse or not fly."""
        return tuple(remark for remark in self.remarks if remark.severity is Severity.ERROR)

    def origins_of(self, kind: MissionType) -> tuple[int, ...]:
        """Return, for each item of a plan to send, the number of the item in the original plan."""
        return self.origins if kind is MissionType.MISSION else tuple(range(len(self.mission.plan(kind))))

    def index_of(self, item: int) -> int:
        """Return the new number of an item of the original plan, or of the next item if it was removed."""
        return bisect_left(self.origins, item)


def render(
    mission: Mission,
    profile: Profile,
    vehicle_type: int = _QUADROTOR,
    *,
    parameters: Mapping[str, float] | None = None,
    planned: Mapping[str, float] | None = None,
) -> Rendered:
    """Convert a plan for an autopilot, with remarks on changes and errors.

    Frames, unset parameters and positions are converted to the autopilot's conventions. Unknown commands are
    replaced or removed, with a remark, if that does not change the flight. Other items that the autopilot
    would refuse or fly differently stay unchanged, with an error remark.

    Parameters
    ----------
    profile : Profile
        Autopilot profile.
    vehicle_type : int
        MAV_TYPE of the vehicle.
    parameters : mapping of str to float, optional
        Known parameters of the vehicle.
    planned : mapping of str to float, optional
        Values that the plan assumes for parameters of the vehicle that are not known.

    Examples
    --------
    >>> from mission.autopilots import PX4
    >>> rtl = MissionItem(Command.NAV_RETURN_TO_LAUNCH, Frame.GLOBAL_RELATIVE_ALT)
    >>> turns = MissionItem(Command.NAV_LOITER_TURNS, 3, 2.0, x=28.05, y=-82.15, z=10.0)
    >>> rendered = render(Mission((turns, rtl)), PX4)
    >>> rendered.mission.items[1].frame
    2
    >>> rendered.errors[0].text, rendered.errors[0].fix
    ('PX4 does not know this command', 'use NAV_LOITER_TIME, or waypoints around the circle')
    """
    writer = _Writer(mission, profile, vehicle_type)
    writer.replace_unknown()
    writer.place()
    writer.check_frames()
    writer.set_defaults()
    writer.renumber_jumps()
    writer.remark_ignored()
    for condition in profile.dialect.conditions:
        writer.check_condition(condition, parameters or {}, planned or {})
    items = tuple(item for _, item in writer.entries)
    others = area_remarks(mission, profile) + count_remarks(mission, len(items), profile, parameters or {})
    found = sorted(
        _merged(writer.remarks + others),
        key=lambda remark: (remark.plan, -1 if remark.item is None else remark.item),
    )
    return Rendered(
        mission if items == mission.items else replace(mission, items=items),
        tuple(found),
        tuple(number for number, _ in writer.entries),
    )


def refuse_errors(rendered: Rendered, *, arming: bool = True) -> None:
    """Raise LocalTransferError with the first error remark, if there is one.

    If ``arming`` is false, errors that only prevent arming (because of vehicle parameters) do not count.
    """
    errors = [remark for remark in rendered.errors if arming or not remark.parameter]
    if errors:
        others = len(errors) - 1
        more = f" (and {others} more error{'s' if others > 1 else ''})" if others else ""
        raise LocalTransferError(f"{errors[0]}{more}")


def _merged(remarks: list[Remark]) -> list[Remark]:
    """Merge equal remarks on the same command into the first remark."""
    alike: dict[Remark, list[Remark]] = {}
    for remark in remarks:
        alike.setdefault(replace(remark, item=None, others=()), []).append(remark)
    found = []
    for same in alike.values():
        items = sorted(k for remark in same for k in (remark.item, *remark.others) if k is not None)
        found.append(replace(same[0], item=items[0], others=tuple(items[1:])) if items else same[0])
    return found


_FLOWN_TO = frozenset({16, 17, 18, 19, 21, 22, 31, 82})
_ROI_NONE = 0


class _Writer:
    """Converts the items of a mission in steps; ``entries`` pairs each item with its original number."""

    def __init__(self, mission: Mission, profile: Profile, vehicle_type: int) -> None:
        self.mission = mission
        self.remarks: list[Remark] = []
        self._profile = profile
        self._dialect = profile.dialect
        self._type = vehicle_type
        standard = self._dialect.standard_frames
        self.entries = [
            (number, item.in_standard_frame() if standard else item)
            for number, item in enumerate(mission.items)
        ]

    def _say(
        self, number: int | None, severity: Severity, text: str, fix: str = "", *, parameter: str = ""
    ) -> None:
        command = None if number is None else self.mission.items[number].command
        remark = Remark(MissionType.MISSION, number, severity, text, fix, command, parameter=parameter)
        self.remarks.append(remark)

    def _knows(self, command: int) -> bool:
        placed, unplaced = self._profile.placed, self._profile.unplaced
        if command in self._dialect.not_for.get(self._type, ()):
            return False
        return placed is None or unplaced is None or command in placed or command in unplaced

    def replace_unknown(self) -> None:
        """Replace unknown commands by their substitutes, or add an error if there is no substitute."""
        commands = {item.command for _, item in self.entries}
        unknown = {command for command in commands if not self._knows(command)}
        written = []
        for number, item in self.entries:
            substitute = self._dialect.substitutes.get(item.command) if item.command in unknown else None
            made: MissionItem | None = item
            if substitute is not None:
                self._say(number, Severity.WARNING, substitute.text)
                made = substitute.make(item)
            if made is not None:
                written.append((number, made))
        self.entries = written
        # Headings are converted after the substitution, because a substitute may be the next waypoint.
        turns = any(item.command == Command.CONDITION_YAW for _, item in self.entries)
        if turns and self._dialect.yaw_in_waypoints:
            self._fold_yaw()
        written = []
        for number, item in self.entries:
            if item.command in unknown:
                text = f"{self._profile.name} does not know this command"
                fix = self._dialect.instead.get(item.command, "leave it out")
                self._say(number, Severity.ERROR, text, fix)
            roi = item.command == Command.DO_SET_ROI and self._dialect.roi_modes is not None
            if roi and (item.param1 or 0.0) == _ROI_NONE:
                # PX4 accepts DO_SET_ROI with mode 0 (none) only as DO_SET_ROI_NONE.
                item = MissionItem(Command.DO_SET_ROI_NONE, autocontinue=item.autocontinue)
            written.append((number, item))
        self.entries = written

    def _fold_yaw(self) -> None:
        """Convert CONDITION_YAW into the heading (param4) of the next waypoint."""
        written: list[tuple[int, MissionItem]] = []
        pending: tuple[int, float] | None = None
        for number, item in self.entries:
            if item.command == Command.CONDITION_YAW and item.param1 is not None and not item.param4:
                pending = (number, item.param1)
                self._say(number, Severity.WARNING, "sent as the heading (param4) of the next waypoint")
                continue
            if pending is not None and item.command in _FLOWN_TO:
                yaw_number, yaw_deg = pending
                pending = None
                if item.command == Command.NAV_WAYPOINT and item.param4 is None:
                    item = replace(item, param4=yaw_deg)
                else:
                    self._keep_yaw(written, yaw_number)
            written.append((number, item))
        if pending is not None:
            self._keep_yaw(written, pending[0])
        self.entries = sorted(written, key=lambda entry: entry[0])

    def _keep_yaw(self, written: list[tuple[int, MissionItem]], number: int) -> None:
        """Keep a CONDITION_YAW that no waypoint can take over; a later step reports the error."""
        self.remarks = [remark for remark in self.remarks if remark.item != number]
        written.append((number, self.mission.items[number]))

    def place(self) -> None:
        """Convert the positions of DO_LAND_START and of items at 0, 0 ("the current position")."""
        dialect = self._dialect
        home = self.mission.home
        before = None if home is None else (home.latitude_deg, home.longitude_deg)
        for k, (number, item) in enumerate(self.entries):
            if item.command == Command.DO_LAND_START:
                self.entries[k] = (number, self._landing_start(k, item))
                continue
            if item.frame not in GLOBAL_FRAMES or item.command not in _FLOWN_TO:
                continue
            if item.x == item.y == 0.0 and not dialect.zero_is_here:
                later = (each for _, each in self.entries[k + 1 :] if each.has_position)
                here = before or next(((each.x, each.y) for each in later if each.x or each.y), None)
                if here is None:
                    text = f"{self._profile.name} would fly to latitude 0, longitude 0"
                    self._say(number, Severity.ERROR, text, "give the item a position")
                    continue
                text = f"{self._profile.name} would fly to latitude 0, longitude 0; "
                text += f"sent as {here[0]:.7f}, {here[1]:.7f}, the vehicle's position at this item"
                self._say(number, Severity.WARNING, text)
                item = replace(item, x=here[0], y=here[1])
                self.entries[k] = (number, item)
            if item.x or item.y:
                before = (item.x, item.y)

    def _landing_start(self, k: int, item: MissionItem) -> MissionItem:
        """Return DO_LAND_START as the autopilot needs it: with the next item's position or no position."""
        if self._dialect.land_start_placed is False and item.frame != Frame.MISSION:
            return MissionItem(Command.DO_LAND_START, autocontinue=item.autocontinue)
        if self._dialect.land_start_placed and item.frame == Frame.MISSION:
            for _, following in self.entries[k + 1 :]:
                if following.has_position and following.command in _FLOWN_TO:
                    return replace(item, frame=following.frame, x=following.x, y=following.y, z=following.z)
        return item

    def check_frames(self) -> None:
        """Add an error for each position in a frame that the autopilot refuses or misreads."""
        name, dialect = self._profile.name, self._dialect
        kinds = {(item.command, item.frame) for _, item in self.entries if has_position(item.command)}
        problems = {kind: self._frame_problem(*kind) for kind in kinds if self._knows(kind[0])}
        for number, item in self.entries:
            kind = (item.command, item.frame)
            if kind not in problems:
                continue
            problem = problems[kind]
            if problem is not None:
                self._say(number, Severity.ERROR, *problem)
            elif item.frame in GLOBAL_FRAMES and abs(item.z) >= dialect.highest_m:
                text = f"altitude {item.z:g} m: {name} accepts altitudes below {dialect.highest_m:g} m"
                self._say(number, Severity.ERROR, text, "fly lower")
            elif (
                dialect.roi_modes is not None
                and item.command == Command.DO_SET_ROI
                and item.frame in GLOBAL_FRAMES
                and (item.param1 or 0.0) not in dialect.roi_modes
            ):
                text = f"{name} takes DO_SET_ROI of mode {item.param1 or 0.0:g} only without a position"
                self._say(number, Severity.ERROR, text, "use DO_SET_ROI_LOCATION")

    def _frame_problem(self, command: int, frame: int) -> tuple[str, str] | None:
        """Return why the autopilot refuses a command with a position in this frame, and the fix, or None."""
        profile = self._profile
        without = frame == Frame.MISSION and profile.unplaced is not None
        if without and command not in (profile.unplaced or ()):
            fix = "give frame 3 (above home) or 0 (above sea level)"
            return "a position is not possible in frame 2 (MISSION)", fix
        if frame in GLOBAL_FRAMES and profile.placed is not None and command not in profile.placed:
            return (
                f"{profile.name} takes this command only without a position",
                "give the command in frame 2 (MISSION)",
            )
        if profile.frames is not None and frame not in profile.frames and not without:
            fix = "give altitudes above home (frame 3) or above sea level (frame 0)"
            return f"{profile.name} does not take frame {frame_name(frame)}", fix
        return None

    def set_defaults(self) -> None:
        """Give unset parameters their default values if the autopilot refuses NaN for them."""
        if self._profile.nan_parameters is None:
            return
        for k, (number, item) in enumerate(self.entries):
            self.entries[k] = (number, _without_nan(item, self._profile))

    def renumber_jumps(self) -> None:
        """Renumber jump targets after items were removed; add an error for each invalid target."""
        origins = [number for number, _ in self.entries]
        count = len(self.mission.items)
        jumps = 0
        for k, (number, item) in enumerate(self.entries):
            if item.command != Command.DO_JUMP:
                continue
            jumps += 1
            target = item.param1
            if target is None or not 0.0 <= target < count or target != int(target):
                where = "nowhere" if target is None else f"to item {target + 1:g}"
                self._say(number, Severity.ERROR, f"jumps {where}", f"give an item from 1 to {count}")
                continue
            there = float(bisect_left(origins, int(target)))
            if there != target:
                self.entries[k] = (number, replace(item, param1=there))
        most = self._dialect.most_jumps
        if most is not None and jumps > most:
            text = f"{jumps} DO_JUMP items: many {self._profile.name} boards can repeat only {most} of them"
            self._say(None, Severity.WARNING, text, "fly the mission in parts")

    def remark_ignored(self) -> None:
        """Add remarks on parameters that the autopilot ignores."""
        for row in self._dialect.ignored:
            if row.vehicle_types is not None and self._type not in row.vehicle_types:
                continue
            for number, item in self.entries:
                if item.command == row.command and getattr(item, row.name):
                    self._say(number, row.severity, row.text, row.fix)
        if MissionType.MISSION not in self._profile.keeps_autocontinue:
            text = f"{self._profile.name} does not stop after an item (autocontinue)"
            for number, item in self.entries:
                if not item.autocontinue:
                    self._say(number, Severity.WARNING, text, "use NAV_LOITER_UNLIM to stop the vehicle")

    def check_condition(
        self, condition: ArmingCondition, parameters: Mapping[str, float], planned: Mapping[str, float]
    ) -> None:
        """Add a remark if the mission violates an arming condition set by a parameter of the vehicle."""
        if self._type not in condition.vehicle_types or not self.entries:
            return
        barred = [number for number, item in self.entries if item.command in condition.barred]
        has_needed = any(item.command in condition.needed for _, item in self.entries)
        if not barred and (has_needed or not condition.needed):
            return
        name = condition.parameter
        known, assumed = parameters.get(name), planned.get(name)
        value = assumed if known is None else known
        first = barred[0] if barred else None
        if value in condition.refusing:
            text = condition.text.format(value=value)
            self._say(first, Severity.ERROR, text, condition.fix, parameter=name)
        elif known is None and condition.usual in condition.refusing:
            text = condition.text.format(value=condition.usual) + ", its default"
            if assumed is None:
                self._say(first, condition.unknown, text, condition.fix, parameter=name)
            else:
                fix = f"make sure that {name} is {assumed:g} on the vehicle, as the plan assumes"
                self._say(first, Severity.NOTE, text, fix, parameter=name)


def _without_nan(item: MissionItem, profile: Profile) -> MissionItem:
    """Return the item with default values for those unset parameters that must not be NaN."""
    allowed = (profile.nan_parameters or {}).get(item.command, frozenset())
    defaults = profile.dialect.defaults.get(item.command, {})
    unset: dict[str, Any] = {
        name: defaults.get(name, 0.0)
        for name in _PARAMETERS
        if getattr(item, name) is None and name not in allowed
    }
    return replace(item, **unset) if unset else item
