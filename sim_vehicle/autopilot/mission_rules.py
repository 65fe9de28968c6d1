"""What an autopilot wants of a mission besides that it can be flown.

Sources: PX4 ``FeasibilityChecker.cpp`` (MIS_TKO_LAND_REQ), ArduPlane ``AP_Arming_Plane.cpp`` (RTL_AUTOLAND),
and what PX4 1.17 (SIH) and ArduPlane (SITL) were seen to refuse.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeAlias

from mission.model import Command

if TYPE_CHECKING:
    from mission.model import MissionItem
    from sim_vehicle.autopilot.runtime_parameters import RuntimeParameters

__all__ = ["MissionRule", "arduplane_landing", "no_rule", "px4_takeoff_and_landing"]

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
