"""Mode and mission of a pilot: orders of a mode, problems and progress of the mission, hooks for add-ons."""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING

from mission.model import Command
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.execution.items import ItemProblem, check_mission
from sim_vehicle.execution.state import FlightPhase, LandedState
from sim_vehicle.pilot.controls import MissionState, RefusedError, Severity

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from mission.model import MissionItem
    from sim_vehicle.autopilot.stick_rules import Sticks
    from sim_vehicle.pilot.controls import Controls
    from sim_vehicle.pilot.failsafe import Failsafe, Reaction

# Modes that PX4 does not restore (``mode_requirements.cpp``, ``UserModeIntention.cpp``).
_NOT_RESTORED = frozenset({Mode.RTL, Mode.LAND, Mode.TAKEOFF, Mode.FOLLOW})
_WITHOUT_POSITION = (Mode.MANUAL, Mode.ATTITUDE, Mode.FLIP)


class MissionChange(Enum):
    """Effect of a new mission on the vehicle."""

    STORED = "stored without effect on the flight"
    TURNED = "the vehicle turned to the present item of the new mission"
    LATER = "the vehicle completes the present item first"
    LOST = "the vehicle completes the present item, which the new mission lacks; then the mission ends"


class MissionStatus:
    """Status of the mission that is loaded."""

    def __init__(self, controls: Controls, failsafe: Failsafe) -> None:
        # Reasons why the mission cannot be flown.
        self.problems: tuple[ItemProblem, ...] = ()
        # Whether the mission was begun since arming, whether it is complete, and whether only the return
        # remains; PX4 does not count a final return as a part of the mission.
        self.started = self.complete = self.returns = False
        self._chosen = False
        self._in_air = False
        self._controls = controls
        self._failsafe = failsafe

    @property
    def waits(self) -> bool:
        """Whether the mission is complete, or a client has chosen the item at which it will restart."""
        return self.complete or self._chosen

    def choose(self) -> None:
        """Record that the current item was chosen; a complete mission may restart at this item."""
        self._chosen = self.waits or self.returns
        self.complete = self.returns = False

    def begin(self) -> None:
        """Record that the vehicle begins or resumes the mission."""
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
        """Update the problems of a mission; with `in_air`, the mission needs no take-off item."""
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
        """Return the reason why the mission cannot begin now; in the air it needs no take-off item."""
        controls = self._controls
        in_air = controls.landed is not LandedState.ON_GROUND
        if self.problems and in_air and not self._in_air:
            self.check(self.items, in_air=True)
        first = self.items[0].command if self.items else None
        if self.why_not is not None and not in_air and first != Command.NAV_TAKEOFF:
            controls.note(Severity.CRITICAL, controls.behaviour.no_takeoff_text)
        return self.why_not

    def check_on_ground(self) -> None:
        """If the mission was uploaded in flight, check it again for a start on the ground."""
        if self._in_air:
            self.check(self.items)

    def check_again(self) -> ItemProblem | None:
        """Check the mission after fence or parameters have changed; return a new problem, or None."""
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


class PilotExtra:
    """Part of a pilot that an add-on provides; a subclass overrides the methods that it needs."""

    @property
    def sticks(self) -> Sticks | None:
        """Positions of the sticks, or None while no sticks are received."""
        return None

    @property
    def throttle_down(self) -> bool:
        """Whether no stick demands thrust."""
        return True

    def why_not_enter(self, mode: Mode) -> str | None:
        """Return the reason why a mode cannot be entered now, or None."""
        return None

    def why_not_arm(self, mode: Mode) -> str | None:
        """Return the reason that prevents arming in this mode, or None."""
        return None

    def on_armed(self) -> None:
        """Reset the extra when the vehicle arms."""

    def check(self) -> Iterable[Reaction]:
        """Yield the reactions of failsafes in flight; each is carried out before the next one is taken."""
        return ()

    def start(self, mode: Mode) -> None:
        """Give the orders of a mode; if this raises RefusedError, the caller restores the previous mode."""

    def begin(self, mode: Mode, before: Mode) -> None:
        """Begin the flight in a mode that the armed vehicle has just entered from the mode `before`."""

    def fly_on(self) -> None:
        """Continue the flight of an armed vehicle in its mode."""

    def stop(self) -> None:
        """Stop the orders of this extra, because another order now flies the vehicle."""

    def forget(self) -> None:
        """Forget the order that the vehicle carries out, because the mode may change."""

    def free_heading(self) -> None:
        """Stop turning the nose, because another order now decides the heading."""


class ModeControl:
    """Control of the mode: it changes the mode, and gives the vehicle the orders of the new mode."""

    def __init__(
        self,
        controls: Controls,
        mission: MissionStatus,
        extras: Sequence[PilotExtra],
    ) -> None:
        # Last mode that was ordered, or that followed from an order; the vehicle arms in this mode.
        self.intended = controls.mode
        # Whether the vehicle chose its mode itself, for example by a failsafe.
        self.by_itself = False
        # Altitude of the next take-off; None selects the vehicle's default.
        self.takeoff_altitude_m: float | None = None
        self._controls = controls
        self._mission = mission
        self._extras = extras
        self._left_mission: tuple[tuple[MissionItem, ...], int] | None = None

    def check(self, mode: Mode) -> None:
        """Raise RefusedError if the vehicle cannot enter the mode now."""
        controls = self._controls
        if controls.state.phase.is_lost:
            why = "battery empty" if controls.state.phase is FlightPhase.DEPLETED else "falling"
            raise RefusedError(f"Mode {mode.value} refused: {why}")
        if controls.rules.any_mode_disarmed and not controls.armed:
            return
        if mode is Mode.MISSION and (problem := self._mission.why_not_begin()) is not None:
            raise RefusedError(f"Mission mode refused: {problem}")
        if mode not in _WITHOUT_POSITION and not controls.position_ok:
            raise RefusedError(f"Mode {mode.value} refused: no position")
        for extra in self._extras:
            if (reason := extra.why_not_enter(mode)) is not None:
                raise RefusedError(f"Mode {mode.value} refused: {reason}")

    def why_not_arm(self) -> str | None:
        """Return the first reason for which an extra prevents arming, or None."""
        reasons = (extra.why_not_arm(self._controls.mode) for extra in self._extras)
        return next((reason for reason in reasons if reason is not None), None)

    def change(self, mode: Mode) -> bool:
        """Change the mode and, if armed, begin the mode's flight; a refusal restores the old mode.

        Return whether the vehicle must be disarmed, because it was ordered to land or return while on the
        ground.
        """
        before, intended = self._controls.mode, self.intended
        for extra in self._extras:
            extra.stop()
        self.override(mode)
        if not self._controls.armed:
            return False
        try:
            is_down = self._fly(mode)
        except RefusedError:
            self._controls.mode, self.intended = before, intended
            raise
        for extra in self._extras:
            extra.begin(mode, before)
        return is_down

    def override(self, mode: Mode) -> None:
        """Change the mode without giving the orders of the new mode."""
        for extra in self._extras:
            extra.forget()
        self.by_itself = False
        controls, behaviour = self._controls, self._controls.behaviour
        if mode is not controls.mode and controls.landed is not LandedState.ON_GROUND:
            if mode in behaviour.forgets_speed_in:
                controls.executor.mission.reset_speed()
            elif mode is Mode.MISSION and behaviour.replays_speed:
                controls.executor.mission.replay_speed()
            if mode is Mode.MISSION and behaviour.rewinds_survey and self._left_mission == self._present_item:
                controls.executor.mission.rewind_survey()
            if controls.mode is Mode.MISSION:
                self._left_mission = self._present_item
        controls.mode = mode
        if mode not in _NOT_RESTORED:
            self.intended = mode

    @property
    def _present_item(self) -> tuple[tuple[MissionItem, ...], int]:
        """Mission and current item, for a later check whether the vehicle resumes the same mission."""
        return self._mission.items, self._controls.executor.mission.current_seq

    def on_target_reached(self) -> None:
        """Enter the mode that follows a take-off."""
        if self._controls.mode is Mode.TAKEOFF:
            self._controls.mode = self.intended = self._controls.firmware.mavlink.modes.after_takeoff

    def _fly(self, mode: Mode) -> bool:
        controls = self._controls
        executor = controls.executor
        on_ground = controls.landed is LandedState.ON_GROUND
        if mode is Mode.MISSION:
            if self._mission.complete:
                executor.mission.set_current(0)
            self._mission.begin()
            controls.order(executor.start)
        elif mode is Mode.TAKEOFF:
            altitude_m = self.takeoff_altitude_m or controls.spec.takeoff_altitude_m
            self.takeoff_altitude_m = None
            controls.order(lambda: executor.takeoff(altitude_m))
        elif mode in (Mode.RTL, Mode.LAND):
            if on_ground:
                # A rover stays where it is, and stays armed.
                return not controls.spec.drives
            controls.order(executor.return_home if mode is Mode.RTL else executor.land)
        elif not on_ground or controls.state.phase is not FlightPhase.GROUND:
            controls.order(executor.flight.hold)
        for extra in self._extras:
            extra.start(mode)
        return False
