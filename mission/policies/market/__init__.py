"""The market: a fleet sells its work among its vehicles."""

from mission.policies.market.market import Market as Market

__all__ = ["Market"]
