"""What a plan gave: the mission, what it will take, and what an operator should know of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from geo import Farm
from mission.autopilots import GENERIC, PX4
from mission.model import Command, Mission, MissionItem
from mission.transfer import Rendered, Severity, render
from sim_vehicle.airframe.spec import VehicleSpec
from sim_vehicle.autopilot import firmware_of
from sim_vehicle.prediction.flight import Prediction

_TRIGGERS = (Command.DO_SET_CAM_TRIGG_DIST, Command.DO_SET_CAM_TRIGG_INTERVAL)


def turns_camera(item: MissionItem) -> bool | None:
    """Return whether an item has the camera take images from then on, or none any more; None: neither."""
    if item.command in _TRIGGERS:
        return bool(item.param1 and item.param1 > 0.0)
    return {int(Command.IMAGE_START_CAPTURE): True, int(Command.IMAGE_STOP_CAPTURE): False}.get(item.command)


@dataclass(frozen=True, slots=True)
class PlanResult:
    """A mission and what it will take.

    Parameters
    ----------
    planner : str or None
        The planner with its parameters; None for a mission file.
    seed : int
        The run's.
    path_m : float64[n, 2]
        The waypoints in metres of the farm frame.
    spacing_m : float or None
        Distance between neighbouring rows or rings; None where the planner has none.
    budget_text : str
        The budget in words.
    length_m : float
        Length over ground of the predicted flight, from take-off to landing.
    coverage : float
        Fraction of the owner's land that the camera's footprint passes over in that flight, while it is on.
    prediction : Prediction
        Time, energy and feasibility from the vehicle's own model.
    batteries : int or None
        How many the mission needs, changed at home; 0 for a vehicle without one, None if no number is enough.
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

    @property
    def misses_farm(self) -> bool:
        """Whether no waypoint lies on the farm, so that its camera sees nothing of it."""
        width, height = self.farm.width_cells, self.farm.height_cells
        ground = shapely.box(0.0, 0.0, width * self.farm.cell_size_m, height * self.farm.cell_size_m)
        return not shapely.MultiPoint(self.path_m).intersects(ground)

    @property
    def rendered(self) -> Rendered:
        """The mission as the vehicle's autopilot takes it; planned with the parameters of the vehicle."""
        firmware = firmware_of(self.vehicle)
        if firmware is None:
            return render(self.mission, GENERIC)
        mav_type = firmware.mavlink.identity.mav_type
        return render(self.mission, firmware.profile, mav_type, planned=dict(self.vehicle.parameters))

    @property
    def mav_autopilot(self) -> int:
        """MAV_AUTOPILOT for whom the mission is meant; PX4 for a vehicle of none, whose rules are its own."""
        firmware = firmware_of(self.vehicle)
        return PX4.autopilot if firmware is None else firmware.mavlink.identity.mav_autopilot

    @property
    def warnings(self) -> list[str]:
        """Return what an operator should know before flying, each in one line."""
        found = []
        if not self.prediction.feasible:
            found.append(f"the vehicle cannot fly this mission: {self.prediction.reason}")
        if not any(turns_camera(item) for item in self.mission.items):
            found.append("the mission never starts the camera: there will be no observations")
        if self.misses_farm:
            found.append(f"no waypoint lies on the farm {self.farm.name}: is this the right --farm?")
        found += [str(one) for one in self.rendered.remarks if one.severity is not Severity.NOTE]
        return found

    @property
    def battery_used(self) -> float | None:
        """Fraction of the battery that the flight takes, above 1 if that is too much; None without one."""
        if self.vehicle.battery is None:
            return None
        prediction = self.prediction
        return max(1.0 - prediction.battery_fraction, prediction.energy_wh / self.vehicle.battery.capacity_wh)

    def summary(self) -> dict[str, Any]:
        """Return plain values for JSON."""
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
            "feasible": self.prediction.feasible,
            "reason": self.prediction.reason,
            "warnings": self.warnings,
            "remarks": [remark.summary() for remark in self.rendered.remarks],
        }
