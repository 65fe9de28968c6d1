"""From paths to missions of a run, and from missions to what they will take."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from geo import Farm
from mission.model import Mission
from mission.planners import PlannedPath, WingPattern, build_mission
from mission.planners.path import Area, Points
from mission.planners.turns import Turns, Waypoints
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.airframe.spec import VehicleSpec
from sim_vehicle.autopilot import (
    estimate_errs,
    firmware_of,
    fixed_wing_procedures,
    with_autopilot,
    with_return_margin,
)
from sim_vehicle.execution.fixed_wing_items import must_circle
from sim_vehicle.prediction.battery_swaps import batteries_needed
from sim_vehicle.prediction.flight import Prediction
from sim_vehicle.prediction.predict import expected_flights, plan_prediction, rehearsed_tracks
from wbf_mission.planning.clearance import clearance_m
from wbf_mission.planning.keep_out import KeepOut, probe_path, stray_m
from wbf_mission.planning.weather import FlightLevel, flight_level, wind_of
from wbf_mission.scenario import VehicleOptions, WeatherOptions
from wbf_mission.scenario.parts import VehicleParts

# Where a fixed wing's climb-out leads to, and the height of its final approach.
CLIMB_OUT_M = 150.0
APPROACH_ALTITUDE_M = 30.0
_MOST_THREADS = 4
_PROBE_STEP_S, _OFF_THE_GROUND_M = 0.2, 0.3


@dataclass(frozen=True, slots=True)
class MissionBuilder:
    """Turns paths into missions of one run, and predicts them.

    It knows the weather as a forecast does (mean wind, statistics of the gusts), not the run's seed.

    Parameters
    ----------
    vehicle : VehicleSpec
        As its autopilot flies it.
    image_spacing_m : float
        Distance between images.
    turns : Turns
        How the autopilot takes the corners of a path.
    home_m : tuple of float
        Where the vehicle takes off and lands, in metres of the farm frame.
    estimate_errors : bool
        Whether the vehicle flies by an estimate that errs: known by its statistics.
    keep_out : KeepOut or None
        What its paths lead round; None on a farm without obstacles, and for the paper's robot, which has no
        size.
    """

    farm: Farm
    vehicle: VehicleSpec
    level: FlightLevel
    weather: WeatherOptions
    image_spacing_m: float
    turns: Turns
    home_m: tuple[float, float]
    estimate_errors: bool = False
    keep_out: KeepOut | None = None

    @classmethod
    def of(cls, one: VehicleParts, farm: Farm, home_m: tuple[float, float] | None = None) -> MissionBuilder:
        """Return the builder of a run's vehicle, which starts at the farm's home if nothing else is said.

        Raises
        ------
        VehicleError
            If the vehicle or a parameter of its autopilot is unknown, or a value out of range.
        """
        camera, mission, options = one.camera, one.mission, one.vehicle
        vehicle = flown_vehicle(options)
        made = cls(
            farm,
            vehicle,
            # What the vehicle was built for, not what an autopilot does that is told nothing.
            flight_level(mission, options),
            one.weather,
            camera.spacing_m or farm.cell_size_m * camera.footprint,
            turns_of(vehicle, mission.acceptance_radius_m),
            farm.home_m if home_m is None else home_m,
            options.estimate_errors and estimate_errs(vehicle),
        )
        if not farm.obstacles or vehicle.is_ideal:
            return made
        # The satellites' error is that of where it believes to be, which it follows.
        stray = made.stray_m() + clearance_m(options.gps_noise_m, 0.0)
        return replace(made, keep_out=KeepOut.of(farm, mission.margin_m, stray))

    @property
    def priced_vehicle(self) -> VehicleSpec:
        """The vehicle by which ways home are priced: a promise holds on both sides of an edge near home."""
        return with_return_margin(self.vehicle) if self.estimate_errors else self.vehicle

    def mission(self, path: PlannedPath, *, camera_on_approach: bool = False) -> Mission:
        """Return the mission that flies ``path``, with the camera on from its first point or before."""
        vehicle, farm = self.vehicle, self.farm
        return build_mission(
            replace(path, points_m=self._around(path.points_m, self.home_m)[0]),
            frame=farm.frame,
            home_xy_m=self.home_m,
            altitude_m=self.level.altitude_m,
            speed_m_s=min(self.level.speed_m_s, vehicle.top_speed_m_s),
            camera_distance_m=None if vehicle.is_ideal else self.image_spacing_m,
            camera_interval_s=vehicle.step_s if vehicle.is_ideal else None,
            turns=self.turns,
            avoid=self._obstacles(),
            camera_on_approach=camera_on_approach,
            return_home=not vehicle.is_ideal,
            pattern=self._pattern(),
        )

    def waypoints(self, path_m: Points, from_m: tuple[float, float]) -> Waypoints:
        """Return where the vehicle is sent to fly a path from somewhere, and as far as need be home."""
        points, of_point = self._around(path_m, from_m)
        sent = self.turns.waypoints(points, from_m, avoid=self._obstacles())
        return sent if points is path_m else replace(sent, of_point=of_point[sent.of_point])

    def flown_way(self, path_m: Points) -> Points:
        """Return the way that a path from its first point to its last one is flown, round the obstacles."""
        return path_m if self.keep_out is None else self.keep_out.around(path_m)[0]

    def _around(self, path_m: Points, from_m: tuple[float, float]) -> tuple[Points, NDArray[np.int64]]:
        """Return a path with the points between which it leads round obstacles: from somewhere, and home.

        What leads home counts as its last point.
        """
        if self.keep_out is None or not len(path_m):
            return path_m, np.arange(len(path_m))
        home = () if self.vehicle.is_ideal else (self.home_m,)
        points, of_point = self.keep_out.around(np.vstack((from_m, path_m, *home)))
        end = len(points) - len(home)
        return points[1:end], np.minimum(of_point[1:end] - 1, len(path_m) - 1)

    def _obstacles(self) -> Area | None:
        """Return where no leg is led on to."""
        return None if self.keep_out is None else self.keep_out.near

    def _pattern(self) -> WingPattern | None:
        """Return how a fixed wing takes off and lands, into the wind."""
        vehicle, weather = self.vehicle, self.weather
        if not must_circle(vehicle):
            return None
        procedures = fixed_wing_procedures(vehicle)
        law = procedures.limits(vehicle)
        down_m = min(self.level.altitude_m, APPROACH_ALTITUDE_M)
        return WingPattern(
            heading_rad=math.radians(weather.wind_direction_deg) if weather.wind_speed_m_s > 0.0 else 0.0,
            climb_out_m=CLIMB_OUT_M,
            # A little flatter than the steepest slope.
            approach_m=1.1 * down_m / law.landing_slope,
            approach_altitude_m=down_m,
            radius_m=max(abs(law.loiter_radius), 1.2 * law.tightest_m(law.airspeed_trim)),
            placed_start=procedures.land_start_needs_position,
        )

    def predict(self, mission: Mission) -> Prediction:
        """Predict the flight of ``mission``, of gusts and the estimate's errors by their statistics only."""
        wind = wind_of(self.weather, self.level)
        return plan_prediction(
            mission, self.vehicle, wind=wind, threads=_threads(), estimate_errors=self.estimate_errors
        )

    def price(self, missions: Sequence[Mission], *, gusts: bool = True) -> list[Prediction]:
        """Predict the flights of several missions, to choose among them: as if the estimate were exact.

        That is eight times faster. With waypoints of two metres, as planned ones have, PX4's errors make a
        flight up to 3 % longer; ways home near a step of the return altitude are those of its dearer side.
        Without ``gusts`` they are flown in the mean wind.
        """
        wind = wind_of(self.weather, self.level, gusts=gusts)
        return expected_flights(missions, self.priced_vehicle, wind=wind, threads=_threads())

    def stray_m(self) -> float:
        """Return how far the vehicle leaves the legs that it is sent along, metres.

        Its own motion flies a path of many turns, through the same waypoints as any path, in rehearsals of
        the wind and, where the estimate errs, of its errors. That counts corners that are cut or swung wide,
        legs that are led on, the drift in the wind.
        """
        path, wind = probe_path(self.home_m, self.level.speed_m_s), wind_of(self.weather, self.level)
        tracks = rehearsed_tracks(
            self.mission(PlannedPath(path, None, "probe")),
            self.vehicle,
            wind=wind,
            track_step_s=_PROBE_STEP_S,
            estimate_errors=self.estimate_errors,
        )
        aloft = [track[track[:, 2] > _OFF_THE_GROUND_M] for track in tracks]
        flown = [
            np.column_stack(self.farm.frame.from_east_north(*one[:, :2].T)) + self.home_m for one in aloft
        ]
        planned = np.vstack((self.home_m, path, self.home_m))
        return stray_m(planned, flown, gusty=wind is not None and wind.is_gusty)

    def batteries(self, mission: Mission, prediction: Prediction) -> int | None:
        """How many batteries ``mission`` needs (`sim_vehicle.prediction.battery_swaps.batteries_needed`)."""
        wind = wind_of(self.weather, self.level)
        return batteries_needed(mission, self.priced_vehicle, prediction, wind=wind)


def flown_vehicle(vehicle: VehicleOptions) -> VehicleSpec:
    """Return a vehicle as its autopilot flies it.

    Raises
    ------
    VehicleError
        If the vehicle or a parameter is unknown, or a value out of range.
    """
    return with_autopilot(get_vehicle(vehicle.name), vehicle.autopilot, vehicle.parameters)


def turns_of(vehicle: VehicleSpec, radius_m: float | None = None) -> Turns:
    """Return how a vehicle takes the corners of a path, with the acceptance radius that was asked for."""
    firmware = firmware_of(vehicle)
    own = Turns() if firmware is None else firmware.turns
    return own if radius_m is None else replace(own, radius_m=radius_m)


def _threads() -> int:
    """Return how many candidates are flown at the same time; the predictions do not depend on it."""
    return min(_MOST_THREADS, os.cpu_count() or 1)
