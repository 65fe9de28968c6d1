"""Write the types of the MAVLink messages that the code uses: ``mission/link/codec/messages.pyi``.

pymavlink's dialect has no types and lacks the fields that `mission.link.codec.additions` appends. This script
collects the names of ``mavlink`` used in the sources and looks up their types in the dialect. Run the script
after using a message or constant for the first time::

    python tools/write_message_stub.py
"""

from __future__ import annotations

import re
import subprocess
import sys
from inspect import Parameter, signature
from pathlib import Path
from typing import Any

from mission.link.codec.additions import EXTENSIONS, MESSAGES
from mission.link.codec.dialect import mavlink

ROOT = Path(__file__).parents[1]
STUB = ROOT / "mission" / "link" / "codec" / "messages.pyi"
_PACKAGES = ("geo", "sensors", "mission", "sim_vehicle", "wbf_mission")
_USED = re.compile(r"\b(?:m|mavlink)\.([A-Z]\w+)")
_ID = "MAVLINK_MSG_ID_"

_MARK = "# What follows is written by tools/write_message_stub.py; do not edit it.\n"


def head() -> str:
    """Return the hand-written part of the stub, including its last line, the marker."""
    written, mark, _ = STUB.read_text(encoding="utf-8").partition(_MARK)
    return written + mark


def used_names() -> list[str]:
    """Return the sorted names of the dialect's messages and constants in the sources.

    A message is included if the sources contain its class or its id.
    """
    names: set[str] = set()
    for package in _PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            names.update(_USED.findall(path.read_text(encoding="utf-8")))
    names |= {f"MAVLink_{name.removeprefix(_ID).lower()}_message" for name in names if name.startswith(_ID)}
    described = set(re.findall(r"^class (\w+)", head(), re.MULTILINE))
    return sorted(name for name in names - described if hasattr(mavlink, name))


def _is_message(name: str) -> bool:
    return isinstance(getattr(mavlink, name), type)


def _type(kind: str, length: int, *, given: bool = False) -> str:
    """Return the Python type of a field as an attribute, or as a constructor argument if `given`."""
    if kind == "char":
        return "bytes" if given else "str"
    number = "float" if kind in ("float", "double") else "int"
    return f"Sequence[{number}]" if length else number


def _fields(name: str) -> list[tuple[str, str, int, bool]]:
    """Return the fields of a message class: name, C type, array length, and whether the field is optional."""
    message_type: Any = getattr(mavlink, name)
    lengths = dict(zip(message_type.ordered_fieldnames, message_type.array_lengths, strict=True))
    title = message_type.msgname
    if title in {definition.name for definition in MESSAGES}:
        optional: set[str] = set()
    else:
        added = {field.name for field in EXTENSIONS.get(title, ())}
        original = message_type if not added else message_type.__mro__[1]
        parameters = signature(original.__init__).parameters.values()
        optional = added | {one.name for one in parameters if one.default is not Parameter.empty}
    return [
        (field, kind, lengths[field], field in optional)
        for field, kind in zip(message_type.fieldnames, message_type.fieldtypes, strict=True)
    ]


def _message(name: str) -> str:
    """Return the stub of a message class; its constructor takes the fields, texts as bytes."""
    fields = _fields(name)
    lines = [f"class {name}(MAVLink_message):"]
    for field, kind, length, optional in fields:
        lines.append(f"    {field}: {_type(kind, length)}{' = ...' if optional else ''}")
    if any(kind == "char" for _, kind, _, _ in fields):
        arguments = [
            f"{field}: {_type(kind, length, given=True)}{' = ...' if optional else ''}"
            for field, kind, length, optional in fields
        ]
        lines.append(f"    def __init__({', '.join(['self', *arguments])}) -> None: ...")
    return "\n".join(lines)


def _number(name: str) -> str:
    value = getattr(mavlink, name)
    if not isinstance(value, int):
        msg = f"{name} of the dialect is neither a message nor a number: describe it in this script"
        raise TypeError(msg)
    return f"{name}: Final[int]"


def stub() -> str:
    """Return the text of the stub module."""
    names = used_names()
    numbers = "\n".join(_number(name) for name in names if not _is_message(name))
    messages = "\n\n".join(_message(name) for name in names if _is_message(name))
    text = f"{head()}\n{numbers}\n\n{messages}\n"
    ruff = [sys.executable, "-m", "ruff", "format", "--stdin-filename", str(STUB), "-"]
    return subprocess.run(ruff, input=text, capture_output=True, text=True, check=True, cwd=ROOT).stdout


if __name__ == "__main__":
    STUB.write_text(stub(), encoding="utf-8")
