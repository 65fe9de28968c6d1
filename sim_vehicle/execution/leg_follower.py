"""The vehicle under direct control: it flies legs or a velocity, holds, comes down, falls."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from sim_vehicle.autopilot import flight_procedures
from sim_vehicle.energy.battery import WH_J, BatteryMeter, remaining_fraction
from sim_vehicle.errors import VehicleError
from sim_vehicle.execution.items import Ending, Itinerary
from sim_vehicle.execution.state import BatteryDepleted, Disarmed, FlightEvent, Landed, LandedState, Phase
from sim_vehicle.motion.legs import KEEP, Circle, Heading, Leg, LegKind, Route

if TYPE_CHECKING:
    from collections.abc import Sequence

    from geo.frame import LocalFrame
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.legs import Position
    from sim_vehicle.motion.model import MotionModel
    from sim_vehicle.weather.wind import Wind

# Without thrust: as fast as a tumbling multirotor falls.
_FALL_M_S = 18.0
_FALL_M_S2 = 9.0
_FALL_M_S3 = 90.0


class Craft:
    """The innermost part of `sim_vehicle.execution.executor.MissionExecutor`: one plan of legs at a time."""

    def __init__(
        self, spec: VehicleSpec, frame: LocalFrame, *, wind: Wind | None = None, yaw_rad: float = 0.0
    ) -> None:
        self.spec = spec
        self.frame = frame
        self.armed = False
        self.phase = Phase.GROUND
        self.landed = LandedState.ON_GROUND
        self.home_m = (0.0, 0.0)
        self.rally_m: tuple[Position, ...] = ()
        self.motion: MotionModel = flight_procedures(spec).motion(spec, wind, yaw_rad)
        self._meter = BatteryMeter(spec.battery) if spec.battery is not None else None
        self._plan: Itinerary | None = None
        self._flown = 0
        self._timer: int | None = None
        self._disarm_step: int | None = None
        self._events: list[FlightEvent] = []

    @property
    def time_s(self) -> float:
        """The time that the vehicle was advanced to, on its grid of steps."""
        return self.motion.time_s

    def hold(self) -> None:
        """Stop and stay; `start` resumes a mission."""
        if self.landed is LandedState.ON_GROUND:
            self._drop_plan(Phase.GROUND)
            return
        self._check_power("hold")
        x, y, z = self.motion.stopping_point()
        circles = self.spec.kind == "fixed-wing"
        speed = self.spec.cruise_speed_m_s if circles else self.spec.top_speed_m_s
        self._fly([Leg((x, y, z), speed, heading=KEEP, kind=LegKind.STAY)], Phase.HOLD)

    def look_at(self, position_m: tuple[float, float] | None) -> None:
        """Point the nose at a position (east, north) whatever is flown, None for no more."""
        self.motion.look_at(position_m)

    def fall(self) -> None:
        """Lose the thrust: the vehicle comes down at once and can do nothing more."""
        if self.landed is LandedState.ON_GROUND:
            self.armed = False
            self._drop_plan(Phase.GROUND)
            self._disarm_step = None
            self._tell(Disarmed(self.time_s))
            return
        self._drop_plan(Phase.FALLING)
        self.look_at(None)
        if self.spec.is_ideal:
            x, y, _ = self.motion.position_m
            down = Leg((x, y, 0.0), self.spec.cruise_speed_m_s, heading=KEEP, kind=LegKind.LAND)
            self._fly([down], Phase.FALLING, Ending.TOUCHDOWN)
            return
        self.motion.update_spec(
            replace(
                self.spec,
                descent_speed_m_s=_FALL_M_S,
                landing_speed_m_s=_FALL_M_S,
                vertical_acceleration_m_s2=_FALL_M_S2,
                vertical_jerk_m_s3=_FALL_M_S3,
            )
        )
        self._keep_velocity((0.0, 0.0, -_FALL_M_S), heading=Heading.turning(self.spec.yaw_rate_rad_s))
        self.landed = LandedState.LANDING

    def drain_battery(self, fraction: float) -> None:
        """Leave no more than this fraction in the battery; nothing for a vehicle without one."""
        battery = self.spec.battery
        if battery is not None:
            used = (1.0 - min(max(fraction, 0.0), 1.0)) * battery.capacity_wh * WH_J
            self.motion.use_energy(max(0.0, used - self.motion.energy_j))

    def haven(self) -> Position:
        """Return where it returns to, home or the nearest rally point, and the least height of the way."""
        x, y, _ = self.motion.position_m
        places = ((*self.home_m, 0.0), *self.rally_m)
        return min(places, key=lambda place: math.hypot(place[0] - x, place[1] - y))

    def _check_power(self, what: str) -> None:
        if self.phase.is_lost:
            reason = "the battery is empty" if self.phase is Phase.DEPLETED else "the vehicle is falling"
            raise VehicleError(f"cannot {what}: {reason}")

    def _fly(
        self,
        legs: Sequence[Leg],
        phase: Phase,
        ending: Ending = Ending.NEXT,
    ) -> None:
        plan = Itinerary(ending=ending)
        for leg in legs:
            plan.add(leg)
        self._drop_plan(phase)
        self.motion.set_climb(None, None)
        self._begin(plan)

    def _keep_velocity(
        self,
        velocity_m_s: Position,
        *,
        height_m: float = math.nan,
        heading: Heading = KEEP,
    ) -> None:
        """Keep a velocity; the plan has one leg, which ends on the ground if anywhere."""
        self.motion.steer(velocity_m_s, height_m=height_m, heading=heading)
        self._plan = Itinerary(ending=Ending.TOUCHDOWN)
        self._plan.add(Leg(self.motion.position_m, 0.0, heading=heading))
        self._flown = 0
        self._airborne()

    def _drop_plan(self, phase: Phase) -> None:
        self._plan = None
        self._timer = None
        self.phase = phase

    def _begin(self, plan: Itinerary) -> None:
        self._plan = plan
        self._flown = 0
        self._timer = None
        self.motion.fly(Route.through(plan.legs))
        self._airborne()
        if plan.ending is Ending.TOUCHDOWN and plan.legs[0].descends:
            self._descend()

    def _airborne(self) -> None:
        if self.landed is LandedState.ON_GROUND:
            self.landed = LandedState.IN_AIR if self.spec.kind == "rover" else LandedState.TAKEOFF
        elif self.landed is LandedState.LANDING:
            self.landed = LandedState.IN_AIR

    def _descend(self) -> None:
        self.landed = LandedState.LANDING
        if self.phase is Phase.RETURN:
            self.phase = Phase.LAND

    def _take_events(self) -> list[FlightEvent]:
        events, self._events = self._events, []
        return events

    def _tell(self, event: FlightEvent) -> None:
        self._events.append(event)

    def _disarm_later(self) -> None:
        self._disarm_step = self.motion.step + round(self.spec.disarm_delay_s / self.motion.step_s)

    def _ground(self) -> None:
        if self.phase is Phase.FALLING:
            self.motion.update_spec(self.spec)
        self.motion.touch_down()
        self.landed = LandedState.ON_GROUND
        self._plan = None
        self._tell(Landed(self.time_s))

    def _drain_on_ground(self) -> None:
        battery = self.spec.battery
        if self.armed and battery is not None and remaining_fraction(battery, self.motion.energy_j) <= 0.0:
            self._tell(BatteryDepleted(self.time_s))
            self.armed = False
            self._drop_plan(Phase.GROUND)
            self._disarm_step = None
            self._tell(Disarmed(self.time_s))

    def _deplete(self) -> None:
        """Come down where it is: nothing else is possible any more."""
        self.motion.ignore_energy()
        self.motion.lose_power()
        self._tell(BatteryDepleted(self.time_s))
        if self.phase is Phase.FALLING:
            return
        x, y, _ = self.motion.stopping_point()
        # A fixed wing comes down on a circle.
        down = Leg((x, y, 0.0), self.spec.cruise_speed_m_s, heading=KEEP, kind=LegKind.LAND, circle=Circle())
        self._fly([down], Phase.DEPLETED, Ending.TOUCHDOWN)
        self.landed = LandedState.LANDING
