"""How boats move: by the model of ground vehicles, with a turn that follows from their length."""

from dataclasses import replace
from types import MappingProxyType

from sim_vehicle.autopilot.parameters import ParameterSpec
from skiff import Hull
from wbf_mission.addons.rovers.procedures import RoverProcedures


class Steering(RoverProcedures):
    """Without an autopilot."""

    name = "generic"
    parameters = MappingProxyType({})

    def fit(self, spec):
        return spec

    def limits(self, spec):
        from wbf_mission.addons.rovers.motion.layout import RoverLimits

        hull = spec.airframe or Hull()
        return RoverLimits(
            speed_max=spec.speed_limit_m_s,
            acceleration=spec.acceleration_m_s2,
            deceleration=spec.acceleration_m_s2,
            turn_radius=hull.turn_lengths * hull.length_m,
            turn_rate=0.8,
            lateral=1.0,
            steering_s=0.5,
            ahead_gain=1.0,
            ahead_min=1.0,
            ahead_max=6.0,
            pivot_begin=0.0,
            pivot_end=0.0,
            pivot_rate=0.8,
            acceptance=spec.acceptance_radius_m,
            corner_gain=0.0,
            corner_max=0.0,
            passes=True,
        )


class Tidal(Steering):
    """As the autopilot does it: its cruise speed is a parameter."""

    name = "tide"
    parameters = MappingProxyType({"TIDE_SPEED": ParameterSpec(1.0, 0.5, 3.0, "m/s", "cruise speed")})

    def fit(self, spec):
        return replace(spec, cruise_speed_m_s=self.value(spec, "TIDE_SPEED"))


STEERING, TIDAL = Steering(), Tidal()
