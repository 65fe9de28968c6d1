"""Mission files of commands that check them: options, circumstances, the connected vehicle."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from wbf_mission.cli import options
from wbf_mission.cli.options import option
from wbf_mission.cli.output import Output
from wbf_mission.scenario import ScenarioError

if TYPE_CHECKING:
    from mission.model import Mission
    from wbf_mission.addons.base.inquiry import VehicleSnapshot
    from wbf_mission.preflight.subject import Circumstances


CHECKED = options.scenario_options(
    *("farm", "mission", "vehicle", "weather", "camera"),
    without=(
        *options.OF_DAYS,
        *("planner", "policy", "budget", "mission", "partition", "altitude_m", "cruise_speed_m_s"),
        *("acceptance_radius_m", "height_above_ground_m", "terrain", "terrain_frame", "fence_m"),
        *("front_overlap", "side_overlap", "vehicles", "separation", "radio_range_m", "gps_noise_m"),
        *("baro_noise_m", "estimate_errors", "camera_spacing_m", "camera_noise", "false_positive_rate"),
        *("false_negative_rate", "camera_fields", "seed"),
    ),
    defaults={"farm": None},
)
"""Decorator that adds the options of a check: farm, margin, camera, vehicle and weather."""


@dataclass(frozen=True, slots=True)
class Surroundings:
    """Options of a check that are not options of a run."""

    camera_interval: Annotated[
        float | None,
        option(
            "The camera's shortest interval between images, s.  [default: that of --camera; 0.01, the leaf"
            " camera's]",
            panel=options.CHECK_PANEL,
            parser=options.number,
        ),
    ] = None

    def circumstances(self, given: options.Given, mission: Mission, output: Output) -> Circumstances:
        """Return the circumstances of a check from the command line, and print the notes of the farm."""
        from sim_vehicle.camera.component import MIN_INTERVAL_S
        from wbf_mission.planning.imaging import imaging_of
        from wbf_mission.preflight.subject import Circumstances, level_of_plan
        from wbf_mission.run.resolve import farm_of

        interval_s = self.camera_interval
        if interval_s is not None and not 0.0 < interval_s <= 3600.0:
            msg = f"--camera-interval {interval_s:g} is out of range: give seconds above 0, up to 3600"
            raise ScenarioError(msg)
        chosen, named = given.scenario(), given.farm()
        farm = None if named is None else farm_of(named)[0]
        output.notes(() if farm is None else farm.notes, "farm")
        imaging = None
        if chosen.camera.model is not None:
            imaging = imaging_of(chosen.camera, chosen.mission, level_of_plan(mission, chosen.vehicle))
        if interval_s is None and imaging is not None:
            interval_s = imaging.camera.min_interval_s
        return Circumstances(
            chosen.vehicle,
            chosen.weather,
            farm,
            chosen.mission.margin_m,
            chosen.mission.max_altitude_m,
            MIN_INTERVAL_S if interval_s is None else interval_s,
            footprint=chosen.camera.footprint,
            imaging=imaging,
        )


def read_and_report(file: Path, output: Output) -> Mission:
    """Return the mission of a file, and print the notes of its reader."""
    from mission.files import open_mission

    mission, notes = open_mission(file)
    output.notes(notes, file.name)
    return mission


def fitted_circumstances(
    circumstances: Circumstances, given: options.Given, snapshot: VehicleSnapshot
) -> Circumstances:
    """Return the circumstances with the autopilot of the connected vehicle.

    Without ``--vehicle``, a typical vehicle of the connected vehicle's kind is assumed. ScenarioError if
    ``--autopilot`` names another autopilot.
    """
    from mission.transfer.vehicles import Vehicle
    from wbf_mission.addons.base.links import fitted_to, typical_vehicle
    from wbf_mission.scenario import scenario_with

    chosen = given.scenario()
    heard = Vehicle(snapshot.system_id, 1, snapshot.autopilot, snapshot.vehicle_type)
    assumed = given.file is None and "vehicle" not in given.changes
    if assumed:
        chosen = scenario_with(chosen, {"vehicle": typical_vehicle(heard)})
    fitted, autopilot = fitted_to(chosen, heard), given.changes.get("autopilot")
    if autopilot not in (None, fitted.vehicle.autopilot):
        msg = f"--autopilot {autopilot}, but {heard.profile.name} is heard: leave --autopilot out"
        raise ScenarioError(msg)
    return replace(circumstances, vehicle=fitted.vehicle, assumed=assumed, snapshot=snapshot)
