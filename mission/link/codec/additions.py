"""MAVLink messages and fields that pymavlink's dialects lack, added to a generated dialect in place.

pip's pymavlink is generated from ArduPilot's copy of the definitions, which has no opaque plan ids and
none of the messages below. Extension fields are additive: they stand after all other fields on the wire, are
left out of the checksum's CRC_EXTRA, and peers that do not know them do not see them.

Fields after https://mavlink.io/en/messages/common.html; layout and CRC_EXTRA after
https://mavlink.io/en/guide/serialization.html.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from typing import Any, Final

from fastcrc import crc16

__all__ = ["EXTENSIONS", "MESSAGES", "Definition", "Field", "crc_extra", "extend"]

_CODES: Final = {
    "char": "c",
    "uint8_t": "B",
    "int8_t": "b",
    "uint16_t": "H",
    "int16_t": "h",
    "uint32_t": "I",
    "int32_t": "i",
    "uint64_t": "Q",
    "int64_t": "q",
    "float": "f",
    "double": "d",
}
_FIELD = re.compile(r"(\w+)(?:\[(\d+)\])? (\w+)")


@dataclass(frozen=True, slots=True)
class Field:
    """One field of a message: its C type, and the elements of an array, 0 for a single value.

    Examples
    --------
    >>> Field.of("char[100] uri")
    Field(name='uri', kind='char', length=100)
    """

    name: str
    kind: str
    length: int = 0

    @classmethod
    def of(cls, text: str) -> Field:
        """Read ``TYPE NAME`` or ``TYPE[LENGTH] NAME``."""
        found = _FIELD.fullmatch(text)
        assert found is not None
        return cls(found[3], found[1], int(found[2] or 0))

    @property
    def size(self) -> int:
        """Bytes of one element; fields are sorted by it."""
        return struct.calcsize(_CODES[self.kind])

    @property
    def code(self) -> str:
        """What `struct` calls it."""
        if not self.length:
            return _CODES[self.kind]
        return f"{self.length}{'s' if self.kind == 'char' else _CODES[self.kind]}"


@dataclass(frozen=True, slots=True)
class Definition:
    """One message: number, name, and fields in the order of the definition."""

    number: int
    name: str
    fields: tuple[Field, ...]

    @classmethod
    def of(cls, number: int, name: str, *fields: str) -> Definition:
        """Read the fields from text, see `Field.of`."""
        return cls(number, name, tuple(Field.of(field) for field in fields))


_OPAQUE_ID = (Field.of("uint32_t opaque_id"),)
EXTENSIONS: Final[dict[str, tuple[Field, ...]]] = {
    "MISSION_COUNT": _OPAQUE_ID,
    "MISSION_ACK": _OPAQUE_ID,
    "MISSION_CURRENT": (
        Field.of("uint32_t mission_id"),
        Field.of("uint32_t fence_id"),
        Field.of("uint32_t rally_points_id"),
    ),
}
"""Fields to append to messages that the dialect has, by message name."""

MESSAGES: Final[tuple[Definition, ...]] = (
    Definition.of(
        300,
        "PROTOCOL_VERSION",
        "uint16_t version",
        "uint16_t min_version",
        "uint16_t max_version",
        "uint8_t[8] spec_version_hash",
        "uint8_t[8] library_version_hash",
    ),
    Definition.of(397, "COMPONENT_METADATA", "uint32_t time_boot_ms", "uint32_t file_crc", "char[100] uri"),
    Definition.of(
        410,
        "EVENT",
        "uint8_t destination_component",
        "uint8_t destination_system",
        "uint32_t id",
        "uint32_t event_time_boot_ms",
        "uint16_t sequence",
        "uint8_t log_levels",
        "uint8_t[40] arguments",
    ),
    Definition.of(411, "CURRENT_EVENT_SEQUENCE", "uint16_t sequence", "uint8_t flags"),
    Definition.of(
        412,
        "REQUEST_EVENT",
        "uint8_t target_system",
        "uint8_t target_component",
        "uint16_t first_sequence",
        "uint16_t last_sequence",
    ),
    Definition.of(
        413,
        "RESPONSE_EVENT_ERROR",
        "uint8_t target_system",
        "uint8_t target_component",
        "uint16_t sequence",
        "uint16_t sequence_oldest_available",
        "uint8_t reason",
    ),
)
"""Messages that the dialect does not have."""


def _wire_order(fields: tuple[Field, ...]) -> tuple[Field, ...]:
    return tuple(sorted(fields, key=lambda field: -field.size))


def crc_extra(definition: Definition) -> int:
    """Return the byte that makes peers with another definition of the message fail its checksum.

    Examples
    --------
    >>> crc_extra(Definition.of(0, "HEARTBEAT", "uint8_t type", "uint8_t autopilot", "uint8_t base_mode",
    ...     "uint32_t custom_mode", "uint8_t system_status", "uint8_t mavlink_version"))
    50
    """
    text = f"{definition.name} ".encode()
    for field in _wire_order(definition.fields):
        text += f"{field.kind} {field.name} ".encode()
        if field.length:
            text += bytes([field.length])
    crc = int(crc16.mcrf4xx(text))
    return crc & 0xFF ^ crc >> 8


def extend(dialect: Any) -> None:
    """Add the fields and messages of this module to a module that pymavlink generated; twice is fine.

    The message classes keep their names (``MAVLink_mission_ack_message``), so the dialect's own codec and all
    that build messages through the module use the new ones.
    """
    for name, fields in EXTENSIONS.items():
        known = getattr(dialect, _class_name(name))
        missing = tuple(field for field in fields if field.name not in known.fieldnames)
        if missing:
            _register(dialect, name, _extended(known, missing))
    for definition in MESSAGES:
        if definition.number not in dialect.mavlink_map:
            _register(dialect, definition.name, _new(dialect, definition))


def _class_name(name: str) -> str:
    return f"MAVLink_{name.lower()}_message"


def _register(dialect: Any, name: str, message_type: Any) -> None:
    dialect.mavlink_map[message_type.id] = message_type
    setattr(dialect, f"MAVLINK_MSG_ID_{name}", message_type.id)
    setattr(dialect, _class_name(name), message_type)


def _extended(known: Any, fields: tuple[Field, ...]) -> Any:
    """Return a subclass of a message with fields after its own; they are 0 unless they are given."""
    number = len(known.fieldnames)
    required = known.__init__.__code__.co_argcount - 1 - len(known.__init__.__defaults__ or ())
    defaults = (*(known.__init__.__defaults__ or ()), *(0 for _ in fields))
    return _build(
        known,
        [*known.fieldnames, *(field.name for field in fields)],
        [*known.ordered_fieldnames, *(field.name for field in fields)],
        [*known.fieldtypes, *(field.kind for field in fields)],
        [*known.orders, *range(number, number + len(fields))],
        [*known.array_lengths, *(field.length for field in fields)],
        known.unpacker.format + "".join(field.code for field in fields),
        {
            "id": known.id,
            "msgname": known.msgname,
            "crc_extra": known.crc_extra,
            "required": required,
            "defaults": defaults,
        },
    )


def _new(dialect: Any, definition: Definition) -> Any:
    fields, ordered = definition.fields, _wire_order(definition.fields)
    return _build(
        dialect.MAVLink_message,
        [field.name for field in fields],
        [field.name for field in ordered],
        [field.kind for field in fields],
        [ordered.index(field) for field in fields],
        [field.length for field in ordered],
        "<" + "".join(field.code for field in ordered),
        {
            "id": definition.number,
            "msgname": definition.name,
            "crc_extra": crc_extra(definition),
            "required": len(fields),
            "defaults": (),
        },
    )


def _build(
    base: Any,
    names: list[str],
    ordered: list[str],
    kinds: list[str],
    orders: list[int],
    array_lengths: list[int],
    layout: str,
    more: dict[str, Any],
) -> Any:
    """Return a message class with what pymavlink's generated classes have."""
    texts = {name for name, kind in zip(names, kinds, strict=True) if kind == "char"}
    lengths = [1 if "s" in code else max(1, n) for n, code in zip(array_lengths, _split(layout), strict=True)]
    required, defaults = more.pop("required"), more.pop("defaults")
    message_id, message_name = more["id"], more["msgname"]
    root = next(kind for kind in base.__mro__ if kind.__name__ == "MAVLink_message")

    def initialise(self: Any, *values: Any, **named: Any) -> None:
        root.__init__(self, message_id, message_name)
        self._fieldnames = names
        given = dict(zip(names, values, strict=False)) | named
        if (
            len(values) > len(names)
            or len(given) < len(values) + len(named)
            or not given.keys() <= set(names)
        ):
            msg = f"{message_name}: its fields are {', '.join(names)}"
            raise TypeError(msg)
        for place, name in enumerate(names):
            if name not in given and place < required:
                msg = f"{message_name}: field {name} is missing"
                raise TypeError(msg)
            value = given[name] if name in given else defaults[place - required]
            if name in texts:
                setattr(self, f"_{name}_raw", value)
                value = value.split(b"\0", 1)[0].decode("ascii", errors="replace")
            setattr(self, name, value)

    def pack(self: Any, mav: Any, force_mavlink1: bool = False) -> bytes:
        values: list[Any] = []
        for name in ordered:
            value = getattr(self, f"_{name}_raw" if name in texts else name)
            values += value if isinstance(value, list | tuple) else [value]
        packed: bytes = self._pack(
            mav, self.crc_extra, self.unpacker.pack(*values), force_mavlink1=force_mavlink1
        )
        return packed

    return type(
        _class_name(message_name),
        (base,),
        {
            **more,
            "fieldnames": names,
            "ordered_fieldnames": ordered,
            "fieldtypes": kinds,
            "fielddisplays_by_name": dict(base.fielddisplays_by_name),
            "fieldenums_by_name": dict(base.fieldenums_by_name),
            "fieldunits_by_name": dict(base.fieldunits_by_name),
            "native_format": bytearray(layout.encode()),
            "orders": orders,
            "lengths": lengths,
            "array_lengths": array_lengths,
            "unpacker": struct.Struct(layout),
            "instance_field": base.instance_field,
            "instance_offset": base.instance_offset,
            "__init__": initialise,
            "pack": pack,
            "__doc__": f"{message_name}, see https://mavlink.io/en/messages/common.html#{message_name}.",
        },
    )


def _split(layout: str) -> list[str]:
    return re.findall(r"\d*[a-zA-Z]", layout)
