"""MAVLink links in memory and over UDP, TCP and serial lines, with frame codec, signing and logs."""

from typing import TYPE_CHECKING

from geo.imports import attach

if TYPE_CHECKING:
    from mission.link.address import Link as Link
    from mission.link.address import LinkAddress as LinkAddress
    from mission.link.address import MavlinkEndpoint as MavlinkEndpoint
    from mission.link.address import MemoryLink as MemoryLink
    from mission.link.address import memory_pair as memory_pair
    from mission.link.address import parse_link_url as parse_link_url
    from mission.link.codec.frames import FrameReader as FrameReader
    from mission.link.codec.frames import FrameWriter as FrameWriter
    from mission.link.codec.frames import SourceStatistics as SourceStatistics
    from mission.link.codec.signing import Signing as Signing
    from mission.link.codec.signing import key_from_text as key_from_text
    from mission.link.opening import open_link as open_link
    from mission.link.tlog import TlogWriter as TlogWriter
    from mission.link.tlog import read_tlog as read_tlog
else:
    __getattr__, __dir__, __all__ = attach(__name__)
