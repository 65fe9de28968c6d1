"""The flight mode, and what the vehicle does when it is taken."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sim_vehicle.autopilot.modes import Mode
from sim_vehicle.execution.state import FlightPhase, LandedState
from sim_vehicle.pilot.controls import RefusedError

if TYPE_CHECKING:
    from mission.model import MissionItem
    from sim_vehicle.pilot.controls import Controls
    from sim_vehicle.pilot.guided import SetpointFollower
    from sim_vehicle.pilot.mission_status import MissionStatus

__all__ = ["ModeControl"]

# PX4's ``mode_requirements.cpp`` (prevent_arming) and ``UserModeIntention.cpp``: not gone back to.
_LEADS_DOWN_OR_UP = frozenset({Mode.RTL, Mode.LAND, Mode.TAKEOFF})


class ModeControl:
    """Takes modes and gives the vehicle the orders that they stand for."""

    def __init__(self, controls: Controls, mission: MissionStatus, setpoints: SetpointFollower) -> None:
        # The last one that was ordered, or followed from an order, and in which a vehicle arms.
        self.intended = controls.mode
        # Whether the vehicle took it by its own decision.
        self.by_itself = False
        # Of the next take-off; None is the vehicle's own.
        self.takeoff_altitude_m: float | None = None
        self._controls = controls
        self._mission = mission
        self._setpoints = setpoints
        self._left: tuple[tuple[MissionItem, ...], int] | None = None

    def change(self, mode: Mode) -> bool:
        """Take a mode and, armed, do what it means; the mode is as it was when that cannot be done.

        Tells whether the vehicle is to be disarmed: it is told to land or return, and on the ground already.
        """
        before, intended = self._controls.mode, self.intended
        self.override(mode)
        if not self._controls.armed:
            return False
        try:
            return self._fly(mode)
        except RefusedError:
            self._controls.mode, self.intended = before, intended
            raise

    def override(self, mode: Mode) -> None:
        """Take a mode in which something else is flown than the mode's own."""
        self._setpoints.forget()
        self.by_itself = False
        controls, behaviour = self._controls, self._controls.behaviour
        if mode is not controls.mode and controls.landed is not LandedState.ON_GROUND:
            if mode in behaviour.forgets_speed_in:
                controls.executor.mission.reset_speed()
            elif mode is Mode.MISSION and behaviour.replays_speed:
                controls.executor.mission.replay_speed()
            if mode is Mode.MISSION and behaviour.rewinds_survey and self._left == self._present_item:
                controls.executor.mission.rewind_survey()
            if controls.mode is Mode.MISSION:
                self._left = self._present_item
        controls.mode = mode
        if mode not in _LEADS_DOWN_OR_UP:
            self.intended = mode

    @property
    def _present_item(self) -> tuple[tuple[MissionItem, ...], int]:
        """The mission and its current item, where it is left and gone on with."""
        return self._mission.items, self._controls.executor.mission.current_seq

    def on_target_reached(self) -> None:
        """Go on to the mode that follows a take-off."""
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
                # A rover stands where it is, and stays armed.
                return not controls.spec.drives
            controls.order(executor.return_home if mode is Mode.RTL else executor.land)
        elif not on_ground or controls.state.phase is not FlightPhase.GROUND:
            controls.order(executor.flight.hold)
        if mode is Mode.GUIDED:
            controls.order(self._setpoints.begin)
        return False

    def _fly_mission(self) -> None:
        mission, executor = self._mission, self._controls.executor
        if mission.complete:
            executor.mission.set_current(0)
        mission.begin()
        self._controls.order(executor.start)
