"""Flight mode, and the orders that follow from a mode change."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sim_vehicle.autopilot.modes import Mode
from sim_vehicle.execution.state import FlightPhase, LandedState
from sim_vehicle.pilot.controls import RefusedError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mission.model import MissionItem
    from sim_vehicle.pilot.controls import Controls
    from sim_vehicle.pilot.extra import PilotExtra
    from sim_vehicle.pilot.mission_status import MissionStatus

__all__ = ["ModeControl"]

# Modes that are not restored, after PX4's ``mode_requirements.cpp`` and ``UserModeIntention.cpp``.
_NOT_RESTORED = frozenset({Mode.RTL, Mode.LAND, Mode.TAKEOFF, Mode.FOLLOW})
_WITHOUT_POSITION = (Mode.MANUAL, Mode.ATTITUDE, Mode.FLIP)


class ModeControl:
    """Changes the mode and gives the vehicle the orders of the new mode."""

    def __init__(
        self,
        controls: Controls,
        mission: MissionStatus,
        extras: Sequence[PilotExtra],
    ) -> None:
        # Last mode that was ordered or followed from an order; the vehicle arms in this mode.
        self.intended = controls.mode
        # Whether the vehicle chose its mode itself, as a failsafe.
        self.by_itself = False
        # Altitude of the next take-off; None selects the vehicle's own.
        self.takeoff_altitude_m: float | None = None
        self._controls = controls
        self._mission = mission
        self._extras = extras
        self._left_mission: tuple[tuple[MissionItem, ...], int] | None = None

    def check(self, mode: Mode) -> None:
        """Raise RefusedError if the mode is not possible now."""
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
        """Return the reason of an extra against arming, or None."""
        reasons = (extra.why_not_arm(self._controls.mode) for extra in self._extras)
        return next((reason for reason in reasons if reason is not None), None)

    def change(self, mode: Mode) -> bool:
        """Change the mode and, if armed, begin the mode's flight; a refusal restores the old mode.

        Returns whether the vehicle must be disarmed: an order to land or return on the ground has that
        effect.
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
        """Change the mode without the orders of that mode."""
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
        """Mission and current item, to recognise a mission that is resumed."""
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
            self._fly_mission()
        elif mode is Mode.TAKEOFF:
            altitude_m = self.takeoff_altitude_m or controls.spec.takeoff_altitude_m
            self.takeoff_altitude_m = None
            controls.order(lambda: executor.takeoff(altitude_m))
        elif mode in (Mode.RTL, Mode.LAND):
            if on_ground:
                # A rover stays in place and armed.
                return not controls.spec.drives
            controls.order(executor.return_home if mode is Mode.RTL else executor.land)
        elif not on_ground or controls.state.phase is not FlightPhase.GROUND:
            controls.order(executor.flight.hold)
        for extra in self._extras:
            extra.start(mode)
        return False

    def _fly_mission(self) -> None:
        mission, executor = self._mission, self._controls.executor
        if mission.complete:
            executor.mission.set_current(0)
        mission.begin()
        self._controls.order(executor.start)
