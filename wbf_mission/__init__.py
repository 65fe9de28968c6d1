"""Public API of the project: plan, fly, estimate and score (docs/api.md).

>>> import wbf_mission
>>> wbf_mission.Scenario(farm="miniberry-10", planner="lawnmower").farm.name
'miniberry-10'
"""

from typing import TYPE_CHECKING

from wbf_mission.packages import require_packages

require_packages()

if TYPE_CHECKING:
    from geo.errors import FarmError as FarmError
    from geo.errors import WbfMissionError as WbfMissionError
    from geo.farm import Farm as Farm
    from geo.farm_file import load_farm as load_farm
    from geo.farms import get_farm as get_farm
    from mission.errors import LinkError as LinkError
    from mission.errors import MissionFileError as MissionFileError
    from mission.errors import PlanningError as PlanningError
    from mission.errors import TransferError as TransferError
    from mission.files import read_mission as read_mission
    from mission.files import write_mission as write_mission
    from mission.ground.link import download as download
    from mission.ground.link import upload as upload
    from mission.model import Mission as Mission
    from mission.outcome import Outcome as Outcome
    from mission.planners import CropArea as CropArea
    from mission.planners import PlannedPath as PlannedPath
    from mission.planners import Planner as Planner
    from mission.planners import PlanningRequest as PlanningRequest
    from mission.planners import make_planner as make_planner
    from mission.policies.decision import NO_CHANGE as NO_CHANGE
    from mission.policies.decision import Decision as Decision
    from mission.policies.observation import Event as Event
    from mission.policies.observation import PolicyObservation as PolicyObservation
    from mission.policies.observation import Status as Status
    from mission.policies.observation import VehicleReport as VehicleReport
    from mission.policies.policy import Policy as Policy
    from mission.policies.policy import Triggers as Triggers
    from mission.policies.policy import make_policy as make_policy
    from sensors.errors import EstimatorError as EstimatorError
    from sensors.estimators.base import BaseEstimator as BaseEstimator
    from sensors.estimators.base import Estimator as Estimator
    from sensors.estimators.base import make_estimator as make_estimator
    from sensors.fields import PAPER_FIELDS as PAPER_FIELDS
    from sensors.fields import FieldSet as FieldSet
    from sensors.observations import Observations as Observations
    from sensors.scoring.information import InformationModel as InformationModel
    from sensors.scoring.score import ScoreWeights as ScoreWeights
    from sim_vehicle.airframe.catalog import get_vehicle as get_vehicle
    from sim_vehicle.errors import VehicleError as VehicleError
    from sim_vehicle.host.injection import Fault as Fault
    from sim_vehicle.host.simulation import Simulation as Simulation
    from sim_vehicle.mavlink import SimVehicle as SimVehicle
    from wbf_mission.bench.benchmark import benchmark as benchmark
    from wbf_mission.bench.spec import BenchSpec as BenchSpec
    from wbf_mission.contracts import check_estimator as check_estimator
    from wbf_mission.contracts import check_planner as check_planner
    from wbf_mission.contracts import check_policy as check_policy
    from wbf_mission.events import EventStream as EventStream
    from wbf_mission.flight import LiveLink as LiveLink
    from wbf_mission.flight import Simulated as Simulated
    from wbf_mission.flight import fly as fly
    from wbf_mission.results.result import Result as Result
    from wbf_mission.results.result import load_result as load_result
    from wbf_mission.results.storage import ResultError as ResultError
    from wbf_mission.run.plan import plan as plan
    from wbf_mission.run.resolve import FlightError as FlightError
    from wbf_mission.run.reuse import FlightMemory as FlightMemory
    from wbf_mission.scenario import Scenario as Scenario
    from wbf_mission.scenario import ScenarioError as ScenarioError
    from wbf_mission.scenario import load_scenario as load_scenario
    from wbf_mission.scenario import scenario_with as scenario_with
    from wbf_mission.version import __version__ as __version__
else:
    from geo.imports import attach

    __getattr__, __dir__, __all__ = attach(__name__)
