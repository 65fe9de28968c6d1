"""Parts of a scenario; a part is a dataclass of related options that checks their values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, TypedDict

from geo.texts import unknown
from mission import planners
from mission.errors import PlanningError
from sim_vehicle.airframe.kind import DEFAULT_AUTOPILOT, autopilot_names
from wbf_mission.scenario.choice import Choice, choose
from wbf_mission.scenario.option import Option, Part, ScenarioError, names_in, option
from wbf_mission.scenario.values import (
    Separation,
    batteries_in,
    parameter_values,
    parse_separation,
    shear_values,
    turbulence_value,
    wind_values,
)

if TYPE_CHECKING:
    from geo.farm import Farm
    from sensors.environment.world import World

RUN = "What to run"
VEHICLE = "Vehicle and weather"
CAMERA = "Leaf camera"
_SPIRAL = Choice("spiral")
UNLIMITED = "unlimited"
"""Word for a budget that may take several batteries or flights."""
_USE_UP = ("lawnmower", "adaptive-lawnmower", "spiral", "random-waypoint")
LAST_DAY = 126
"""Last day of an environment."""
MOST_VEHICLES = 10
PARTITIONS = ("strips", "voronoi", "none")
"""Ways to divide a farm among a fleet; equal to `mission.policies.allocation.PARTITION_NAMES`."""
ORIENTATIONS = ("landscape", "portrait")
CAMERA_OF_PLANS = ("camera_model", "gsd_cm", "front_overlap", "side_overlap", "camera_orientation")
"""Options of a camera given by sensor and lens. Only plans use such a camera; flights use the leaf camera."""
LEVELS = ("light", "moderate", "severe", "wind")
"""Levels of turbulence; at the level ``wind`` the mean wind sets the strength."""
MAX_ALTITUDE_M = 120.0
"""Limit of the open category (EU 2019/947); the 400 ft of 14 CFR 107.51 are 122 m."""
_CEILING_M = 3000.0


@dataclass(frozen=True, slots=True)
class FarmOptions(Part):
    """Options of the farm and of the environment's days."""

    name: str = option(
        "miniberry-30",
        "Farm: a name from 'wbf-mission farm list', or a file (GeoJSON, KML/KMZ, Shapefile, GeoPackage,"
        " GPX, Mission Planner's .poly)",
        RUN,
        key="farm",
        kind="farm",
    )
    day: int = option(6, "Day of the environment; the first of several days", RUN, low=0, high=LAST_DAY)
    days: int = option(1, "Number of successive days that are flown", RUN, low=1, high=LAST_DAY)
    flights_per_day: int = option(
        1, "Flights per day; each flight has full batteries and the whole budget", RUN, low=1, high=100
    )
    fields: tuple[str, ...] = option(
        ("tylcv", "ccr", "soil"),
        "Fields to sense and score, separated by commas: tylcv, ccr, soil, or field files (.toml)",
        RUN,
        metavar="NAMES",
        default="tylcv,ccr,soil",
        read=names_in,
    )
    world: str | None = option(
        None,
        "True development of the fields, hidden from planner, policy and estimator: a built-in world,"
        " such as wrong-rates, or a .toml file",
        RUN,
        metavar="NAME",
        default="the published development",
    )
    crop: str | None = option(
        None, "Crop of patches in a farm file that name no crop", RUN, metavar="NAME", default="crop"
    )
    crs: str | None = option(
        None,
        "Coordinate system, such as EPSG:32617, of a farm file that names no system",
        RUN,
        key="farm_crs",
        metavar="CODE",
        default="WGS 84 if coordinates are degrees",
    )
    repair: bool = option(
        False, "Repair invalid polygons of a farm file where that is safe, and report each repair", RUN
    )

    def load(self) -> Farm:
        """Return the farm; raise FarmError if the name is unknown or the file cannot be used."""
        from geo.farms import get_farm

        return get_farm(self.name, crop=self.crop, crs=self.crs, repair=self.repair)

    def load_world(self) -> World | None:
        """Return the world, or None without one; raise EnvironmentDataError if the world is invalid."""
        if self.world is None:
            return None
        from sensors.environment.world import World

        return World.load(self.world)

    def check(self) -> None:
        """Raise ScenarioError if the list of fields is empty or a day is after `LAST_DAY`."""
        if self.day + self.days - 1 > LAST_DAY:
            msg = f"days {self.days} from day {self.day} on: the last day is {LAST_DAY}; give fewer days"
            raise ScenarioError(msg)
        if not self.fields:
            msg = "fields are empty: give at least one field, such as tylcv, or leave the option out"
            raise ScenarioError(msg)


@dataclass(frozen=True, slots=True)
class MissionOptions(Part):
    """Options of the mission, which is a mission file or a plan within a budget.

    The default ``budget`` is the vehicle's battery less its reserve. For the ideal vehicle, the default is as
    in the paper: 0.4 timesteps for each of the owner's cells. The default ``acceptance_radius_m`` is the
    radius that the autopilot can hold (`mission.planners.cornering.Cornering`).
    """

    planner: Any = option(
        _SPIRAL,
        "Planner, NAME[:KEY=VALUE,...]: lawnmower, adaptive-lawnmower, spiral, random-waypoint, survey,"
        " or FILE.py:NAME of your own",
        RUN,
        kind="planner",
        not_with=("mission", "policy"),
        metavar="NAME",
    )
    policy: Any = option(
        None,
        "Policy that chooses the path in flight, NAME[:KEY=VALUE,...]: greedy, orienteering,"
        " rolling-horizon, refining-lawnmower, confidence-guided, grid-limited-randomness, market, or"
        " FILE.py:NAME of your own",
        RUN,
        kind="policy",
        not_with=("mission",),
        metavar="NAME",
        default="none, so that the planner's path is flown",
    )
    budget: str | None = option(
        None,
        "Budget of each vehicle, before its flight is cut into sorties: 8000m, 2.5km, 25min, 1500s, 50Wh"
        " or 360steps; unlimited plans a whole survey, however many batteries it needs",
        RUN,
        default="the battery less its reserve; for ideal, 0.4 steps per cell of the owner",
        example="60s",
        not_with=("mission",),
    )
    file: str | None = option(
        None,
        "Mission file to use instead of planning: .plan, .waypoints or .json",
        RUN,
        key="mission",
        metavar="FILE",
    )
    partition: str = option(
        PARTITIONS[0],
        "Division of the farm among the vehicles of a fleet",
        RUN,
        choices=PARTITIONS,
        not_with=("mission", "policy"),
        needs_fleet=True,
    )
    altitude_m: float | None = option(
        None,
        "Flight height above home",
        VEHICLE,
        low=0.5,
        high=_CEILING_M,
        default="vehicle's height",
        not_with=("mission",),
    )
    height_above_ground_m: float | None = option(
        None,
        "Flight height above the ground; needs --terrain for the ground's heights, or --terrain-frame if the"
        " autopilot knows them",
        VEHICLE,
        low=0.5,
        high=_CEILING_M,
        default="heights are above home, see --altitude",
        not_with=("mission", "altitude_m"),
    )
    max_altitude_m: float = option(
        MAX_ALTITUDE_M,
        "Greatest flight height that your permission allows; most rules allow 120 m without a permission",
        VEHICLE,
        low=1.0,
        high=_CEILING_M,
    )
    terrain: tuple[str, ...] = option(
        (),
        "Elevation rasters, GeoTIFF or SRTM (.hgt), separated by commas; plans follow the ground within 1 m",
        VEHICLE,
        metavar="FILES",
        default="flat ground",
        read=names_in,
        not_with=("mission", "policy"),
        needs="height_above_ground_m",
    )
    terrain_frame: bool = option(
        False,
        "Write heights above the terrain (MAVLink frame 10), for an autopilot that follows the terrain"
        " itself",
        VEHICLE,
        not_with=("mission", "policy"),
        needs="height_above_ground_m",
    )
    cruise_speed_m_s: float | None = option(
        None, "Cruise speed", VEHICLE, low=0.1, high=30.0, default="vehicle's speed", not_with=("mission",)
    )
    acceptance_radius_m: float | None = option(
        None,
        "Acceptance radius of the planned waypoints",
        VEHICLE,
        low=0.05,
        high=50.0,
        default="2 m; for ArduCopter and rovers, the autopilot's radius",
        not_with=("mission",),
    )
    margin_m: float = option(
        2.0,
        "Least distance of the flown path from the farm's obstacles and from a mission file's fence",
        RUN,
        low=0.0,
        high=1000.0,
    )
    fence_m: float | None = option(
        None,
        "Geofence METRES outside the farm's border; exclusion zones round obstacles",
        RUN,
        metavar="METRES",
        low=1.0,
        high=1000.0,
        default="none",
        not_with=("mission",),
    )

    def check(self) -> None:
        """Convert planner and policy to `Choice`; raise ScenarioError for an unusable height or budget."""
        object.__setattr__(self, "planner", choose(self.planner, "planner"))
        if self.policy is not None:
            object.__setattr__(self, "policy", choose(self.policy, "policy"))
        if self.height_above_ground_m is not None and bool(self.terrain) == self.terrain_frame:
            raise ScenarioError(
                f"height above ground {self.height_above_ground_m:g} m: give either --terrain with the"
                " ground's heights, or --terrain-frame if the autopilot knows the heights"
            )
        for name in ("altitude_m", "height_above_ground_m"):
            height_m = getattr(self, name)
            if height_m is not None and height_m > self.max_altitude_m:
                what = name.removesuffix("_m").replace("_", " ")
                raise ScenarioError(
                    f"{what} {height_m:g} m is above {self.max_altitude_m:g} m: fly lower, or with a"
                    " permission give a greater max altitude"
                )
        endless = self.budget is not None and self.budget.strip().lower() == UNLIMITED
        if endless and (self.policy is not None or self.planner.chosen in _USE_UP):
            who = f"planner {self.planner}" if self.policy is None else f"policy {self.policy}"
            msg = f"budget unlimited: {who} uses up any budget; give a length or a time, or plan a survey"
            raise ScenarioError(msg)
        if self.budget is not None and not endless and batteries_in(self.budget) is None:
            try:
                planners.parse_budget(self.budget)
            except PlanningError as error:
                raise ScenarioError(str(error)) from None


@dataclass(frozen=True, slots=True)
class VehicleOptions(Part):
    """Options of the vehicles, their autopilots and their position errors."""

    name: str = option(
        "quad",
        "Vehicle: a name from 'wbf-mission vehicle list', such as quad or ideal (the paper's robot), or a"
        " .toml file",
        VEHICLE,
        key="vehicle",
        kind="vehicle",
    )
    vehicles: int | None = option(
        None,
        "Number of vehicles that fly together; --vehicle and --autopilot may name each (quad,rover)",
        VEHICLE,
        low=1,
        high=MOST_VEHICLES,
        default="the number of names in --vehicle or --autopilot",
    )
    autopilot: str = option(
        DEFAULT_AUTOPILOT,
        "Autopilot to simulate",
        VEHICLE,
        choices=autopilot_names(),
        kind="autopilot",
        each=True,
    )
    parameters: dict[str, float] = option(
        dict,
        "Autopilot parameter, such as MPC_ACC_HOR=4; may be repeated",
        VEHICLE,
        flag="--param",
        metavar="NAME=VALUE",
        read=parameter_values,
        default="the autopilot's defaults",
    )
    gps_noise_m: float = option(
        0.0, "Standard deviation of the slow GPS position error, along each axis", VEHICLE, low=0.0, high=20.0
    )
    baro_noise_m: float = option(
        0.0, "Standard deviation of the barometer's slow height error", VEHICLE, low=0.0, high=5.0
    )
    estimate_errors: bool = option(
        True,
        "Simulated errors of a PX4 multirotor's state estimate: height jumps in the first two minutes,"
        " velocity errors; other vehicles' estimates are exact",
        VEHICLE,
    )

    separation: str = option(
        "layers:2m",
        "Separation of the vehicles of a fleet: layers:METRES (each at its own height), distance:METRES"
        " (at one height; a vehicle may start later) or none; position errors increase the distance;"
        " the paper's robots fly without separation",
        VEHICLE,
        needs_fleet=True,
        metavar="WAY",
    )
    radio_range_m: float | None = option(
        None,
        "Range of the ground station's radio at home; observations made farther away arrive on return",
        VEHICLE,
        low=1.0,
        high=1e6,
        default="unlimited",
    )

    def check(self) -> None:
        """Raise ScenarioError if a name is empty or the numbers of names and vehicles differ."""
        names = self.names
        if not all(names):
            raise ScenarioError(
                f"vehicle {self.name!r} has an empty name: give names separated by commas, such as quad,quad"
            )
        if len(names) > MOST_VEHICLES:
            raise ScenarioError(f"vehicle names {len(names)} vehicles: at most {MOST_VEHICLES} fly together")
        for what, given in (("vehicle", names), ("autopilot", self.autopilot.split(","))):
            if len(given) not in (1, len(self.fleet)):
                msg = f"{len(given)} {what} names for {len(self.fleet)} vehicles: give one name, or one each"
                raise ScenarioError(msg)
        parse_separation(self.separation)

    @property
    def keeps(self) -> Separation:
        """The parsed option `separation`."""
        return parse_separation(self.separation)

    @property
    def names(self) -> tuple[str, ...]:
        """The vehicle names that `name` lists."""
        return tuple(part.strip() for part in self.name.split(","))

    @property
    def fleet(self) -> tuple[str, ...]:
        """Name of each vehicle, in the order of system ids.

        >>> VehicleOptions("quad", vehicles=2).fleet, VehicleOptions("quad,ideal").fleet
        (('quad', 'quad'), ('quad', 'ideal'))
        """
        names = self.names
        count = self.vehicles or max(len(names), self.autopilot.count(",") + 1)
        return names if len(names) > 1 else names * count

    @property
    def autopilots(self) -> tuple[str, ...]:
        """Autopilot of each vehicle, in the order of system ids.

        >>> VehicleOptions("quad", autopilot="px4,ardupilot").autopilots, VehicleOptions().autopilots
        (('px4', 'ardupilot'), ('px4',))
        """
        given = tuple(part.strip() for part in self.autopilot.split(","))
        return given if len(given) > 1 else given * len(self.fleet)


@dataclass(frozen=True, slots=True)
class WeatherOptions(Part):
    """Options of the air: mean wind, wind shear, and gusts or Dryden turbulence."""

    wind_speed_m_s: float = option(0.0, "Mean wind speed", VEHICLE, low=0.0, high=40.0, flag=None)
    wind_direction_deg: float = option(
        0.0, "Direction from which wind blows, clockwise from north", VEHICLE, low=0.0, high=360.0, flag=None
    )
    wind_gust_m_s: float = option(0.0, "Standard deviation of gusts", VEHICLE, low=0.0, high=15.0, flag=None)
    wind_height_m: float = option(
        10.0, "Height at which the mean wind has its given speed", VEHICLE, low=1.0, high=300.0, flag=None
    )
    wind_shear: str | None = option(
        None, "Growth of the wind with height", VEHICLE, choices=("log", "power", "sitl"), flag=None
    )
    wind_roughness_m: float = option(
        0.1, "Roughness length of the logarithmic law", VEHICLE, low=1e-5, high=0.7, flag=None
    )
    wind_exponent: float = option(
        1.0 / 7.0, "Exponent of the power law", VEHICLE, low=0.0, high=1.0, flag=None
    )
    turbulence: str | float | None = option(
        None,
        "Dryden turbulence (MIL-F-8785C): light, moderate, severe, wind (strength set by --wind),"
        " or the wind speed at 6 m in m/s",
        VEHICLE,
        metavar="LEVEL",
        default="none",
        read=turbulence_value,
        low=0.0,
        high=40.0,
    )

    COMPOUND: ClassVar[tuple[Option, ...]] = (
        Option(
            "wind",
            "Mean wind speed (m/s), direction from which it blows (degrees), deviation of gusts (m/s);"
            " for example 5,270,1.5",
            VEHICLE,
            flag="--wind",
            metavar="SPEED,FROM[,GUST]",
            default="calm",
            sets=("wind_speed_m_s", "wind_direction_deg", "wind_gust_m_s"),
            read=wind_values,
        ),
        Option(
            "wind_shear",
            "Growth of the wind with height: log[,ROUGHNESS[,HEIGHT]] or power[,EXPONENT[,HEIGHT]], where"
            " --wind is the wind at HEIGHT (m); sitl is the law of ArduPilot's simulator, sqrt(h / 60 m), for"
            " which --wind is the wind at 60 m and above (only with --wind)",
            VEHICLE,
            flag="--wind-shear",
            metavar="LAW[,VALUE[,HEIGHT]]",
            default="none; log,0.1,10; power,0.143,10",
            sets=("wind_shear", "wind_roughness_m", "wind_exponent", "wind_height_m"),
            read=shear_values,
            needs="wind_speed_m_s",
        ),
    )

    def check(self) -> None:
        """Raise ScenarioError if the level of turbulence is unknown or there are gusts and turbulence."""
        if isinstance(self.turbulence, str) and self.turbulence not in LEVELS:
            msg = unknown("level of turbulence", self.turbulence, LEVELS, ", or give the wind at 6 m in m/s")
            raise ScenarioError(msg)
        if self.turbulence is not None and self.wind_gust_m_s > 0.0:
            gust = f"a wind gust of {self.wind_gust_m_s:g} m/s"
            raise ScenarioError(f"turbulence {self.turbulence} and {gust}: give only one of the two")


@dataclass(frozen=True, slots=True)
class CameraOptions(Part):
    """Options of the leaf camera (image spacing, footprint, fields, errors) or another camera for plans."""

    spacing_m: float | None = option(
        None,
        "Distance between images",
        CAMERA,
        key="camera_spacing_m",
        low=0.05,
        high=1000.0,
        default="one footprint",
        not_with=("mission",),
    )
    footprint: int = option(
        1, "Side of the camera's footprint in cells", CAMERA, key="camera_footprint", low=1, high=15
    )
    noise: float = option(
        0.0, "Standard deviation of the camera's noise", CAMERA, key="camera_noise", low=0.0, high=1.0
    )
    false_positive_rate: float = option(
        0.0, "Fraction of healthy leaves that are read as infected", CAMERA, low=0.0, high=1.0
    )
    false_negative_rate: float = option(
        0.0, "Fraction of infected leaves that are read as healthy", CAMERA, low=0.0, high=1.0
    )
    fields: tuple[str, ...] | None = option(
        None,
        "Fields that the camera measures, such as tylcv,soil; for a fleet, a semicolon separates the"
        " vehicles: tylcv,ccr;soil",
        CAMERA,
        key="camera_fields",
        metavar="NAMES",
        default="all fields",
        read=names_in,
    )

    model: str | None = option(
        None,
        "Camera given by sensor and lens: a name, such as dji-p1-35, or a .toml file; sets the distances of"
        " rows and images, and limits the speed",
        CAMERA,
        key="camera_model",
        flag="--camera",
        metavar="NAME",
        default="the leaf camera",
        not_with=("mission",),
    )
    gsd_cm: float | None = option(
        None,
        "Size of a pixel on the ground; sets the flight height",
        CAMERA,
        low=0.01,
        high=100.0,
        default="the size at the flight height",
        needs="camera_model",
        not_with=("mission",),
    )
    front_overlap: float = option(
        0.75,
        "Overlap of an image with the next image, as a fraction of the image",
        CAMERA,
        low=0.0,
        high=0.95,
        needs="camera_model",
    )
    side_overlap: float = option(
        0.7,
        "Overlap of images of neighbouring rows, as a fraction of the image",
        CAMERA,
        low=0.0,
        high=0.95,
        needs="camera_model",
    )
    orientation: str = option(
        ORIENTATIONS[0],
        "Mounting of the camera; the long side of an image lies across (landscape) or along the flight",
        CAMERA,
        key="camera_orientation",
        choices=ORIENTATIONS,
        needs="camera_model",
    )

    def check(self) -> None:
        """Raise ScenarioError if the camera has no fields, or both an overlap and an image spacing."""
        if self.fields is not None and not all(self.by_vehicle):
            msg = "camera fields are empty: give at least one field, such as tylcv, or leave the option out"
            raise ScenarioError(msg)
        if self.model is not None and self.spacing_m is not None:
            msg = f"camera {self.model}: front overlap sets the distance of images; leave out camera spacing"
            raise ScenarioError(msg)

    @property
    def by_vehicle(self) -> tuple[tuple[str, ...], ...]:
        """Field names: one tuple for all vehicles, or a tuple for each if semicolons separate them.

        >>> CameraOptions(fields=("tylcv", "ccr;soil")).by_vehicle
        (('tylcv', 'ccr'), ('soil',))
        """
        return tuple(names_in(part) for part in ",".join(self.fields or ()).split(";"))

    def sensed_by(self, vehicle: int, vehicles: int) -> tuple[str, ...] | None:
        """Return the fields that vehicle `vehicle` (from 0) of `vehicles` measures; None for all fields.

        Raise ScenarioError if the fields are given for another number of vehicles.
        """
        given = self.by_vehicle
        if len(given) not in (1, vehicles):
            many = f"vehicles {vehicles}, but camera fields are given for {len(given)} vehicles"
            raise ScenarioError(f"{many}: give one list of fields, or a list for each vehicle")
        return None if self.fields is None else given[vehicle % len(given)]


@dataclass(frozen=True, slots=True)
class EstimateOptions(Part):
    """Options of the estimator, which makes the map from the observations."""

    estimator: Any = option(
        None,
        "Estimator, NAME[:KEY=VALUE,...]: adaptive-disk, gp, epidemic, gp-sklearn, point, authors-ad, or"
        " FILE.py:NAME of your own",
        RUN,
        kind="estimator",
        metavar="NAME",
        default="epidemic on small farms with the benchmark's fields, else gp",
    )

    def check(self) -> None:
        """Convert the estimator to a `Choice`."""
        if self.estimator is not None:
            object.__setattr__(self, "estimator", choose(self.estimator, "estimator"))


@dataclass(frozen=True, slots=True)
class ScoreOptions(Part):
    """Options of the times at which the estimate is scored."""

    points: int | None = option(
        None,
        "Number of times that the estimate is scored during the flight",
        RUN,
        key="score_points",
        low=1,
        high=1_000_000,
        default="25; on a large farm 10, or 100 with adaptive-disk; fewer in a run of more than six flights;"
        " at each observation for the ideal vehicle on a small farm",
    )


class VehicleParts(Protocol):
    """Options that concern a vehicle, of a scenario or of a single vehicle of a run."""

    @property
    def vehicle(self) -> VehicleOptions:
        """Options of the vehicle and its autopilot."""

    @property
    def mission(self) -> MissionOptions:
        """Options of the mission."""

    @property
    def weather(self) -> WeatherOptions:
        """Options of wind and turbulence."""

    @property
    def camera(self) -> CameraOptions:
        """Options of the camera."""


class ScenarioKeywords(TypedDict, total=False):
    """Keywords of `Scenario`, which are the keys of all options and the names of the parts."""

    farm: str | FarmOptions
    crop: str | None
    farm_crs: str | None
    repair: bool
    day: int
    days: int
    flights_per_day: int
    fields: Sequence[str]
    world: str | None
    planner: Any
    policy: Any
    budget: str | None
    mission: str | MissionOptions | None
    partition: str
    altitude_m: float | None
    height_above_ground_m: float | None
    terrain: Sequence[str]
    terrain_frame: bool
    cruise_speed_m_s: float | None
    acceptance_radius_m: float | None
    max_altitude_m: float
    margin_m: float
    fence_m: float | None
    vehicle: str | VehicleOptions
    vehicles: int | None
    autopilot: str
    parameters: Mapping[str, float]
    gps_noise_m: float
    baro_noise_m: float
    estimate_errors: bool
    separation: str
    radio_range_m: float | None
    wind_speed_m_s: float
    wind_direction_deg: float
    wind_gust_m_s: float
    wind_height_m: float
    wind_shear: str | None
    wind_roughness_m: float
    wind_exponent: float
    turbulence: str | float | None
    camera_spacing_m: float | None
    camera_footprint: int
    camera_noise: float
    false_positive_rate: float
    false_negative_rate: float
    camera_fields: Sequence[str] | None
    camera_model: str | None
    gsd_cm: float | None
    front_overlap: float
    side_overlap: float
    camera_orientation: str
    estimator: Any
    score_points: int | None
    seed: int
    weather: WeatherOptions
    camera: CameraOptions
    estimate: EstimateOptions
    score: ScoreOptions
