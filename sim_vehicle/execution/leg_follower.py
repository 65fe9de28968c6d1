"""The flight of a plan of legs or of a velocity; the descent, and contact with the ground."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import TYPE_CHECKING

from sim_vehicle.airframe.power_spec import AIR_DENSITY_KG_M3, GRAVITY_M_S2
from sim_vehicle.autopilot import flight_procedures
from sim_vehicle.energy.battery import WH_J, BatteryMeter, remaining_fraction
from sim_vehicle.errors import VehicleError
from sim_vehicle.execution.state import (
    BatteryDepleted,
    Disarmed,
    FlightEvent,
    FlightPhase,
    Landed,
    LandedState,
    VehicleState,
)
from sim_vehicle.motion.legs import KEEP, Circle, Heading, Leg, LegKind, Route
from sim_vehicle.motion.model import attitude_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.legs import Position
    from sim_vehicle.motion.model import MotionModel, MotionState
    from sim_vehicle.weather.wind import Wind

# Speed, acceleration and jerk of a fall: those of a tumbling multirotor.
_FALL_M_S = 18.0
_FALL_M_S2 = 9.0
_FALL_M_S3 = 90.0


def drag_1_s(spec: VehicleSpec, airspeed_m_s: float) -> float:
    """Return the drag over mass and airspeed."""
    power = spec.power
    if power is None:
        return 0.0
    return 0.5 * AIR_DENSITY_KG_M3 * power.drag_area_m2 * airspeed_m_s / power.mass_kg


def require(able: bool, text: str) -> None:
    """Refuse an order that the vehicle cannot take."""
    if not able:
        raise VehicleError(text)


class AfterLastLeg(Enum):
    """Continuation after the last leg of a plan."""

    NEXT = "the next item"
    WAIT = "a pause"
    FOREVER = "nothing, it stays"
    TOUCHDOWN = "the ground"


@dataclass(slots=True)
class LegPlan:
    """Legs, and the mission items that they complete."""

    legs: list[Leg] = field(default_factory=list)
    seqs: list[int] = field(default_factory=list)
    """The item that each leg belongs to, -1 outside a mission."""
    done: list[bool] = field(default_factory=list)
    """Whether the leg completes its item."""
    speeds: list[float | None] = field(default_factory=list)
    """The ground speed that was set for the leg; a curve may be flown more slowly."""
    after_last: AfterLastLeg = AfterLastLeg.NEXT
    wait_s: float = 0.0
    """Of a WAIT; NaN until the time of day that the item names."""
    open: bool = False
    """Whether it was cut short, so it has to be planned again before its end."""
    unsure: bool = False
    """Whether something between its items waits for a condition, which may change it."""

    def add(self, leg: Leg, seq: int = -1, *, done: bool = False, speed: float | None = None) -> None:
        """Append a leg."""
        self.speeds.append(leg.speed_m_s if speed is None else speed)
        self.legs.append(leg)
        self.seqs.append(seq)
        self.done.append(done)

    def extend(
        self, legs: Sequence[Leg], seq: int = -1, *, done: bool = False, speed: float | None = None
    ) -> None:
        """Append legs, of which the last one may complete the item."""
        for leg in legs:
            self.add(leg, seq, done=done and leg is legs[-1], speed=speed)

    def prepend(self, leg: Leg, seq: int) -> None:
        """Put a leg before all others; it completes nothing."""
        self.legs.insert(0, leg)
        self.speeds.insert(0, leg.speed_m_s)
        self.seqs.insert(0, seq)
        self.done.insert(0, False)


@dataclass(slots=True)
class Waiting:
    """Items that wait in flight for a condition; they are dropped with the plan that is flown."""

    seqs: list[int] = field(default_factory=list)
    """The items, in order."""
    step: int | None = None
    """The step of the motion at which the first of them is due, where its condition is a time."""


class LegFollower:
    """Flies one plan of legs, or a velocity, at a time; holds, comes down, falls."""

    def __init__(self, spec: VehicleSpec, *, wind: Wind | None = None, yaw_rad: float = 0.0) -> None:
        self.spec = spec
        self.motion: MotionModel = flight_procedures(spec).motion(spec, wind, yaw_rad)
        self.armed = False
        self.phase = FlightPhase.GROUND
        self.landed = LandedState.ON_GROUND
        # The plan that is flown, the start of its first leg, and the number of its legs that were completed.
        self.plan: LegPlan | None = None
        self.began_m: Position = (0.0, 0.0, 0.0)
        self.flown = 0
        # Steps of the motion at which a pause ends, and at which the motors stop.
        self.timer: int | None = None
        self.disarm_step: int | None = None
        self.waiting = Waiting()
        self.battery_meter = BatteryMeter(spec.battery) if spec.battery is not None else None
        self._events: list[FlightEvent] = []

    @property
    def time_s(self) -> float:
        """The time that the vehicle was advanced to, on its grid of steps."""
        return self.motion.time_s

    def hold(self) -> None:
        """Stop and stay; `start` resumes a mission."""
        if self.landed is LandedState.ON_GROUND:
            self.drop_plan(FlightPhase.GROUND)
            return
        self.check_power("hold")
        x, y, z = self.motion.stopping_point()
        speed = self.spec.cruise_speed_m_s if self.spec.circles else self.spec.top_speed_m_s
        self.fly([Leg((x, y, z), speed, heading=KEEP, kind=LegKind.STAY)], FlightPhase.HOLD)

    def look_at(self, position_m: tuple[float, float] | None) -> None:
        """Point the nose at a position (east, north) on any leg; None ends that."""
        self.motion.look_at(position_m)

    def fall(self) -> None:
        """Lose the thrust: the vehicle comes down at once and can do nothing more."""
        if self.landed is LandedState.ON_GROUND:
            self.stop_motors()
            self.emit(Disarmed(self.time_s))
            return
        self.drop_plan(FlightPhase.FALLING)
        self.look_at(None)
        if self.spec.is_ideal:
            x, y, _ = self.motion.position_m
            down = Leg((x, y, 0.0), self.spec.cruise_speed_m_s, heading=KEEP, kind=LegKind.LAND)
            self.fly([down], FlightPhase.FALLING, AfterLastLeg.TOUCHDOWN)
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

    def change_battery(self) -> None:
        """Put a full battery in; nothing while the motors are on."""
        if self.spec.battery is not None and not self.armed:
            self.motion.use_energy(-self.motion.energy_j)
            self.battery_meter = BatteryMeter(self.spec.battery)

    def stop_motors(self) -> None:
        """Disarm on the ground."""
        self.armed = False
        self.disarm_step = None
        self.drop_plan(FlightPhase.GROUND)

    def keep_velocity(self, velocity_m_s: Position, *, height_m: float, heading: Heading) -> None:
        """Keep a velocity until something else is flown; sinking ends with touch-down."""
        self.motion.set_climb(None, None)
        self._keep_velocity(velocity_m_s, height_m=height_m, heading=heading)
        self.phase = FlightPhase.STEERED
        self.timer = None
        self.waiting = Waiting()

    def check_power(self, what: str) -> None:
        """Refuse an order to a vehicle that is lost."""
        reason = "the battery is empty" if self.phase is FlightPhase.DEPLETED else "the vehicle is falling"
        require(not self.phase.is_lost, f"cannot {what}: {reason}")

    def ready(self, what: str) -> None:
        """Refuse an order to a vehicle that is not armed, or lost."""
        require(self.armed, f"cannot {what}: not armed")
        self.check_power(what)

    def fly(
        self,
        legs: Sequence[Leg],
        phase: FlightPhase,
        after_last: AfterLastLeg = AfterLastLeg.NEXT,
    ) -> None:
        """Fly legs from here, at the vehicle's own vertical speeds."""
        plan = LegPlan(after_last=after_last)
        plan.extend(legs)
        self.drop_plan(phase)
        self.motion.set_climb(None, None)
        self.begin(plan)

    def _keep_velocity(
        self,
        velocity_m_s: Position,
        *,
        height_m: float = math.nan,
        heading: Heading = KEEP,
    ) -> None:
        """Keep a velocity; the plan has one leg, which ends on the ground if anywhere."""
        self.motion.steer(velocity_m_s, height_m=height_m, heading=heading)
        self.plan = LegPlan(after_last=AfterLastLeg.TOUCHDOWN)
        self.plan.add(Leg(self.motion.position_m, 0.0, heading=heading))
        self.flown = 0
        self._airborne()

    def state_at(self, current_seq: int) -> VehicleState:
        """Read the state of the vehicle, which is at a mission item (-1 without a mission)."""
        motion = self.motion
        now, time_s = motion.snapshot(), motion.time_s
        wind_x, wind_y = now.wind_m_s
        air = (now.velocity_m_s[0] - wind_x, now.velocity_m_s[1] - wind_y)
        airspeed = math.sqrt(air[0] * air[0] + air[1] * air[1])
        roll = pitch = 0.0
        throttle = 0.5
        attitude = motion.attitude()
        if attitude is not None:
            roll, pitch, airspeed, throttle = attitude
        elif self.landed is not LandedState.ON_GROUND and not self.spec.is_ideal:
            roll, pitch = self._attitude(now, air, airspeed)
        meter = self.battery_meter
        battery = meter.read(time_s, now.energy_j, now.power_w) if meter is not None else None
        return VehicleState(
            time_s=time_s,
            position_m=now.position_m,
            velocity_m_s=now.velocity_m_s,
            acceleration_m_s2=now.acceleration_m_s2,
            roll_rad=roll,
            pitch_rad=pitch,
            yaw_rad=now.heading_rad,
            yaw_rate_rad_s=now.yaw_rate_rad_s,
            airspeed_m_s=airspeed,
            wind_m_s=now.wind_m_s,
            power_w=now.power_w,
            battery=battery,
            path_length_m=now.path_length_m,
            armed=self.armed,
            landed=self.landed,
            phase=self.phase,
            current_seq=current_seq,
            throttle=throttle,
        )

    def _attitude(self, now: MotionState, air: tuple[float, float], airspeed: float) -> tuple[float, float]:
        """Roll and pitch whose thrust gives the acceleration and holds against the drag of the air."""
        drag = drag_1_s(self.spec, airspeed)
        ax, ay, az = now.acceleration_m_s2
        east, north = ax + drag * air[0], ay + drag * air[1]
        return attitude_of(east, north, GRAVITY_M_S2 + az, now.heading_rad)

    def drop_plan(self, phase: FlightPhase) -> None:
        """Fly no plan any more, and forget the items that wait for conditions."""
        self.plan = None
        self.timer = None
        self.waiting = Waiting()
        self.phase = phase

    def begin(self, plan: LegPlan) -> None:
        """Begin a plan; items that wait for a condition go on waiting."""
        self.plan = plan
        self.flown = 0
        self.timer = None
        self.began_m = self.motion.position_m
        self.motion.fly(Route.through(plan.legs))
        self._airborne()
        if plan.after_last is AfterLastLeg.TOUCHDOWN and plan.legs[0].descends:
            self.descend()

    def _airborne(self) -> None:
        if self.landed is LandedState.ON_GROUND:
            self.landed = LandedState.IN_AIR if self.spec.drives else LandedState.TAKEOFF
        elif self.landed is LandedState.LANDING:
            self.landed = LandedState.IN_AIR

    def descend(self) -> None:
        """Note that the last part of the descent has begun."""
        self.landed = LandedState.LANDING
        if self.phase is FlightPhase.RETURN:
            self.phase = FlightPhase.LAND

    def take_events(self) -> list[FlightEvent]:
        """Take the events since the last call, in order."""
        events, self._events = self._events, []
        return events

    def emit(self, event: FlightEvent) -> None:
        """Add an event."""
        self._events.append(event)

    def disarm_later(self) -> None:
        """Let the motors stop after the delay of the vehicle."""
        self.disarm_step = self.motion.step + round(self.spec.disarm_delay_s / self.motion.step_s)

    def touch_down(self) -> None:
        """Come to rest on the ground."""
        if self.phase is FlightPhase.FALLING:
            self.motion.update_spec(self.spec)
        self.motion.touch_down()
        self.landed = LandedState.ON_GROUND
        self.plan = None
        self.emit(Landed(self.time_s))

    def drain_on_ground(self) -> None:
        """Disarm when the idling motors have emptied the battery."""
        battery = self.spec.battery
        if self.armed and battery is not None and remaining_fraction(battery, self.motion.energy_j) <= 0.0:
            self.emit(BatteryDepleted(self.time_s))
            self.stop_motors()
            self.emit(Disarmed(self.time_s))

    def deplete(self) -> None:
        """Come down where it is: nothing else is possible any more."""
        self.motion.ignore_energy()
        self.motion.lose_power()
        self.emit(BatteryDepleted(self.time_s))
        if self.phase is FlightPhase.FALLING:
            return
        x, y, _ = self.motion.stopping_point()
        # A fixed wing comes down on a circle.
        down = Leg((x, y, 0.0), self.spec.cruise_speed_m_s, heading=KEEP, kind=LegKind.LAND, circle=Circle())
        self.fly([down], FlightPhase.DEPLETED, AfterLastLeg.TOUCHDOWN)
        self.landed = LandedState.LANDING
