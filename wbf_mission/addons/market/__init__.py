"""The market: a fleet sells its work among its vehicles."""

from wbf_mission.addons.market.market import Market as Market

__all__ = ["Market"]
