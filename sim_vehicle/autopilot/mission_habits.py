"""How an autopilot takes a mission that is changed while it flies, and what it does around a mission."""

from __future__ import annotations

from dataclasses import dataclass

from sim_vehicle.autopilot.mission_rules import MissionRule, no_rule
from sim_vehicle.autopilot.modes import Mode

__all__ = ["MissionHabits"]


@dataclass(frozen=True, slots=True)
class MissionHabits:
    """Habits of one firmware with a mission in flight; the defaults are PX4's, as far as nothing is said.

    The item that is flown keeps its number when a mission is changed, under any autopilot.

    Parameters
    ----------
    restarts_leg : bool
        Each item holds as soon as it arrives, and the leg to the present waypoint begins anew (ArduPilot).
        Otherwise a mission holds as a whole, with its acknowledgement.
    clamps_item : bool
        Of a mission that is shorter than the number of the present item the last item is flown (PX4).
        Otherwise the old leg is flown to its end, which ends the mission (ArduPilot).
    obeys_mark : bool
        The item with ``current`` = 1 is the present one from the acknowledgement on (PX4).
    keeps_jumps : bool
        How often a jump was taken is remembered over a change (ArduPilot).
    clears_in_flight : bool
        MISSION_CLEAR_ALL is accepted while the mission is flown, and ends it (PX4).
    stays_after_last : bool
        After the last item the vehicle stays in the mission mode; only MISSION_START goes on (ArduPilot).
        Otherwise it holds.
    return_lag_s : float or None
        A return that is the last item ends the mission: after this time the vehicle is in the mode of
        returns (PX4). None: it is flown as an item, in the mission mode.
    finished_texts : tuple of 2 str
        What is said when the mission is over in the air, and on the ground.
    return_text : str
        What is said besides when it ends in the mode of returns.
    forgets_speed_in : frozenset of Mode
        Modes that begin at the vehicle's own speed (ArduPilot).
    replays_speed : bool
        A mission that is gone on with has the speed that its items before the present one set (PX4); a
        single order has its own.
    rewinds_survey : bool
        A mission that was left while its camera was shooting is gone on with at the position before the one
        it came from (PX4).
    pauses_shots : bool
        Shots that go on by themselves stop when the mission mode is left, and go on from the next position
        that is reached in it (PX4). Otherwise they go on in any mode, until the vehicle disarms (ArduPilot).
    tells_shots : bool
        Shots that the autopilot has ordered are told by CAMERA_FEEDBACK (ArduPilot).
    changed_texts : tuple of str
        What is said when a leg begins anew; ``{}`` is the number of the item.
    restart_failed_text, no_mission_text : str
        What is said when the present item is gone, and when the mission was cleared; empty for nothing.
    empty_mission_text : str
        Why a vehicle whose mission mode was taken without a mission does not arm (ArduPilot); where it is
        empty, the mode is refused.
    refuses : MissionRule
        Why a mission that could be flown is refused when it comes (PX4).
    refuses_to_arm : MissionRule
        Why a vehicle with this mission does not arm, in any mode (ArduPlane).
    unknown_current_s : float
        So long after a change MISSION_CURRENT names no item, 65535 (PX4).
    stopped_state : bool
        Outside its mode a mission is not started (2) and MISSION_CURRENT's mode unknown (0), as ArduPilot
        says; otherwise it is paused (4) and suspended (2).
    """

    restarts_leg: bool = False
    clamps_item: bool = True
    obeys_mark: bool = True
    keeps_jumps: bool = False
    clears_in_flight: bool = True
    stays_after_last: bool = False
    return_lag_s: float | None = None
    finished_texts: tuple[str, str] = ("Mission complete", "Mission complete")
    return_text: str = ""
    forgets_speed_in: frozenset[Mode] = frozenset()
    replays_speed: bool = False
    rewinds_survey: bool = False
    pauses_shots: bool = True
    tells_shots: bool = False
    changed_texts: tuple[str, ...] = ()
    restart_failed_text: str = ""
    no_mission_text: str = ""
    empty_mission_text: str = ""
    refuses: MissionRule = no_rule
    refuses_to_arm: MissionRule = no_rule
    unknown_current_s: float = 0.0
    stopped_state: bool = False
