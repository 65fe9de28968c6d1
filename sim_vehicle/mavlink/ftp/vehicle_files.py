"""The files that each autopilot has at the start."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache, partial
from typing import TYPE_CHECKING, TypeAlias

from sim_vehicle.mavlink.ftp.files import FileTree, MadeFile, TakenFile
from sim_vehicle.mavlink.ftp.metadata import GENERAL_PATH, PARAMETERS_PATH, metadata_files
from sim_vehicle.mavlink.ftp.packed_parameters import packed, unpacked
from sim_vehicle.mavlink.ftp.packed_plan import PLAN_PATHS, pack_plan, unpack_plan

if TYPE_CHECKING:
    from mission.model import MissionType
    from sim_vehicle.autopilot.persona import Persona
    from sim_vehicle.autopilot.reference_parameters import ParameterDetails
    from sim_vehicle.mavlink.logs.flight_logs import FlightLogs
    from sim_vehicle.mavlink.parameters import ParameterSet
    from sim_vehicle.mavlink.plan_receiver import PlanReceiver

__all__ = ["general_metadata", "vehicle_files"]

Details: TypeAlias = "Callable[[], Mapping[str, ParameterDetails]]"

# The other files of @SYS tell of threads, memory, ports and storage of a board, which there is not.
_TASKS_PATH = "@SYS/tasks.txt"
# Vehicles of a fleet have almost equal tables; compressing one takes some hundredths of a second.
_metadata = lru_cache(maxsize=16)(metadata_files)


def vehicle_files(
    persona: Persona, parameters: ParameterSet, logs: FlightLogs, plans: PlanReceiver
) -> FileTree:
    """Return the tree of a vehicle; what takes time is made when it is first read."""
    made: dict[str, MadeFile] = {}
    taken: dict[str, TakenFile] = {}
    if persona.packed_parameters:
        made["@PARAM/param.pck"] = lambda query, read_size: packed(
            parameters.table, parameters.value, parameters.default, query, read_size
        )
        taken["@PARAM/param.pck"] = partial(_take_parameters, parameters)
    if persona.component_metadata is not None:
        for path in (GENERAL_PATH, PARAMETERS_PATH):
            made[path] = _read_only(parameters, persona.component_metadata, path)
    if persona.packed_plans:
        for mission_type, path in PLAN_PATHS.items():
            made[path] = partial(_packed_plan, plans, mission_type)
            taken[path] = partial(_take_plan, plans, mission_type)
    if persona.system_files:
        made[_TASKS_PATH] = _task_info
    habits = persona.logs
    return FileTree(
        ("/", habits.directory),
        made=made,
        mounted={habits.directory: lambda: logs.files(by_date=habits.by_date)},
        taken=taken,
    )


def _task_info(query: str, _read_size: int) -> bytes | None:
    """The statistics of a scheduler that runs no tasks: ArduPilot's header (``AP_Scheduler.cpp``) alone."""
    return None if query else b"TasksV2\n"


def _take_parameters(parameters: ParameterSet, data: bytes) -> bool:
    values = unpacked(data)
    for name, value in values or ():
        parameters.change(name, value)
    return values is not None


def _packed_plan(plans: PlanReceiver, mission_type: MissionType, query: str, _read_size: int) -> bytes | None:
    return None if query else pack_plan(mission_type, plans.server.items_on_wire(mission_type))


def _take_plan(plans: PlanReceiver, mission_type: MissionType, data: bytes) -> bool:
    plan = unpack_plan(data, mission_type)
    return plan is not None and plans.take_plan(mission_type, plan.items, plan.start)


def general_metadata(parameters: ParameterSet, details: Details) -> bytes:
    """Return the file that COMPONENT_METADATA names."""
    return _files(parameters, details)[GENERAL_PATH]


def _read_only(parameters: ParameterSet, details: Details, path: str) -> Callable[[str, int], bytes | None]:
    return lambda query, _read_size: None if query else _files(parameters, details)[path]


def _files(parameters: ParameterSet, details: Details) -> dict[str, bytes]:
    defaults = tuple(parameters.default(parameter.name) for parameter in parameters.table)
    return _metadata(parameters.table, defaults, details)
