"""Mission of a pilot: problems and progress."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from typing import TYPE_CHECKING

from mission.model import Command
from sim_vehicle.autopilot.modes import Mode
from sim_vehicle.execution.feasibility import ItemProblem, check_mission
from sim_vehicle.execution.state import FlightPhase, LandedState
from sim_vehicle.pilot.controls import MissionState, Severity

if TYPE_CHECKING:
    from mission.model import MissionItem
    from sim_vehicle.pilot.controls import Controls
    from sim_vehicle.pilot.failsafe import Failsafe

__all__ = ["MissionChange", "MissionStatus"]


class MissionChange(Enum):
    """Effect of a new mission on the vehicle."""

    STORED = "stored without effect on the flight"
    TURNED = "the vehicle turned to the present item of the new mission"
    LATER = "the present item is completed first"
    LOST = "the present item no longer exists: its completion ends the mission"


class MissionStatus:
    """Status of the loaded mission."""

    def __init__(self, controls: Controls, failsafe: Failsafe) -> None:
        # Reasons why the mission cannot be flown.
        self.problems: tuple[ItemProblem, ...] = ()
        # Whether the mission was begun since arming, whether it was completed, and whether only the return
        # remains, which PX4 does not count as part of the mission.
        self.started = self.complete = self.returns = False
        self._chosen = False
        self._in_air = False
        self._controls = controls
        self._failsafe = failsafe

    @property
    def waits(self) -> bool:
        """Whether the mission is over, even if an item was chosen for a restart."""
        return self.complete or self._chosen

    def choose(self) -> None:
        """Record that the current item was chosen, from which a completed mission may restart."""
        self._chosen = self.waits or self.returns
        self.complete = self.returns = False

    def begin(self) -> None:
        """Record that the mission was begun or resumed."""
        self.complete = self.returns = self._chosen = False
        self.started = True

    @property
    def items(self) -> tuple[MissionItem, ...]:
        """Items of the mission."""
        return self._controls.executor.mission.items

    @property
    def size(self) -> int:
        """Number of mission items."""
        return len(self.items)

    @property
    def current_seq(self) -> int:
        """Index of the present or next item."""
        return max(0, self._controls.executor.mission.current_seq)

    @property
    def why_not(self) -> str | None:
        """Reason why the mission cannot be flown, or None."""
        if not self.items:
            return "no mission"
        return str(self.problems[0]) if self.problems else None

    def check(self, items: Sequence[MissionItem], *, in_air: bool = False) -> None:
        """Update the problems of a mission; `in_air`: the mission needs no take-off."""
        self.problems = ()
        self._in_air = in_air
        if items:
            executor, failsafe = self._controls.executor, self._failsafe
            self.problems = tuple(
                check_mission(
                    items,
                    executor.mission.frame,
                    executor.spec,
                    needs_takeoff=not in_air and not executor.mission.takes_off,
                    outside=failsafe.outside if failsafe.fence_enabled else None,
                    home_up_m=self._controls.home_m[2],
                )
            )
            refusal = self._controls.behaviour.refuses(items, self._controls.parameters)
            if refusal is not None:
                self.problems += (ItemProblem(None, 0, "firmware", refusal),)

    def why_not_begin(self) -> str | None:
        """Return the reason against beginning the mission now, or None; in the air it needs no take-off."""
        controls = self._controls
        in_air = controls.landed is not LandedState.ON_GROUND
        if self.problems and in_air and not self._in_air:
            self.check(self.items, in_air=True)
        first = self.items[0].command if self.items else None
        if self.why_not is not None and not in_air and first != Command.NAV_TAKEOFF:
            controls.note(Severity.CRITICAL, controls.behaviour.no_takeoff_text)
        return self.why_not

    def check_on_ground(self) -> None:
        """Check a mission that was uploaded in the air as one that begins on the ground."""
        if self._in_air:
            self.check(self.items)

    def check_again(self) -> ItemProblem | None:
        """Check the mission after a change of fence or parameters; return a new problem, or None."""
        if not self.items:
            return None
        before = self.problems
        self.check(self.items, in_air=self._in_air)
        return self.problems[0] if self.problems and self.problems != before else None

    @property
    def state(self) -> MissionState:
        """Progress of the mission."""
        controls = self._controls
        if not self.items or (self.problems and controls.behaviour.rejected_text):
            return MissionState.NO_MISSION
        if self.complete or self.returns:
            return MissionState.COMPLETE
        if not self.started:
            return MissionState.NOT_STARTED
        in_mode = controls.mode is Mode.MISSION and controls.armed
        flying = in_mode and controls.state.phase is not FlightPhase.HOLD
        return MissionState.ACTIVE if flying else MissionState.PAUSED
