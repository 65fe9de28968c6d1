"""The parts of a scenario. Each holds its options, checks them, and goes only to who needs it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, TypedDict

from sim_vehicle.airframe.autopilot_names import DEFAULT_AUTOPILOT, autopilot_names
from wbf_mission.scenario.choice import Choice, choose
from wbf_mission.scenario.option import Option, Part, ScenarioError, names_in, option
from wbf_mission.scenario.values import (
    Separation,
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
"""The budget of a plan that several batteries, or several flights, are to fly."""
_USE_UP = ("lawnmower", "adaptive-lawnmower", "spiral", "random-waypoint")
LAST_DAY = 126
"""The last day of an environment."""
MOST_VEHICLES = 10
PARTITIONS = ("strips", "voronoi", "none")
"""How a fleet shares the farm, as `mission.policies.allocation.PARTITION_NAMES`."""
ORIENTATIONS = ("landscape", "portrait")
CAMERA_OF_PLANS = ("camera_model", "gsd_cm", "front_overlap", "side_overlap", "camera_orientation")
"""The options of a camera by sensor and lens, which only plans have: flights have the leaf camera."""
LEVELS = ("light", "moderate", "severe", "wind")
"""The words for turbulence; wind: as strong as the mean wind makes it."""
MAX_ALTITUDE_M = 120.0
"""Open category (EU 2019/947); 400 ft of 14 CFR 107.51 are 122 m."""
_CEILING_M = 3000.0


@dataclass(frozen=True, slots=True)
class FarmOptions(Part):
    """Where, and on which day of the environment."""

    name: str = option(
        "miniberry-30",
        "Farm: a name (see 'wbf-mission farm list') or a file: GeoJSON, KML/KMZ, Shapefile, GeoPackage, GPX,"
        " Mission Planner's .poly",
        RUN,
        key="farm",
        kind="farm",
    )
    day: int = option(
        6, "Day of the environment that is flown, or the first of them", RUN, low=0, high=LAST_DAY
    )
    days: int = option(1, "How many days are flown, one after the other", RUN, low=1, high=LAST_DAY)
    flights_per_day: int = option(
        1, "Flights a day, each with full batteries and the whole budget", RUN, low=1, high=100
    )
    fields: tuple[str, ...] = option(
        ("tylcv", "ccr", "soil"),
        "What there is to sense and to score: tylcv, ccr, soil, and field files (.toml)",
        RUN,
        metavar="NAMES",
        default="tylcv,ccr,soil",
        read=names_in,
    )
    world: str | None = option(
        None,
        "How the fields really develop, which nobody but the environment knows: a built-in world, such as"
        " wrong-rates, or a .toml file",
        RUN,
        metavar="NAME",
        default="as is published of the fields",
    )
    crop: str | None = option(
        None, "Crop of those patches of a farm file that tell none", RUN, metavar="NAME", default="crop"
    )
    crs: str | None = option(
        None,
        "Coordinate system of a farm file that does not tell its own, such as EPSG:32617",
        RUN,
        key="farm_crs",
        metavar="CODE",
        default="WGS 84, if its coordinates are degrees",
    )
    repair: bool = option(False, "Mend a farm file's broken polygons where that is safe, and say what", RUN)

    def load(self) -> Farm:
        """Return the farm; FarmError if there is none, or its file cannot be used."""
        from geo.farms import get_farm

        return get_farm(self.name, crop=self.crop, crs=self.crs, repair=self.repair)

    def load_world(self) -> World | None:
        """Return how the fields really develop, if told; EnvironmentDataError if it cannot be used."""
        if self.world is None:
            return None
        from sensors.environment.world import World

        return World.load(self.world)

    def check(self) -> None:
        """Refuse a farm on which nothing is sensed, and days beyond the last."""
        if self.day + self.days - 1 > LAST_DAY:
            msg = (
                f"days {self.days} from day {self.day} on: the environment ends at day {LAST_DAY}; give fewer"
            )
            raise ScenarioError(msg)
        if not self.fields:
            msg = "fields are empty: give at least one, such as tylcv, or leave the option out"
            raise ScenarioError(msg)


@dataclass(frozen=True, slots=True)
class MissionOptions(Part):
    """What is flown: a mission file, or what a planner makes within a budget.

    ``budget`` None is the vehicle's battery less its reserve; for the ideal vehicle 0.4 times the owner's
    cells in timesteps, as in the paper. ``acceptance_radius_m`` None is what the autopilot can hold
    (`mission.planners.cornering.Cornering`).
    """

    planner: Any = option(
        _SPIRAL,
        "Planner, NAME[:KEY=VALUE,...]: lawnmower, adaptive-lawnmower, spiral, random-waypoint, survey,"
        " or one of yours",
        RUN,
        kind="planner",
        not_with=("mission", "policy"),
        metavar="NAME",
    )
    policy: Any = option(
        None,
        "Policy that decides in flight where to go next, NAME[:KEY=VALUE,...]: greedy,"
        " orienteering, rolling-horizon, refining-lawnmower, confidence-guided, grid-limited-randomness,"
        " market, or one of yours",
        RUN,
        kind="policy",
        not_with=("mission",),
        metavar="NAME",
        default="none: the planner's path is flown as it is",
    )
    budget: str | None = option(
        None,
        "How much each vehicle may fly, before it is cut into sorties for its batteries: 8000m, 2.5km, 25min,"
        " 1500s, 50Wh or 360steps; unlimited: as much as a survey takes, whatever the battery holds",
        RUN,
        default="the battery less its reserve; ideal: 0.4 x the owner's cells in steps",
        example="60s",
        not_with=("mission",),
    )
    file: str | None = option(
        None,
        "Fly this mission file (.plan, .waypoints, .json) instead of planning",
        RUN,
        key="mission",
        metavar="FILE",
    )
    partition: str = option(
        PARTITIONS[0],
        "How the vehicles of a fleet share the farm when a planner plans",
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
        default="the vehicle's",
        not_with=("mission",),
    )
    height_above_ground_m: float | None = option(
        None,
        "Flight height above the ground, which --terrain tells, or the autopilot knows (--terrain-frame)",
        VEHICLE,
        low=0.5,
        high=_CEILING_M,
        default="as --altitude above home",
        not_with=("mission", "altitude_m"),
    )
    max_altitude_m: float = option(
        MAX_ALTITUDE_M,
        "Greatest height of a flight that your permission allows; most rules allow 120 m without one",
        VEHICLE,
        low=1.0,
        high=_CEILING_M,
    )
    terrain: tuple[str, ...] = option(
        (),
        "Rasters of the ground's heights, GeoTIFF or SRTM (.hgt): plans follow the ground within 1 m",
        VEHICLE,
        metavar="FILES",
        default="flat ground",
        read=names_in,
        not_with=("mission", "policy"),
        needs="height_above_ground_m",
    )
    terrain_frame: bool = option(
        False,
        "Write heights above the terrain (MAVLink frame 10) for an autopilot that follows it by itself",
        VEHICLE,
        not_with=("mission", "policy"),
        needs="height_above_ground_m",
    )
    cruise_speed_m_s: float | None = option(
        None, "Flight speed", VEHICLE, low=0.1, high=30.0, default="the vehicle's", not_with=("mission",)
    )
    acceptance_radius_m: float | None = option(
        None,
        "Of the planned waypoints",
        VEHICLE,
        low=0.05,
        high=50.0,
        default="2 m; ArduCopter and rovers: their own",
        not_with=("mission",),
    )
    margin_m: float = option(
        2.0,
        "How far the flown path stays away from the farm's obstacles and from the fence of a mission file",
        RUN,
        low=0.0,
        high=1000.0,
    )
    fence_m: float | None = option(
        None,
        "Fence about the owner's land: so far outside of its border, and about obstacles that bar the way",
        RUN,
        low=1.0,
        high=1000.0,
        default="none",
        not_with=("mission",),
    )

    def check(self) -> None:
        """Take planner and policy as `Choice`."""
        object.__setattr__(self, "planner", choose(self.planner, "planner"))
        if self.policy is not None:
            object.__setattr__(self, "policy", choose(self.policy, "policy"))
        if self.height_above_ground_m is not None and bool(self.terrain) == self.terrain_frame:
            msg = (
                f"height above ground {self.height_above_ground_m:g} m: give either --terrain with the"
                " ground's heights, or --terrain-frame for an autopilot that knows them"
            )
            raise ScenarioError(msg)
        for name in ("altitude_m", "height_above_ground_m"):
            height_m = getattr(self, name)
            if height_m is not None and height_m > self.max_altitude_m:
                what = name.removesuffix("_m").replace("_", " ")
                msg = (
                    f"{what} {height_m:g} m is above {self.max_altitude_m:g} m: fly lower, or with a"
                    " permission give a greater max altitude"
                )
                raise ScenarioError(msg)
        endless = self.budget is not None and self.budget.strip().lower() == UNLIMITED
        if endless and (self.policy is not None or self.planner.chosen in _USE_UP):
            who = f"planner {self.planner}" if self.policy is None else f"policy {self.policy}"
            msg = (
                f"budget unlimited: {who} uses up what it is given; give a length or a time, or plan a survey"
            )
            raise ScenarioError(msg)


@dataclass(frozen=True, slots=True)
class VehicleOptions(Part):
    """Who flies, and how wrong they are about their position."""

    name: str = option(
        "quad",
        "One of 'wbf-mission vehicle list', such as quad or ideal (the paper's robot), or a .toml file;"
        " several, separated by commas, fly together",
        VEHICLE,
        key="vehicle",
        kind="vehicle",
    )
    vehicles: int | None = option(
        None,
        "How many such vehicles fly together",
        VEHICLE,
        low=1,
        high=MOST_VEHICLES,
        default="as many as --vehicle or --autopilot names",
    )
    autopilot: str = option(
        DEFAULT_AUTOPILOT,
        "Whose way of flying, modes and habits; several, separated by commas, are one for each vehicle",
        VEHICLE,
        choices=autopilot_names(),
        kind="autopilot",
        each=True,
    )
    parameters: dict[str, float] = option(
        dict,
        "A parameter of the autopilot, such as MPC_ACC_HOR=4; may be repeated",
        VEHICLE,
        flag="--param",
        metavar="NAME=VALUE",
        read=parameter_values,
        default="the autopilot's own",
    )
    gps_noise_m: float = option(
        0.0, "Slow error of satellite positions, one sigma along an axis", VEHICLE, low=0.0, high=20.0
    )
    baro_noise_m: float = option(
        0.0, "Slow error of the barometer's height, one sigma", VEHICLE, low=0.0, high=5.0
    )
    estimate_errors: bool = option(
        True,
        "A PX4 multirotor flies by an estimate that errs as the real one's: its height jumps in the first two"
        " minutes, its velocities are off; other vehicles' estimates are exact",
        VEHICLE,
    )

    separation: str = option(
        "layers:2m",
        "How the vehicles of a fleet keep apart: layers:METRES (each at a height of its own), distance:METRES"
        " (at one height, later if need be), or none; farther by what they err about where they are;"
        " the paper's robots need nothing",
        VEHICLE,
        needs_fleet=True,
        metavar="WAY",
    )
    radio_range_m: float | None = option(
        None,
        "How far the radio of the ground station at home reaches; what a vehicle sees farther away arrives"
        " when it is back",
        VEHICLE,
        low=1.0,
        high=1e6,
        default="everywhere",
    )

    def check(self) -> None:
        """Refuse an empty name among several, and more vehicles than named or fewer."""
        names = self.names
        if not all(names):
            msg = (
                f"vehicle {self.name!r} has an empty name: give names separated by commas, such as quad,quad"
            )
            raise ScenarioError(msg)
        if len(names) > MOST_VEHICLES:
            msg = f"vehicle names {len(names)} vehicles: at most {MOST_VEHICLES} fly together"
            raise ScenarioError(msg)
        for what, given in (("vehicle", names), ("autopilot", self.autopilot.split(","))):
            if len(given) not in (1, len(self.fleet)):
                msg = f"vehicles {len(self.fleet)}, but {what} names {len(given)}: give one name, or as many"
                raise ScenarioError(msg)
        parse_separation(self.separation)

    @property
    def keeps(self) -> Separation:
        """How the vehicles keep apart."""
        return parse_separation(self.separation)

    @property
    def names(self) -> tuple[str, ...]:
        """The names in `name`."""
        return tuple(part.strip() for part in self.name.split(","))

    @property
    def fleet(self) -> tuple[str, ...]:
        """The name of each vehicle that flies, in the order of their system ids.

        >>> VehicleOptions("quad", vehicles=2).fleet, VehicleOptions("quad,ideal").fleet
        (('quad', 'quad'), ('quad', 'ideal'))
        """
        names = self.names
        count = self.vehicles or max(len(names), self.autopilot.count(",") + 1)
        return names if len(names) > 1 else names * count

    @property
    def autopilots(self) -> tuple[str, ...]:
        """The autopilot of each of them.

        >>> VehicleOptions("quad", autopilot="px4,ardupilot").autopilots, VehicleOptions().autopilots
        (('px4', 'ardupilot'), ('px4',))
        """
        given = tuple(part.strip() for part in self.autopilot.split(","))
        return given if len(given) > 1 else given * len(self.fleet)


@dataclass(frozen=True, slots=True)
class WeatherOptions(Part):
    """The air: mean wind, how it grows with the height, gusts or Dryden's turbulence."""

    wind_speed_m_s: float = option(0.0, "Mean wind", VEHICLE, low=0.0, high=40.0, flag=None)
    wind_direction_deg: float = option(
        0.0, "From where, clockwise from north", VEHICLE, low=0.0, high=360.0, flag=None
    )
    wind_gust_m_s: float = option(0.0, "Standard deviation of gusts", VEHICLE, low=0.0, high=15.0, flag=None)
    wind_height_m: float = option(
        10.0, "Height at which the mean wind holds", VEHICLE, low=1.0, high=300.0, flag=None
    )
    wind_shear: str | None = option(
        None, "How the wind grows with the height", VEHICLE, choices=("log", "power", "sitl"), flag=None
    )
    wind_roughness_m: float = option(
        0.1, "Roughness length of the logarithmic law", VEHICLE, low=1e-5, high=0.7, flag=None
    )
    wind_exponent: float = option(
        1.0 / 7.0, "Exponent of the power law", VEHICLE, low=0.0, high=1.0, flag=None
    )
    turbulence: str | float | None = option(
        None,
        "Dryden gusts (MIL-F-8785C): light, moderate, severe, wind (what --wind makes), or the wind at 6 m"
        " in m/s",
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
            "Wind: m/s, degrees, m/s; for example 5,270,1.5",
            VEHICLE,
            flag="--wind",
            metavar="SPEED,FROM[,GUST]",
            default="calm",
            sets=("wind_speed_m_s", "wind_direction_deg", "wind_gust_m_s"),
            read=wind_values,
        ),
        Option(
            "wind_shear",
            "How the wind grows with the height: log[,ROUGHNESS[,HEIGHT]] or power[,EXPONENT[,HEIGHT]];"
            " HEIGHT, m, is that of --wind (only with --wind); sitl: as in ArduPilot's simulator, the root of"
            " h/60 m, --wind at 60 m and above",
            VEHICLE,
            flag="--wind-shear",
            metavar="LAW[,VALUE[,HEIGHT]]",
            default="not at all; log,0.1,10; power,0.143,10",
            sets=("wind_shear", "wind_roughness_m", "wind_exponent", "wind_height_m"),
            read=shear_values,
            needs="wind_speed_m_s",
        ),
    )

    def check(self) -> None:
        """Refuse unknown levels of turbulence, and two kinds of gusts at once."""
        if isinstance(self.turbulence, str) and self.turbulence not in LEVELS:
            allowed = ", ".join(LEVELS) + ", or the wind at 6 m in m/s"
            msg = f"turbulence {self.turbulence!r} is out of range: give {allowed}"
            raise ScenarioError(msg)
        if self.turbulence is not None and self.wind_gust_m_s > 0.0:
            gust = f"a wind gust of {self.wind_gust_m_s:g} m/s"
            msg = f"turbulence {self.turbulence} and {gust}: give one of them"
            raise ScenarioError(msg)


@dataclass(frozen=True, slots=True)
class CameraOptions(Part):
    """The leaf camera: where it looks, what it senses and how wrong it is."""

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
        1, "Cells on a side of the footprint", CAMERA, key="camera_footprint", low=1, high=15
    )
    noise: float = option(
        0.0, "Standard deviation of the noise", CAMERA, key="camera_noise", low=0.0, high=1.0
    )
    false_positive_rate: float = option(
        0.0, "Share of the healthy leaves that are seen as infected", CAMERA, low=0.0, high=1.0
    )
    false_negative_rate: float = option(
        0.0, "Share of the infected leaves that are seen as healthy", CAMERA, low=0.0, high=1.0
    )
    fields: tuple[str, ...] | None = option(
        None,
        "Fields that are measured, such as tylcv,soil; of a fleet for each vehicle, as tylcv,ccr;soil",
        CAMERA,
        key="camera_fields",
        metavar="NAMES",
        default="all",
        read=names_in,
    )

    model: str | None = option(
        None,
        "A camera by sensor and lens, such as dji-p1-35, or a .toml file: it decides how far apart rows and"
        " images are, and how fast the flight may be",
        CAMERA,
        key="camera_model",
        flag="--camera",
        metavar="NAME",
        default="the leaf camera",
        not_with=("mission",),
    )
    gsd_cm: float | None = option(
        None,
        "What a pixel of the camera shows of the ground; it decides the height",
        CAMERA,
        low=0.01,
        high=100.0,
        default="that of the height",
        needs="camera_model",
        not_with=("mission",),
    )
    front_overlap: float = option(
        0.75,
        "Share of an image that the next one shows again",
        CAMERA,
        low=0.0,
        high=0.95,
        needs="camera_model",
    )
    side_overlap: float = option(
        0.7,
        "Share of an image that those of the next row show again",
        CAMERA,
        low=0.0,
        high=0.95,
        needs="camera_model",
    )
    orientation: str = option(
        ORIENTATIONS[0],
        "How the camera is mounted: the long side of the image across the flight, or along it",
        CAMERA,
        key="camera_orientation",
        choices=ORIENTATIONS,
        needs="camera_model",
    )

    def check(self) -> None:
        """Refuse a camera that measures nothing, and one whose images are spaced in two ways."""
        if self.fields is not None and not all(self.by_vehicle):
            msg = "camera fields are empty: give at least one, such as tylcv, or leave the option out"
            raise ScenarioError(msg)
        if self.model is not None and self.spacing_m is not None:
            msg = f"camera {self.model}: its front overlap spaces the images; leave the camera spacing out"
            raise ScenarioError(msg)

    @property
    def by_vehicle(self) -> tuple[tuple[str, ...], ...]:
        """The names in `fields`, of each vehicle if a semicolon separates them.

        >>> CameraOptions(fields=("tylcv", "ccr;soil")).by_vehicle
        (('tylcv', 'ccr'), ('soil',))
        """
        return tuple(names_in(part) for part in ",".join(self.fields or ()).split(";"))

    def sensed_by(self, vehicle: int, vehicles: int) -> tuple[str, ...] | None:
        """Return the fields that a vehicle of so many, from 0, measures; None: all.

        ScenarioError if they are given for another number of vehicles.
        """
        given = self.by_vehicle
        if len(given) not in (1, vehicles):
            many = f"vehicles {vehicles}, but camera fields are those of {len(given)}"
            msg = f"{many}: give them once, or for each"
            raise ScenarioError(msg)
        return None if self.fields is None else given[vehicle % len(given)]


@dataclass(frozen=True, slots=True)
class EstimateOptions(Part):
    """Who makes the map from what was seen."""

    estimator: Any = option(
        None,
        "Estimator, NAME[:KEY=VALUE,...]: adaptive-disk, gp, epidemic, gp-sklearn, point, authors-ad or one"
        " of yours",
        RUN,
        kind="estimator",
        metavar="NAME",
        default="the best that the farm can afford: epidemic on small farms, gp on others",
    )

    def check(self) -> None:
        """Take the estimator as a `Choice`."""
        if self.estimator is not None:
            object.__setattr__(self, "estimator", choose(self.estimator, "estimator"))


@dataclass(frozen=True, slots=True)
class ScoreOptions(Part):
    """How the estimate is scored."""

    points: int | None = option(
        None,
        "How often the estimate is scored on the way",
        RUN,
        key="score_points",
        low=1,
        high=1_000_000,
        default="25; Waterberry 10, with the disks 100; fewer in a run of more than six flights; ideal"
        " vehicle on a small farm: always",
    )


class VehicleParts(Protocol):
    """What has the options that concern one vehicle: a scenario, or one of the vehicles of a run."""

    @property
    def vehicle(self) -> VehicleOptions:
        """Who flies."""

    @property
    def mission(self) -> MissionOptions:
        """What it flies."""

    @property
    def weather(self) -> WeatherOptions:
        """In which air."""

    @property
    def camera(self) -> CameraOptions:
        """What it looks with."""


class ScenarioKeywords(TypedDict, total=False):
    """What `Scenario` takes: each option by its key, and whole parts by the names of the parts."""

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
