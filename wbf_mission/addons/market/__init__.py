"""Market policy: vehicles of a fleet bid for survey segments."""

from wbf_mission.addons.market.market import Market as Market

__all__ = ["Market"]
