"""The one place that chooses the MAVLink dialect; everything else imports ``mavlink`` from here.

``all`` of pymavlink holds the common, standard, development and ArduPilot messages;
`mission.link.codec.additions` adds what it lacks (opaque plan ids, PROTOCOL_VERSION, COMPONENT_METADATA,
events); `mission.link.codec.lean` lets its messages be made without a header.
"""

from typing import Any

from pymavlink.dialects.v20 import all as generated

from mission.link.codec.additions import extend
from mission.link.codec.lean import lighten

extend(generated)
lighten(generated)
mavlink: Any = generated
Message = generated.MAVLink_message

__all__ = ["Message", "mavlink"]
