"""Component metadata: what a vehicle tells of itself in files.

Formats: https://mavlink.io/en/services/component_metadata.html.
"""

from __future__ import annotations

import json
import lzma
import math

from sim_vehicle.autopilot.mav_parameter import MavParameter
from sim_vehicle.mavlink.ftp.server import checksum

__all__ = ["GENERAL_PATH", "PARAMETERS_PATH", "metadata_files", "uri"]

GENERAL_PATH = "/etc/extras/component_general.json.xz"
PARAMETERS_PATH = "/etc/extras/parameters.json.xz"
_TYPE_PARAMETERS = 1
# The readers in ground stations are small ones: they know this checksum only.
_FILTERS = [{"id": lzma.FILTER_LZMA2, "preset": 6, "dict_size": 1 << 16}]


def metadata_files(table: tuple[MavParameter, ...]) -> dict[str, bytes]:
    """Return the files by path: the general one, which names the others, and that of the parameters."""
    parameters = _compressed({"version": 1, "parameters": [_entry(parameter) for parameter in table]})
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


def _entry(parameter: MavParameter) -> dict[str, object]:
    entry: dict[str, object] = {
        "name": parameter.name,
        "type": f"Int{parameter.bits}" if parameter.integer else "Float",
        "default": round(parameter.value) if parameter.integer else parameter.value,
        "group": parameter.name.split("_", 1)[0],
    }
    for key, limit in (("min", parameter.low), ("max", parameter.high)):
        if math.isfinite(limit):
            entry[key] = round(limit) if parameter.integer else limit
    if parameter.unit:
        entry["units"] = parameter.unit
    return entry


def _compressed(value: object) -> bytes:
    text = json.dumps(value, separators=(",", ":"), sort_keys=True)
    return lzma.compress(text.encode("ascii"), lzma.FORMAT_XZ, lzma.CHECK_CRC32, filters=_FILTERS)
