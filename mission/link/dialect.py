"""The one place that chooses the MAVLink dialect; everything else imports ``mavlink`` from here.

``all`` of pymavlink holds the common, standard, development and ArduPilot messages.
"""

from pymavlink.dialects.v20 import all as mavlink

__all__ = ["mavlink"]
