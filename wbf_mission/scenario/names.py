"""The names that options take, for completion and for 'unknown name' errors."""

from __future__ import annotations

from geo.installed import entry_points


def names_of(kind: str) -> tuple[str, ...]:
    """Return the known names of a ``kind``: farm, planner, policy, estimator, autopilot or vehicle."""
    if kind == "farm":
        from geo.built_in import farm_names

        return farm_names()
    if kind == "planner":
        return _entry_points("wbf_mission.planners")
    if kind == "policy":
        return _entry_points("wbf_mission.policies")
    if kind == "estimator":
        return _entry_points("wbf_mission.estimators")
    if kind == "autopilot":
        from sim_vehicle.airframe.autopilot_names import autopilot_names

        return autopilot_names()
    from sim_vehicle.airframe.catalog import vehicle_names

    return vehicle_names()


def _entry_points(group: str) -> tuple[str, ...]:
    """The names in a group of entry points; nothing of what they name is imported."""
    return tuple(sorted({entry.name for entry in entry_points(group=group)}))
