"""Building missions from paths, and predicting missions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from geo import Farm, Obstacle
from mission.autopilots import GENERIC, PX4
from mission.errors import PlanningError
from mission.ground.items import shots_ordered
from mission.model import GeoPoint, Mission, MissionItem
from mission.planners import PlannedPath, WingPattern, build_mission, parse_budget
from mission.planners.cornering import Cornering, Waypoints
from mission.planners.path import Area, Points
from mission.transfer import Rendered, Severity, render
from sensors.camera.optics import Imaging
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.airframe.spec import VehicleSpec
from sim_vehicle.autopilot import (
    estimate_errs,
    firmware_of,
    fixed_wing_procedures,
    with_autopilot,
    with_return_margin,
)
from sim_vehicle.prediction.battery_swaps import batteries_needed
from sim_vehicle.prediction.flight import Prediction
from sim_vehicle.prediction.predict import expected_flights, plan_prediction, rehearsed_tracks
from wbf_mission.planning.conditions import (
    FlightLevel,
    flight_level,
    height_error_m,
    separation_margin_m,
    wind_of,
)
from wbf_mission.planning.coverage import asks_whole, coverage_from, image_places, predicted_coverage
from wbf_mission.planning.imaging import (
    imaging_of,
    imaging_summary,
    level_of,
    require_flight,
    require_height,
)
from wbf_mission.planning.keep_out import KeepOut, border_fence, probe_path, rally_items, stray_m
from wbf_mission.planning.station_range import StationRange
from wbf_mission.planning.terrain import FarmGround, above_terrain
from wbf_mission.scenario import MissionOptions, ScenarioError, VehicleOptions, WeatherOptions
from wbf_mission.scenario.parts import VehicleParts


@dataclass(frozen=True, slots=True)
class PlanResult:
    """A planned mission with its prediction.

    Parameters
    ----------
    planner : str or None
        Planner or policy with its parameters, or None for a mission file.
    seed : int
        Seed of the run.
    path_m : float64[n, 2]
        Points of the path, in metres of the farm frame.
    spacing_m : float or None
        Spacing of rows or rings, or None for a planner without rows or rings.
    budget_text : str
        The budget in words.
    length_m : float
        Length over ground of the predicted flight, from take-off to landing.
    coverage : float
        Share of the scouted land that the images of the predicted flight show
        (`wbf_mission.planning.coverage`).
    prediction : Prediction
        Time, energy and feasibility from the vehicle's motion model.
    batteries : int or None
        Number of batteries that the mission needs if they are changed at home; 0 for a vehicle without a
        battery, None if no number is enough.
    """

    farm: Farm
    vehicle: VehicleSpec
    planner: str | None
    seed: int
    mission: Mission
    path_m: NDArray[np.float64]
    spacing_m: float | None
    budget_text: str
    length_m: float
    coverage: float
    prediction: Prediction
    batteries: int | None
    imaging: Imaging | None = None  # Mapping camera

    @property
    def misses_farm(self) -> bool:
        """Whether all waypoints are off the farm, so that the camera sees nothing of it."""
        width, height = self.farm.width_cells, self.farm.height_cells
        ground = shapely.box(0.0, 0.0, width * self.farm.cell_size_m, height * self.farm.cell_size_m)
        return not shapely.MultiPoint(self.path_m).intersects(ground)

    @property
    def rendered(self) -> Rendered:
        """The mission in the form that is uploaded to the vehicle's autopilot."""
        firmware = firmware_of(self.vehicle)
        if firmware is None:
            return render(self.mission, GENERIC)
        mav_type = firmware.mavlink.identity.mav_type
        return render(self.mission, firmware.profile, mav_type, planned=dict(self.vehicle.parameters))

    @property
    def mav_autopilot(self) -> int:
        """MAV_AUTOPILOT that the mission is for; the value of PX4 for a vehicle without an autopilot."""
        firmware = firmware_of(self.vehicle)
        return PX4.autopilot if firmware is None else firmware.mavlink.identity.mav_autopilot

    @property
    def camera(self) -> dict[str, Any] | None:
        """Values of the mapping camera for JSON, or None for the leaf camera."""
        if self.imaging is None:
            return None
        return imaging_summary(self.imaging, len(self.image_places), self.mission.cruise_speed_m_s)

    @property
    def image_places(self) -> Points:
        """Positions of the images, float64[n, 2], in metres of the farm frame."""
        placed = self.mission
        if placed.home is None:
            placed = replace(placed, home=home_of(placed, self.farm))
        return image_places(self.farm, placed, self.prediction)

    @property
    def asks_whole(self) -> bool:
        """Whether the plan aims at full coverage (`wbf_mission.planning.coverage.asks_whole`)."""
        return asks_whole(self.imaging, self.planner)

    @property
    def warnings(self) -> list[str]:
        """Warnings for the operator before the flight, each in one line."""
        found = []
        if not self.prediction.feasible:
            found.append(f"the vehicle cannot fly this mission: {self.prediction.reason}")
        if all((shots := shots_ordered(item)) is None or shots.is_off for item in self.mission.items):
            found.append("the mission never starts the camera: there will be no observations")
        if self.misses_farm:
            found.append(f"no waypoint lies on the farm {self.farm.name}: is this the right --farm?")
        found += [str(remark) for remark in self.rendered.remarks if remark.severity is not Severity.NOTE]
        return found

    @property
    def is_too_long(self) -> bool:
        """Whether the mission needs more than a battery less its reserve."""
        return is_beyond_battery(self.vehicle, self.prediction)

    @property
    def battery_used(self) -> float | None:
        """Used fraction of the battery, above 1 if one battery is not enough; None without a battery."""
        if self.vehicle.battery is None:
            return None
        prediction = self.prediction
        return max(1.0 - prediction.battery_fraction, prediction.energy_wh / self.vehicle.battery.capacity_wh)

    def summary(self) -> dict[str, Any]:
        """Return the plan as plain values for JSON."""
        return {
            "farm": self.farm.name,
            "vehicle": self.vehicle.name,
            "planner": self.planner,
            "seed": self.seed,
            "budget": self.budget_text,
            "items": len(self.mission.items),
            "waypoints": len(self.path_m),
            "spacing_m": self.spacing_m,
            "length_m": self.length_m,
            "predicted_time_s": self.prediction.duration_s,
            "predicted_time_interval_s": self.prediction.duration_interval_s,
            "predicted_energy_wh": self.prediction.energy_wh,
            "predicted_energy_interval_wh": self.prediction.energy_interval_wh,
            "battery_used": self.battery_used,
            "batteries": self.batteries,
            "coverage": self.coverage,
            **({} if (camera := self.camera) is None else {"camera": camera}),
            "feasible": self.prediction.feasible,
            "reason": self.prediction.reason,
            "warnings": self.warnings,
            "remarks": [remark.summary() for remark in self.rendered.remarks],
        }


def budget_left(sorties: Sequence[PlanResult]) -> str:
    """Return a note if all sorties together use much less or more than the budget; else an empty text."""
    text = sorties[0].budget_text
    try:
        value, unit = parse_budget(text)
    except PlanningError:
        return ""
    length_m = sum(sortie.length_m for sortie in sorties)
    taken = {
        "m": length_m,
        "steps": length_m / sorties[0].farm.cell_size_m,
        "s": sum(sortie.prediction.duration_s for sortie in sorties),
        "Wh": sum(sortie.prediction.energy_wh for sortie in sorties),
    }[unit]
    if not all(sortie.prediction.feasible for sortie in sorties):
        return ""
    shown = f"{taken:.0f} {unit}" if taken >= 100.0 else f"{taken:.3g} {unit}"
    if taken > _OVER * value and len(sorties) > 1:
        return (
            f"the {len(sorties)} sorties take {shown}: the budget of {text} is for the path before it is"
            " cut, without the flights to and from each sortie"
        )
    return "" if taken > _USED * value else not_used(shown, text)


def not_used(taken: str, budget: str) -> str:
    """Return the note that a plan uses only part of its budget."""
    return f"the plan takes {taken} of its budget of {budget}: the planner finds no path that uses more"


def coverage_together(plans: Sequence[PlanResult], footprint: int) -> float:
    """Return the joint coverage of several vehicles' plans; land in several vehicles' images counts once."""
    if len(plans) == 1:
        return plans[0].coverage
    places = np.vstack([plan.image_places for plan in plans])
    return coverage_from(plans[0].farm, places, footprint, plans[0].imaging)


# Distance of a fixed wing's climb-out point, and height of its final approach.
CLIMB_OUT_M = 150.0
APPROACH_ALTITUDE_M = 30.0
# Used fraction of a budget below which a note is given; planners that add whole rows may leave 10 % unused.
_USED = 0.85
_OVER = 1.05
_PROBE_STEP_S, _OFF_THE_GROUND_M = 0.2, 0.3


@dataclass(frozen=True, slots=True)
class MissionBuilder:
    """Builds and predicts one vehicle's missions.

    The builder knows only the forecast (mean wind and gust statistics), not the run's seed.
    """

    farm: Farm
    vehicle: VehicleSpec  # The vehicle with its autopilot's parameters
    level: FlightLevel
    weather: WeatherOptions
    image_spacing_m: float  # Distance between images.
    cornering: Cornering  # The autopilot's way to fly corners.
    home_m: tuple[float, float]  # Take-off and landing position, in metres of the farm frame.
    # Whether the vehicle's position estimate has errors; predictions use their statistics
    estimate_errors: bool = False
    # Area that paths avoid; None if no obstacle reaches the flight height, and for the paper's robot, which
    # has no size
    keep_out: KeepOut | None = None
    barred: tuple[Obstacle, ...] = ()  # Obstacles too high to be flown over.
    fence_m: float | None = None  # Distance of the fence outside the land's border; None: no fence.
    imaging: Imaging | None = None  # Mapping camera; None: the leaf camera.
    ground: FarmGround | None = None  # Ground that the flight follows; None: flat, at home's height.
    follows_terrain: bool = False  # Whether the autopilot itself follows the terrain.
    station_range: StationRange | None = None  # Range of the ground station's radio; None: unlimited.
    _last: list[tuple[Mission, Prediction]] = field(
        default_factory=list, init=False, repr=False, compare=False
    )

    @classmethod
    def of(cls, one: VehicleParts, farm: Farm, home_m: tuple[float, float] | None = None) -> MissionBuilder:
        """Return the builder of a vehicle; its home defaults to the farm's home."""
        camera, mission, options = one.camera, one.mission, one.vehicle
        vehicle = flown_vehicle(options)
        check_speed(mission, vehicle)
        # By default, height and speed are the vehicle's design values, not the autopilot's parameters.
        level = flight_level(mission, options)
        require_height(camera, mission)
        imaging = imaging_of(camera, mission, level)
        require_flight(camera, vehicle)
        home = farm.home_m if home_m is None else home_m
        leaf_spacing_m = camera.spacing_m or farm.cell_size_m * camera.footprint
        made = cls(
            farm,
            vehicle,
            level_of(imaging, level),
            one.weather,
            leaf_spacing_m if imaging is None else imaging.image_distance_m,
            cornering_of(vehicle, mission.acceptance_radius_m),
            home,
            options.estimate_errors and estimate_errs(vehicle),
            fence_m=None if vehicle.is_ideal else mission.fence_m,
            imaging=imaging,
            ground=FarmGround.read(farm, home, mission.terrain) if mission.terrain else None,
            follows_terrain=mission.terrain_frame,
        )
        if options.radio_range_m is not None:
            reaches = StationRange.of(options.radio_range_m, farm.home_m, made.level, vehicle)
            made = replace(made, station_range=reaches)
        check_wind(made)
        lowest_m = made.level.altitude_m - separation_margin_m(height_error_m(options, vehicle), 0.0)
        barred = [
            obstacle
            for obstacle in farm.obstacles
            if obstacle.bars(lowest_m - made.relief_m(obstacle, mission.margin_m), mission.margin_m)
        ]
        if not barred or vehicle.is_ideal:
            return made
        # The vehicle follows its estimated position, so a GNSS error adds to the deviation.
        stray = made.stray_m() + separation_margin_m(options.gps_noise_m, 0.0)
        return replace(made, keep_out=KeepOut.of(barred, mission.margin_m, stray), barred=tuple(barred))

    @property
    def priced_vehicle(self) -> VehicleSpec:
        """The vehicle for pricing paths; if its position estimate has errors, it has a return margin."""
        return with_return_margin(self.vehicle) if self.estimate_errors else self.vehicle

    def mission(self, path: PlannedPath, *, camera_on_approach: bool = False) -> Mission:
        """Return the mission of ``path``; `camera_on_approach` starts the camera before the first point."""
        vehicle, farm = self.vehicle, self.farm
        return build_mission(
            replace(path, points_m=self._around(path.points_m, self.home_m)[0]),
            frame=farm.frame,
            home_xy_m=self.home_m,
            altitude_m=self.level.altitude_m,
            speed_m_s=min(self.level.speed_m_s, vehicle.top_speed_m_s),
            camera_distance_m=None if vehicle.is_ideal else self.image_spacing_m,
            camera_interval_s=vehicle.step_s if vehicle.is_ideal else None,
            cornering=self.cornering,
            avoid=self._obstacles(),
            camera_on_approach=camera_on_approach,
            return_home=not vehicle.is_ideal,
            pattern=self._pattern(),
            heights=None if self.ground is None else self.ground.profile(self.level, vehicle, self.home_m),
        )

    def relief_m(self, obstacle: Obstacle, margin_m: float) -> float:
        """Return the largest loss of height above an obstacle that terrain following can cause (m)."""
        return 0.0 if self.ground is None else self.ground.relief_m(obstacle, margin_m)

    def with_zones(self, mission: Mission, path_m: Points) -> Mission:
        """Return the mission with the farm's rally points and, if requested, a fence around land and path."""
        fence: tuple[MissionItem, ...] = ()
        if self.fence_m is not None:
            way = np.vstack((self.home_m, self.flown_way(path_m), self.home_m))
            fence = border_fence(self.farm, way, self.fence_m, self.barred)
        rally = () if self.vehicle.is_ideal else rally_items(self.farm, self.level.altitude_m)
        return replace(mission, fence=fence, rally=rally)

    def plan_of(
        self,
        mission: Mission,
        path_m: Points,
        *,
        planner: str | None,
        seed: int,
        budget_text: str,
        footprint: int,
        spacing_m: float | None = None,
        prediction: Prediction | None = None,
    ) -> PlanResult:
        """Return the plan of a mission that flies ``path_m``, predicted unless `prediction` is given.

        A mission without home starts at the farm's home.
        """
        farm = self.farm
        placed = mission if mission.home is not None else replace(mission, home=home_of(mission, farm))
        prediction = prediction or self.predict(placed)
        return PlanResult(
            farm=farm,
            vehicle=self.vehicle,
            planner=planner,
            seed=seed,
            mission=above_terrain(mission) if self.follows_terrain else mission,
            path_m=path_m,
            spacing_m=spacing_m,
            budget_text=budget_text,
            length_m=prediction.ground_length_m,
            coverage=predicted_coverage(farm, placed, prediction, footprint, self.imaging),
            prediction=prediction,
            batteries=self.batteries(placed, prediction),
            imaging=self.imaging,
        )

    def waypoints(self, path_m: Points, from_m: tuple[float, float]) -> Waypoints:
        """Return the waypoints of a path from `from_m` that then leads home, with detours round obstacles."""
        points, of_point = self._around(path_m, from_m)
        sent = self.cornering.waypoints(points, from_m, avoid=self._obstacles())
        return sent if points is path_m else replace(sent, of_point=of_point[sent.of_point])

    def flown_way(self, path_m: Points) -> Points:
        """Return the path from its first to its last point, with the detours round obstacles."""
        return path_m if self.keep_out is None else self.keep_out.around(path_m)[0]

    def _around(self, path_m: Points, from_m: tuple[float, float]) -> tuple[Points, NDArray[np.int64]]:
        """Return the path with points added round obstacles, and for each point the index of its path point.

        The path starts at `from_m` and leads home; points added on the leg home belong to the last point.
        """
        if self.keep_out is None or not len(path_m):
            return path_m, np.arange(len(path_m))
        home = () if self.vehicle.is_ideal else (self.home_m,)
        points, of_point = self.keep_out.around(np.vstack((from_m, path_m, *home)))
        end = len(points) - len(home)
        return points[1:end], np.minimum(of_point[1:end] - 1, len(path_m) - 1)

    def _obstacles(self) -> Area | None:
        """Return the area that legs lengthened for cornering must not enter."""
        return None if self.keep_out is None else self.keep_out.near

    def _pattern(self) -> WingPattern | None:
        """Return a fixed wing's pattern to take off and land into the wind, or None for other vehicles."""
        vehicle, weather = self.vehicle, self.weather
        if not vehicle.circles:
            return None
        procedures = fixed_wing_procedures(vehicle)
        law = procedures.limits(vehicle)
        down_m = min(self.level.altitude_m, APPROACH_ALTITUDE_M)
        return WingPattern(
            heading_rad=math.radians(weather.wind_direction_deg) if weather.wind_speed_m_s > 0.0 else 0.0,
            climb_out_m=CLIMB_OUT_M,
            # The approach is 10 % longer than at the steepest slope.
            approach_m=1.1 * down_m / law.landing_slope,
            approach_altitude_m=down_m,
            radius_m=max(abs(law.loiter_radius), 1.2 * law.tightest_m(law.airspeed_trim)),
            placed_start=procedures.land_start_needs_position,
        )

    def predict(self, mission: Mission) -> Prediction:
        """Predict the flight of ``mission`` from the statistics of gusts and estimate errors.

        The last prediction is kept, because a search often ends with the mission that is then planned.
        """
        for known, prediction in self._last:
            if known == mission:
                return prediction
        wind = wind_of(self.weather, self.level)
        prediction = plan_prediction(mission, self.vehicle, wind=wind, estimate_errors=self.estimate_errors)
        self._last[:] = [(mission, prediction)]
        return prediction

    def price(
        self, missions: Sequence[Mission], *, gusts: bool = True, endless: bool = False
    ) -> list[Prediction]:
        """Predict the flights of candidate missions, with an exact position estimate.

        An exact estimate makes the prediction eight times faster. With acceptance radii of two metres, PX4's
        estimate errors would make a flight up to 3 % longer. Just below the distance from home at which the
        return altitude steps up, the higher altitude is priced. Without ``gusts`` the wind is the mean wind.
        `endless` flights continue on an empty battery.
        """
        wind = wind_of(self.weather, self.level, gusts=gusts)
        return expected_flights(missions, self.priced_vehicle, wind=wind, endless=endless)

    def stray_m(self) -> float:
        """Return the largest deviation of the vehicle from its legs (m).

        The deviation is measured on a path of many turns, which the vehicle's motion model flies in simulated
        wind, with estimate errors if the vehicle has them. Corners cut, overshoot, lengthened legs and drift
        all count.
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
        """Return the number of batteries that ``mission`` needs (`battery_swaps.batteries_needed`)."""
        wind = wind_of(self.weather, self.level)
        return batteries_needed(mission, self.priced_vehicle, prediction, wind=wind)


def flown_vehicle(vehicle: VehicleOptions) -> VehicleSpec:
    """Return a vehicle's specification with its autopilot and parameters."""
    return with_autopilot(get_vehicle(vehicle.name), vehicle.autopilot, vehicle.parameters)


def cornering_of(vehicle: VehicleSpec, radius_m: float | None = None) -> Cornering:
    """Return the cornering of a vehicle's autopilot; `radius_m` replaces the default acceptance radius."""
    firmware = firmware_of(vehicle)
    own = Cornering() if firmware is None else firmware.cornering
    return own if radius_m is None else replace(own, radius_m=radius_m)


def check_wind(builder: MissionBuilder) -> None:
    """Raise ScenarioError if the mean wind at flight height reaches the vehicle's airspeed limit."""
    vehicle, limit = builder.vehicle, builder.vehicle.airspeed_limit_m_s
    wind = wind_of(builder.weather, builder.level, gusts=False)
    speed = math.hypot(*wind.mean_at(builder.level.altitude_m))
    if not vehicle.is_ideal and speed >= limit:
        raise ScenarioError(
            f"wind of {speed:g} m/s: vehicle {vehicle.name} flies at most {limit:.3g} m/s "
            "through the air and would be blown away; wait for less wind"
        )


def check_speed(mission: MissionOptions, vehicle: VehicleSpec) -> None:
    """Raise ScenarioError if the requested cruise speed exceeds the vehicle's limit."""
    asked, most = mission.cruise_speed_m_s, vehicle.fastest_m_s
    if asked is not None and asked > most:
        msg = f"cruise speed {asked:g} m/s: vehicle {vehicle.name} flies at most {most:.3g} m/s"
        raise ScenarioError(msg + "; give a lower speed, or another vehicle")


def is_beyond_battery(vehicle: VehicleSpec, prediction: Prediction) -> bool:
    """Return whether a predicted flight needs more than a battery less its reserve."""
    battery = vehicle.battery
    return battery is not None and prediction.battery_fraction < battery.reserve_fraction


def home_of(mission: Mission, farm: Farm) -> GeoPoint:
    """Return the home of ``mission``, or the farm's home if the mission has none."""
    latitude_deg, longitude_deg = farm.frame.to_wgs84(*farm.home_m)
    return mission.home or GeoPoint(latitude_deg, longitude_deg, farm.frame.altitude_m)


def positions_of(mission: Mission, farm: Farm) -> Points:
    """Return the positions of a mission's items in the farm frame (m), float64[n, 2]."""
    placed = [(item.x, item.y) for item in mission.items if item.has_position and (item.x or item.y)]
    latitude, longitude = np.array(placed).reshape(-1, 2).T
    return np.column_stack(farm.frame.from_wgs84(latitude, longitude))
