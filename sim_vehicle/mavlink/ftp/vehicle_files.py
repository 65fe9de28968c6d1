"""The files that each autopilot has at the start."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING

from sim_vehicle.mavlink.ftp.files import FileTree, MadeFile
from sim_vehicle.mavlink.ftp.metadata import GENERAL_PATH, PARAMETERS_PATH, metadata_files
from sim_vehicle.mavlink.ftp.packed_parameters import packed

if TYPE_CHECKING:
    from sim_vehicle.autopilot.persona import Persona
    from sim_vehicle.mavlink.logs.flight_logs import FlightLogs
    from sim_vehicle.mavlink.parameters import ParameterSet

__all__ = ["general_metadata", "vehicle_files"]

# Vehicles of a fleet have almost equal tables; compressing one takes some hundredths of a second.
_metadata = lru_cache(maxsize=16)(metadata_files)


def vehicle_files(persona: Persona, parameters: ParameterSet, logs: FlightLogs) -> FileTree:
    """Return the tree of a vehicle; what takes time is made when it is first read."""
    made: dict[str, MadeFile] = {}
    if persona.packed_parameters:
        made["@PARAM/param.pck"] = lambda query, read_size: packed(
            parameters.table, parameters.value, parameters.default, query, read_size
        )
    if persona.component_metadata:
        for path in (GENERAL_PATH, PARAMETERS_PATH):
            made[path] = _read_only(parameters, path)
    habits = persona.logs
    return FileTree(
        ("/", habits.directory),
        made=made,
        mounted={habits.directory: lambda: logs.files(by_date=habits.by_date)},
    )


def general_metadata(parameters: ParameterSet) -> bytes:
    """Return the file that COMPONENT_METADATA names."""
    return _metadata(parameters.table)[GENERAL_PATH]


def _read_only(parameters: ParameterSet, path: str) -> Callable[[str, int], bytes | None]:
    return lambda query, _read_size: None if query else _metadata(parameters.table)[path]
