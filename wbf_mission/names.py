"""The names that options take, for completion and for 'unknown name' errors."""

from __future__ import annotations


def names_of(kind: str) -> tuple[str, ...]:
    """Return the known names of a ``kind``: farm, planner, estimator or vehicle."""
    if kind == "farm":
        from geo import farm_names

        return tuple(farm_names())
    if kind == "planner":
        from mission.planners import planner_names

        return tuple(planner_names())
    if kind == "estimator":
        from sensors.estimators import estimator_names

        return tuple(estimator_names())
    from sim_vehicle.airframe.catalog import vehicle_names

    return tuple(vehicle_names())
