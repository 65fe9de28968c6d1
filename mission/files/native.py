"""Native mission file: JSON that keeps every value of a `Mission` exactly.

::

    {
      "format": "wbf-mission",
      "version": 1,
      "home": {"latitude_deg": 28.05, "longitude_deg": -82.15, "altitude_m": 30.0},
      "cruise_speed_m_s": 15.0,
      "hover_speed_m_s": 5.0,
      "items": [
        {"command":16,"frame":3,"params":[0.0,1.0,0.0,null],"x":28.05,"y":-82.15,"z":10.0,"autocontinue":true}
      ],
      "fence": [],
      "rally": []
    }
"""

from __future__ import annotations

from dataclasses import astuple
from typing import Annotated

import msgspec
from msgspec import Meta

from mission.errors import MissionFileError
from mission.files.common import (
    NATIVE_KIND,
    Firmware,
    Parameters,
    check_json,
    decode_json,
    file_parameters,
    home_of,
    make_item,
    make_mission,
)
from mission.model import MAX_ITEMS, Mission, MissionItem

VERSION = 1


class _Version(msgspec.Struct):
    version: int


class _Home(msgspec.Struct, forbid_unknown_fields=True):
    latitude_deg: float
    longitude_deg: float
    altitude_m: float = 0.0


class _Item(msgspec.Struct, forbid_unknown_fields=True):
    command: Annotated[int, Meta(ge=0, le=65535)]
    frame: Annotated[int, Meta(ge=0, le=255)]
    params: Parameters
    x: float
    y: float
    z: float
    autocontinue: bool = True


_Items = Annotated[list[_Item], Meta(max_length=MAX_ITEMS)]


class _File(msgspec.Struct, forbid_unknown_fields=True):
    format: str
    version: int
    items: _Items
    home: _Home | None = None
    fence: _Items = []
    rally: _Items = []
    cruise_speed_m_s: float = 15.0
    hover_speed_m_s: float = 5.0


_VERSION = msgspec.json.Decoder(_Version)
_FILE = msgspec.json.Decoder(_File)


def loads(data: bytes) -> Mission:
    """Read a mission from the content of a native mission file, or raise MissionFileError."""
    check_json(data, NATIVE_KIND)
    version = decode_json(data, _VERSION).version
    if version != VERSION:
        msg = f"version {version} of the wbf-mission format is not known, only {VERSION}; update wbf-mission"
        raise MissionFileError(msg)
    file = decode_json(data, _FILE)
    return make_mission(
        _items(file.items, "item"),
        None if file.home is None else home_of("home", *msgspec.structs.astuple(file.home)),
        fence=_items(file.fence, "fence item"),
        rally=_items(file.rally, "rally point"),
        cruise_speed_m_s=file.cruise_speed_m_s,
        hover_speed_m_s=file.hover_speed_m_s,
    )


def _items(items: list[_Item], name: str) -> tuple[MissionItem, ...]:
    return tuple(
        make_item(
            f"{name} {number}",
            item.command,
            item.frame,
            item.params,
            (item.x, item.y, item.z),
            autocontinue=item.autocontinue,
            keep_frame=True,
        )
        for number, item in enumerate(items, 1)
    )


def dumps(mission: Mission, firmware: Firmware = Firmware.GENERIC) -> str:  # noqa: ARG001  one signature for all
    """Return a mission as the text of a native mission file; `firmware` has no effect.

    >>> loads(dumps(Mission((MissionItem.waypoint(28.05, -82.15, 10.0),))).encode()).items[0].z
    10.0
    """
    home = mission.home
    parts = [
        '"format": "wbf-mission"',
        f'"version": {VERSION}',
        f'"home": {_text(None if home is None else _Home(*map(float, astuple(home))))}',
        f'"cruise_speed_m_s": {_text(float(mission.cruise_speed_m_s))}',
        f'"hover_speed_m_s": {_text(float(mission.hover_speed_m_s))}',
        f'"items": {_list_text(mission.items)}',
        f'"fence": {_list_text(mission.fence)}',
        f'"rally": {_list_text(mission.rally)}',
    ]
    return "{\n  " + ",\n  ".join(parts) + "\n}\n"


def _text(value: object) -> str:
    return msgspec.json.encode(value).decode()


def _list_text(items: tuple[MissionItem, ...]) -> str:
    if not items:
        return "[]"
    # One item per line keeps files short and diffs readable.
    structs = (
        _Item(
            command=item.command,
            frame=item.frame,
            params=file_parameters(item, Firmware.GENERIC),
            x=float(item.x),
            y=float(item.y),
            z=float(item.z),
            autocontinue=bool(item.autocontinue),
        )
        for item in items
    )
    return "[\n    " + ",\n    ".join(map(_text, structs)) + "\n  ]"
