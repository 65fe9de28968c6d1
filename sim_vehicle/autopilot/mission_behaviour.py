"""Which missions an autopilot takes, how it takes one changed in flight, and what it does around it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

from mission.model import Command
from sim_vehicle.autopilot.modes import Mode

if TYPE_CHECKING:
    from mission.model import MissionItem
    from sim_vehicle.autopilot.runtime_parameters import RuntimeParameters

__all__ = ["MissionBehaviour", "MissionRule", "arduplane_landing", "no_rule", "px4_takeoff_and_landing"]

MissionRule: TypeAlias = "Callable[[Sequence[MissionItem], RuntimeParameters], str | None]"
"""Given a mission and the parameters, why it is refused; None when it is not."""

_TAKEOFFS = frozenset({int(Command.NAV_TAKEOFF), 84})
_LANDINGS = frozenset({int(Command.NAV_LAND), 85})
_WANTS_TAKEOFF, _WANTS_LANDING = (1, 3), (2, 3)
_BOTH_OR_NEITHER = (4, 5)


def no_rule(_items: Sequence[MissionItem], _parameters: RuntimeParameters) -> str | None:
    """Want nothing."""
    return None


def px4_takeoff_and_landing(items: Sequence[MissionItem], parameters: RuntimeParameters) -> str | None:
    """MIS_TKO_LAND_REQ: 1 take-off, 2 landing, 3 both, 4 and 5 both or neither; a return is no landing."""
    rule = parameters.mission_requirement
    commands = {int(item.command) for item in items}
    takes_off, lands = bool(commands & _TAKEOFFS), bool(commands & _LANDINGS)
    if rule in _WANTS_TAKEOFF and not takes_off:
        return "Takeoff waypoint required."
    if rule in _WANTS_LANDING and not lands:
        return "Landing waypoint/pattern required."
    if rule in _BOTH_OR_NEITHER and takes_off != lands:
        return "Add Landing item or remove Takeoff." if takes_off else "Add Takeoff item or remove Landing."
    return None


def arduplane_landing(items: Sequence[MissionItem], parameters: RuntimeParameters) -> str | None:
    """Refuse a landing sequence that a return would not fly."""
    has_landing = any(item.command == Command.DO_LAND_START for item in items)
    if has_landing and parameters.settings.get("RTL_AUTOLAND", 0.0) == 0.0:
        return "DO_LAND_START set and RTL_AUTOLAND disabled"
    return None


@dataclass(frozen=True, slots=True)
class MissionBehaviour:
    """Behaviour of one firmware with a mission in flight; the defaults are PX4's, as far as nothing is said.

    The item that is flown keeps its number when a mission is changed, under any autopilot.
    """

    restarts_leg: bool = False
    """Each item holds as soon as it arrives, and the leg to the present waypoint begins anew (ArduPilot).
    Otherwise a mission holds as a whole, with its acknowledgement."""
    clamps_item: bool = True
    """Of a mission that is shorter than the number of the present item the last item is flown (PX4).
    Otherwise the old leg is flown to its end, which ends the mission (ArduPilot)."""
    obeys_mark: bool = True
    """The item with ``current`` = 1 is the present one from the acknowledgement on (PX4)."""
    keeps_jumps: bool = False
    """How often a jump was taken is remembered over a change (ArduPilot)."""
    clears_in_flight: bool = True
    """MISSION_CLEAR_ALL is accepted while the mission is flown, and ends it (PX4)."""
    stays_after_last: bool = False
    """After the last item the vehicle stays in the mission mode; only MISSION_START goes on (ArduPilot).
    Otherwise it holds."""
    return_lag_s: float | None = None
    """A return that is the last item ends the mission: after this time the vehicle is in the mode of returns
    (PX4). None: it is flown as an item, in the mission mode."""
    finished_texts: tuple[str, str] = ("Mission complete", "Mission complete")
    """What is said when the mission is over in the air, and on the ground."""
    return_text: str = ""
    """What is said besides when it ends in the mode of returns."""
    forgets_speed_in: frozenset[Mode] = frozenset()
    """Modes that begin at the vehicle's own speed (ArduPilot)."""
    replays_speed: bool = False
    """A mission that is gone on with has the speed that its items before the present one set (PX4); a single
    order has its own."""
    rewinds_survey: bool = False
    """A mission that was left while its camera was shooting is gone on with at the position before the one it
    came from (PX4)."""
    pauses_shots: bool = True
    """Shots that go on by themselves stop when the mission mode is left, and go on from the next position
    that is reached in it (PX4). Otherwise they go on in any mode, until the vehicle disarms (ArduPilot)."""
    tells_shots: bool = False
    """Shots that the autopilot has ordered are told by CAMERA_FEEDBACK (ArduPilot)."""
    changed_texts: tuple[str, ...] = ()
    """What is said when a leg begins anew; ``{}`` is the number of the item."""
    # What is said when the present item is gone, and when the mission was cleared; empty for nothing.
    restart_failed_text: str = ""
    no_mission_text: str = ""
    empty_mission_text: str = ""
    """Why a vehicle whose mission mode was taken without a mission does not arm (ArduPilot); where it is
    empty, the mode is refused."""
    refuses: MissionRule = no_rule
    """Why a mission that could be flown is refused when it comes (PX4)."""
    refuses_to_arm: MissionRule = no_rule
    """Why a vehicle with this mission does not arm, in any mode (ArduPlane)."""
    unknown_current_s: float = 0.0
    """So long after a change MISSION_CURRENT names no item, 65535 (PX4)."""
    stopped_state: bool = False
    """Outside its mode a mission is not started (2) and MISSION_CURRENT's mode unknown (0), as ArduPilot
    says; otherwise it is paused (4) and suspended (2)."""
