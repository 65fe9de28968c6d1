"""Component metadata: what a vehicle tells of itself in files.

Formats: https://mavlink.io/en/services/component_metadata.html, and ``parameter.schema.json`` of
https://github.com/mavlink/mavlink/tree/master/component_metadata; the version that PX4 writes is 1.
"""

from __future__ import annotations

import json
import lzma
import math
from collections.abc import Callable, Mapping

from sim_vehicle.autopilot.parameters import MavParameter, ParameterDetails
from sim_vehicle.mavlink.ftp.server import checksum

__all__ = ["GENERAL_PATH", "PARAMETERS_PATH", "metadata_files", "uri"]

GENERAL_PATH = "/etc/extras/component_general.json.xz"
PARAMETERS_PATH = "/etc/extras/parameters.json.xz"
_TYPE_PARAMETERS = 1
# The readers in ground stations are small ones: they know this checksum only.
_FILTERS = [{"id": lzma.FILTER_LZMA2, "preset": 6, "dict_size": 1 << 16}]


def metadata_files(
    table: tuple[MavParameter, ...],
    defaults: tuple[float, ...],
    details: Callable[[], Mapping[str, ParameterDetails]],
) -> dict[str, bytes]:
    """Return the files by path: the general one, which names the others, and that of the parameters.

    Parameters
    ----------
    table : tuple of MavParameter
    defaults : tuple of float
        The value of each at the start, in its own unit.
    details : callable
        Returns what the autopilot tells of its parameters, by name; those without are told as the table has
        them.
    """
    known = details()
    entries = [
        _entry(parameter, default, known.get(parameter.name))
        for parameter, default in zip(table, defaults, strict=True)
    ]
    parameters = _compressed({"version": 1, "parameters": entries})
    types = [{"type": _TYPE_PARAMETERS, "uri": uri(PARAMETERS_PATH), "fileCrc": checksum(parameters)}]
    return {GENERAL_PATH: _compressed({"version": 1, "metadataTypes": types}), PARAMETERS_PATH: parameters}


def uri(path: str) -> str:
    """Address of a file of the vehicle, for clients.

    Examples
    --------
    >>> uri(GENERAL_PATH)
    'mftp://etc/extras/component_general.json.xz'
    """
    return f"mftp:/{path}"


def _entry(parameter: MavParameter, default: float, details: ParameterDetails | None) -> dict[str, object]:
    number: Callable[[float], float] = round if parameter.integer else float
    entry: dict[str, object] = {
        "name": parameter.name,
        "type": f"Int{parameter.bits}" if parameter.integer else "Float",
        "default": number(default),
        "group": details.group if details else parameter.name.split("_", 1)[0],
    }
    ranged = details or parameter
    for key, limit in (("min", ranged.low), ("max", ranged.high)):
        if math.isfinite(limit):
            entry[key] = number(limit)
    if parameter.unit:
        entry["units"] = parameter.unit
    if details:
        entry |= _told(details, number)
    return entry


def _told(details: ParameterDetails, number: Callable[[float], float]) -> dict[str, object]:
    told: dict[str, object] = {}
    if details.decimals is not None:
        told["decimalPlaces"] = details.decimals
    if details.increment is not None:
        told["increment"] = number(details.increment)
    if details.reboot:
        told["rebootRequired"] = True
    if details.values:
        told["values"] = [{"value": number(value), "description": label} for value, label in details.values]
    if details.bits:
        told["bitmask"] = [{"index": bit, "description": label} for bit, label in details.bits]
    return told


def _compressed(value: object) -> bytes:
    text = json.dumps(value, separators=(",", ":"), sort_keys=True)
    return lzma.compress(text.encode("ascii"), lzma.FORMAT_XZ, lzma.CHECK_CRC32, filters=_FILTERS)
