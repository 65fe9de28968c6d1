"""Links that carry MAVLink bytes: in memory, UDP, TCP."""

from mission.link.codec.frames import FrameReader, FrameWriter, SourceStatistics
from mission.link.codec.signing import Signing, key_from_text
from mission.link.endpoint import LinkStatistics, MavlinkEndpoint
from mission.link.link import Link, LinkAddress, open_link, parse_link_url
from mission.link.memory import MemoryLink, memory_pair
from mission.link.tlog import TlogWriter, read_tlog

__all__ = [
    "FrameReader",
    "FrameWriter",
    "Link",
    "LinkAddress",
    "LinkStatistics",
    "MavlinkEndpoint",
    "MemoryLink",
    "Signing",
    "SourceStatistics",
    "TlogWriter",
    "key_from_text",
    "memory_pair",
    "open_link",
    "parse_link_url",
    "read_tlog",
]
