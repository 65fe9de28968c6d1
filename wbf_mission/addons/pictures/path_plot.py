"""Picture of the paths of a run: planned paths, flown paths, and path changes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from wbf_mission.addons.base.plots import FLOWN, draw_farm, new_figure, save_figure
from wbf_mission.replanning.record import PLANNED_PATH, DecisionRecord, PathChange
from wbf_mission.run.record import FlightRecord

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from wbf_mission.run.record import RunRecord

PLANNED = "#1f4e79"
CHANGED = "#0b6e4f"
MOST_ABANDONED = 12
"""Maximum number of path changes for which abandoned paths are drawn; more would hide the flown path."""
_MOST_RINGS = 60
_MOST_NAMED = 8

_Points = NDArray[np.float64]


def plot_run(record: RunRecord, path: Path) -> Path:
    """Write the farm with the paths of a run as a PNG picture.

    For a single flight, the planned path is drawn as well. Several flights differ in colour by day if the run
    has several days, else by vehicle or flight number. A ring marks each position where a vehicle changed to
    another path. If there are at most `MOST_ABANDONED` changes, thin dashed lines show the abandoned paths.
    """
    figure = new_figure(7.5, 6.4)
    figure.set_layout_engine("constrained")
    axes = figure.add_subplot()
    draw_farm(axes, record.farm)
    crops = axes.get_legend()
    flights = record.flights
    planned = flights[0].plan.path_m
    if len(flights) == 1 and len(planned):
        axes.plot(*planned.T, color=PLANNED, linewidth=2.2, alpha=0.55, label="planned", zorder=3)
    _draw_flown(axes, flights)
    _draw_changes(axes, record.decisions)
    axes.legend(loc="upper right", bbox_to_anchor=(1.0, -0.1), ncols=3, fontsize=7, frameon=False)
    if crops is not None:
        axes.add_artist(crops)
        crops.set_clip_on(False)  # The layout makes room only for artists that are not clipped
    how = "mission file" if record.plan.planner is None else record.plan.planner
    axes.set_title(f"{record.farm.name}: {how}, {record.plan.vehicle.name}")
    return save_figure(figure, path)


def _draw_flown(axes: Axes, flights: Sequence[FlightRecord]) -> None:
    from matplotlib import colormaps

    kind, groups = _groups(flights)
    names = sorted(groups)
    width = 0.8 if len(flights) < 4 else 0.6
    for number, name in enumerate(names):
        colour: str | tuple[float, float, float, float] = FLOWN
        if len(names) > 1:
            colour = colormaps["plasma"](0.85 * number / (len(names) - 1))
        # With many groups only the first and the last have labels.
        labelled = len(names) <= _MOST_NAMED or number in (0, len(names) - 1)
        label = "flown" if len(names) == 1 else f"{kind} {name}"
        for flight in groups[name]:
            track = flight.track
            named = label if labelled else ""
            axes.plot(track.x_m, track.y_m, color=colour, linewidth=width, zorder=4, label=named)
            labelled = False
    tracks = [flight.track for flight in flights if len(flight.track.x_m)]
    starts = np.array([(track.x_m[0], track.y_m[0]) for track in tracks])
    if len(starts):
        axes.plot(*starts.T, marker="o", color="black", markersize=4, linestyle="", label="start", zorder=6)


def _groups(flights: Sequence[FlightRecord]) -> tuple[str, dict[int, list[FlightRecord]]]:
    """Return the kind of grouping (day, vehicle or flight) and the flights of each group."""
    kinds = {"day": "day", "vehicle": "system_id", "flight": "flight"}
    for kind, name in kinds.items():
        groups: dict[int, list[FlightRecord]] = {}
        for flight in flights:
            groups.setdefault(getattr(flight, name), []).append(flight)
        if len(groups) > 1:
            return kind, groups
    return "flight", groups


def _draw_changes(axes: Axes, decisions: Sequence[DecisionRecord]) -> None:
    flown = changes_flown(decisions)
    if not flown:
        return
    places = np.array([change.position_m for change, _ in flown])
    few = len(flown) <= _MOST_RINGS
    # Many rings would hide the paths: draw points beneath the paths instead.
    axes.plot(
        *places.T,
        marker="o" if few else ".",
        markersize=5 if few else 2,
        markerfacecolor="white" if few else CHANGED,
        markeredgecolor=CHANGED,
        markeredgewidth=None if few else 0.0,
        linestyle="",
        label="path changed",
        zorder=5 if few else 1.5,
    )
    if len(flown) > MOST_ABANDONED:
        return
    label = "path given up"
    for change, before in flown:
        rest = rest_of_path(before, change.position_m)
        if len(rest) > 1:
            axes.plot(*rest.T, color=CHANGED, linewidth=0.7, linestyle="--", alpha=0.7, label=label, zorder=3)
            label = ""


def changes_flown(decisions: Sequence[DecisionRecord]) -> list[tuple[PathChange, _Points]]:
    """Return the path changes that vehicles flew, each with the vehicle's path before the change."""
    present: dict[tuple[int, int, int], _Points] = {}
    found = []
    for record in decisions:
        for change in record.changes:
            if change.outcome not in (PLANNED_PATH, "flown"):
                continue
            key = (record.day, record.flight, change.system_id)
            if change.outcome == "flown" and key in present:
                found.append((change, present[key]))
            present[key] = change.path_m
    return found


def rest_of_path(path_m: _Points, position_m: tuple[float, float]) -> _Points:
    """Return `position_m` and the waypoints that follow the path's nearest point to `position_m`.

    >>> rest_of_path(np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0]]), (1.0, 0.5)).tolist()
    [[1.0, 0.5], [4.0, 0.0], [4.0, 4.0]]
    """
    position = np.asarray(position_m, np.float64)
    if len(path_m) < 2:
        return np.vstack((position, path_m))
    begin, leg = path_m[:-1], np.diff(path_m, axis=0)
    length = np.maximum((leg**2).sum(axis=1), 1e-12)
    along = np.clip(((position - begin) * leg).sum(axis=1) / length, 0.0, 1.0)
    nearest = int(np.argmin(((begin + along[:, None] * leg - position) ** 2).sum(axis=1)))
    return np.vstack((position, path_m[nearest + 1 :]))
