"""Flight along planned legs or at a commanded velocity, with descent and touch-down."""

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

# Speed, acceleration and jerk of a falling vehicle, like those of a tumbling multirotor.
_FALL_M_S = 18.0
_FALL_M_S2 = 9.0
_FALL_M_S3 = 90.0


def drag_1_s(spec: VehicleSpec, airspeed_m_s: float) -> float:
    """Return the drag force divided by mass and airspeed (1/s)."""
    power = spec.power
    if power is None:
        return 0.0
    return 0.5 * AIR_DENSITY_KG_M3 * power.drag_area_m2 * airspeed_m_s / power.mass_kg


def require(able: bool, text: str) -> None:
    """Raise VehicleError with `text` unless `able` is true."""
    if not able:
        raise VehicleError(text)


class AfterLastLeg(Enum):
    """Action after the last leg of a plan."""

    NEXT = "the next item"
    WAIT = "a pause"
    FOREVER = "an endless hold"
    TOUCHDOWN = "the ground"


@dataclass(slots=True)
class LegPlan:
    """Legs to fly, with the mission item of each leg."""

    legs: list[Leg] = field(default_factory=list)
    seqs: list[int] = field(default_factory=list)
    """Item index of each leg; -1 outside a mission."""
    done: list[bool] = field(default_factory=list)
    """Whether the leg completes its item."""
    speeds: list[float | None] = field(default_factory=list)
    """Commanded ground speed of each leg; a curve may be flown more slowly."""
    after_last: AfterLastLeg = AfterLastLeg.NEXT
    wait_s: float = 0.0
    """Length of the pause if `after_last` is WAIT; NaN for a pause until the item's time of day."""
    open: bool = False
    """Whether the plan was cut short and must be extended before its end."""
    unsure: bool = False
    """Whether a command between the items of the plan may change the plan."""

    def add(self, leg: Leg, seq: int = -1, *, done: bool = False, speed: float | None = None) -> None:
        """Append a leg."""
        self.speeds.append(leg.speed_m_s if speed is None else speed)
        self.legs.append(leg)
        self.seqs.append(seq)
        self.done.append(done)

    def extend(
        self, legs: Sequence[Leg], seq: int = -1, *, done: bool = False, speed: float | None = None
    ) -> None:
        """Append legs. With `done`, the item is complete after the last leg."""
        for leg in legs:
            self.add(leg, seq, done=done and leg is legs[-1], speed=speed)

    def prepend(self, leg: Leg, seq: int) -> None:
        """Insert a leg at the front; no item is complete after this leg."""
        self.legs.insert(0, leg)
        self.speeds.insert(0, leg.speed_m_s)
        self.seqs.insert(0, seq)
        self.done.insert(0, False)


@dataclass(slots=True)
class Waiting:
    """Items that wait in flight for a condition; they are discarded together with the plan."""

    seqs: list[int] = field(default_factory=list)
    """Indices of the waiting items, in order."""
    step: int | None = None
    """Motion step at which the first waiting item is due; None if it does not wait for a time."""


class LegFollower:
    """Vehicle in flight: it follows a plan of legs or a velocity, holds, lands and falls."""

    def __init__(self, spec: VehicleSpec, *, wind: Wind | None = None, yaw_rad: float = 0.0) -> None:
        self.spec = spec
        self.motion: MotionModel = flight_procedures(spec).motion(spec, wind, yaw_rad)
        self.armed = False
        self.phase = FlightPhase.GROUND
        self.landed = LandedState.ON_GROUND
        # The present plan, the start of its first leg, and the number of its completed legs.
        self.plan: LegPlan | None = None
        self.began_m: Position = (0.0, 0.0, 0.0)
        self.flown = 0
        # Motion steps at which a pause ends and at which the motors stop.
        self.timer: int | None = None
        self.disarm_step: int | None = None
        self.waiting = Waiting()
        self.battery_meter = BatteryMeter(spec.battery) if spec.battery is not None else None
        self._events: list[FlightEvent] = []

    @property
    def time_s(self) -> float:
        """Simulated time (s); it is a multiple of the time step."""
        return self.motion.time_s

    def hold(self) -> None:
        """Stop and hold the position; `start` resumes a mission."""
        if self.landed is LandedState.ON_GROUND:
            self.drop_plan(FlightPhase.GROUND)
            return
        self.check_power("hold")
        x, y, z = self.motion.stopping_point()
        speed = self.spec.cruise_speed_m_s if self.spec.circles else self.spec.top_speed_m_s
        self.fly([Leg((x, y, z), speed, heading=KEEP, kind=LegKind.STAY)], FlightPhase.HOLD)

    def look_at(self, position_m: tuple[float, float] | None) -> None:
        """Point the nose at a position (east, north) on all legs; None ends this."""
        self.motion.look_at(position_m)

    def fall(self) -> None:
        """Lose all thrust: the vehicle falls at once and obeys no further orders."""
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
        """Reduce the remaining energy to at most this fraction; do nothing without a battery."""
        battery = self.spec.battery
        if battery is not None:
            used = (1.0 - min(max(fraction, 0.0), 1.0)) * battery.capacity_wh * WH_J
            self.motion.use_energy(max(0.0, used - self.motion.energy_j))

    def change_battery(self) -> None:
        """Install a full battery; do nothing while the motors run."""
        if self.spec.battery is not None and not self.armed:
            self.motion.use_energy(-self.motion.energy_j)
            self.battery_meter = BatteryMeter(self.spec.battery)

    def stop_motors(self) -> None:
        """Disarm the vehicle on the ground."""
        self.armed = False
        self.disarm_step = None
        self.drop_plan(FlightPhase.GROUND)

    def keep_velocity(self, velocity_m_s: Position, *, height_m: float, heading: Heading) -> None:
        """Keep a velocity until the next order; a descent ends with touch-down."""
        self.motion.set_climb(None, None)
        self._keep_velocity(velocity_m_s, height_m=height_m, heading=heading)
        self.phase = FlightPhase.STEERED
        self.timer = None
        self.waiting = Waiting()

    def check_power(self, what: str) -> None:
        """Raise VehicleError if the vehicle is falling or has no power."""
        reason = "the battery is empty" if self.phase is FlightPhase.DEPLETED else "the vehicle is falling"
        require(not self.phase.is_lost, f"cannot {what}: {reason}")

    def ready(self, what: str) -> None:
        """Raise VehicleError unless the vehicle is armed and under control."""
        require(self.armed, f"cannot {what}: not armed")
        self.check_power(what)

    def fly(
        self,
        legs: Sequence[Leg],
        phase: FlightPhase,
        after_last: AfterLastLeg = AfterLastLeg.NEXT,
    ) -> None:
        """Fly legs from the present position, at the vehicle's default vertical speeds."""
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
        """Keep a velocity; the plan has a single leg, which only touch-down ends."""
        self.motion.steer(velocity_m_s, height_m=height_m, heading=heading)
        self.plan = LegPlan(after_last=AfterLastLeg.TOUCHDOWN)
        self.plan.add(Leg(self.motion.position_m, 0.0, heading=heading))
        self.flown = 0
        self._airborne()

    def state_at(self, current_seq: int) -> VehicleState:
        """Return the state of the vehicle with `current_seq` as its mission item (-1 without a mission)."""
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
        """Return the roll and pitch at which the thrust causes the acceleration and balances the drag."""
        drag = drag_1_s(self.spec, airspeed)
        ax, ay, az = now.acceleration_m_s2
        east, north = ax + drag * air[0], ay + drag * air[1]
        return attitude_of(east, north, GRAVITY_M_S2 + az, now.heading_rad)

    def drop_plan(self, phase: FlightPhase) -> None:
        """Discard the plan and the items that wait for conditions."""
        self.plan = None
        self.timer = None
        self.waiting = Waiting()
        self.phase = phase

    def begin(self, plan: LegPlan) -> None:
        """Begin a plan; items that wait for a condition keep waiting."""
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
        """Record that the final descent has begun."""
        self.landed = LandedState.LANDING
        if self.phase is FlightPhase.RETURN:
            self.phase = FlightPhase.LAND

    def take_events(self) -> list[FlightEvent]:
        """Return the events since the last call, in order."""
        events, self._events = self._events, []
        return events

    def emit(self, event: FlightEvent) -> None:
        """Append an event."""
        self._events.append(event)

    def disarm_later(self) -> None:
        """Schedule disarming after the vehicle's disarm delay."""
        self.disarm_step = self.motion.step + round(self.spec.disarm_delay_s / self.motion.step_s)

    def touch_down(self) -> None:
        """Put the vehicle at rest on the ground."""
        if self.phase is FlightPhase.FALLING:
            self.motion.update_spec(self.spec)
        self.motion.touch_down()
        self.landed = LandedState.ON_GROUND
        self.plan = None
        self.emit(Landed(self.time_s))

    def drain_on_ground(self) -> None:
        """Disarm once the idling motors have emptied the battery."""
        battery = self.spec.battery
        if self.armed and battery is not None and remaining_fraction(battery, self.motion.energy_j) <= 0.0:
            self.emit(BatteryDepleted(self.time_s))
            self.stop_motors()
            self.emit(Disarmed(self.time_s))

    def deplete(self) -> None:
        """Descend at the present position because the battery is empty."""
        self.motion.ignore_energy()
        self.motion.lose_power()
        self.emit(BatteryDepleted(self.time_s))
        if self.phase is FlightPhase.FALLING:
            return
        x, y, _ = self.motion.stopping_point()
        # A fixed wing descends on a circle.
        down = Leg((x, y, 0.0), self.spec.cruise_speed_m_s, heading=KEEP, kind=LegKind.LAND, circle=Circle())
        self.fly([down], FlightPhase.DEPLETED, AfterLastLeg.TOUCHDOWN)
        self.landed = LandedState.LANDING
