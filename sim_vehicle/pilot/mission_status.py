"""The mission that a pilot has: whether it can be flown, and how far it is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from sim_vehicle.execution.feasibility import check_mission
from sim_vehicle.execution.state import FlightPhase
from sim_vehicle.pilot.notices import MissionState

if TYPE_CHECKING:
    from mission.model import MissionItem
    from sim_vehicle.pilot.controls import Controls
    from sim_vehicle.pilot.failsafe import Failsafe

__all__ = ["MissionStatus"]


class MissionStatus:
    """Status of the loaded mission.

    Parameters
    ----------
    controls : Controls
        The vehicle that has it.
    failsafe : Failsafe
        Its fence, which may not allow a position of the mission.

    Attributes
    ----------
    problems : tuple of str
        What cannot be flown.
    started, complete : bool
        Whether the mission was begun since the vehicle was armed, and flown to its end.
    """

    def __init__(self, controls: Controls, failsafe: Failsafe) -> None:
        self.problems: tuple[str, ...] = ()
        self.started = False
        self.complete = False
        self._controls = controls
        self._failsafe = failsafe

    @property
    def items(self) -> tuple[MissionItem, ...]:
        """The mission."""
        return self._controls.executor.items

    @property
    def size(self) -> int:
        """Number of its items."""
        return len(self.items)

    @property
    def current_seq(self) -> int:
        """The item that is flown now or next."""
        return max(0, self._controls.executor.current_seq)

    @property
    def why_not(self) -> str | None:
        """Why the mission cannot be flown; None when it can."""
        if not self.items:
            return "no mission"
        return self.problems[0] if self.problems else None

    def judge(self, items: Sequence[MissionItem]) -> None:
        """Find what in a mission cannot be flown."""
        self.problems = ()
        if items:
            executor, failsafe = self._controls.executor, self._failsafe
            self.problems = tuple(
                check_mission(
                    items,
                    executor.frame,
                    executor.spec,
                    needs_takeoff=not executor.sequencer.takes_off,
                    outside=failsafe.outside if failsafe.fence_enabled else None,
                )
            )

    def judge_again(self) -> str | None:
        """Judge the mission after fence or parameters have changed; a problem that is new, None for none."""
        if not self.items:
            return None
        before = self.problems
        self.judge(self.items)
        return self.problems[0] if self.problems and self.problems != before else None

    def progress(self, *, in_mode: bool) -> MissionState:
        """Progress of the mission; ``in_mode`` tells whether the vehicle is armed in the mission mode."""
        if not self.items or self.problems:
            return MissionState.NO_MISSION
        if self.complete:
            return MissionState.COMPLETE
        if not self.started:
            return MissionState.NOT_STARTED
        flying = in_mode and self._controls.state.phase is not FlightPhase.HOLD
        return MissionState.ACTIVE if flying else MissionState.PAUSED
