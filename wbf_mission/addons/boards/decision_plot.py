"""Picture of a run's decisions side by side: candidates, choice and outcome."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from geo.texts import duration
from mission.policies.decision import AcquisitionMap
from wbf_mission.addons.base.plots import LAND, LINE_COLOURS, draw_farm, new_sheet, save_sheet
from wbf_mission.maps.blocks import SICK_BELOW
from wbf_mission.replanning.record import DecisionRecord

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from wbf_mission.run.record import RunRecord

MOST_DECISIONS = 6
"""Maximum number of decisions in the picture: the first, the last, and decisions evenly spread between."""
_MOST_CANDIDATES = 12
_SICK, _HEALTHY = "#8e1f1c", "#1d91c0"
_SICK_BEFORE, _BEFORE = "#d9a09e", "#a8a59d"
_CANDIDATE: dict[str, Any] = {"color": "#3f3c37", "linewidth": 0.8, "linestyle": (0, (2, 1.5))}
_SCALE_QUANTILE = 0.995


def plot_decisions(
    record: RunRecord, acquisitions: Sequence[AcquisitionMap | None], paths: Sequence[Path], *, title: str
) -> None:
    """Draw at most `MOST_DECISIONS` decisions, one column each: candidates and choice above, outcome below.

    Lower panels show the readings until the decision of the next column. The text below a panel also counts
    the readings until the next decision of the run. `acquisitions` has the acquisition map of each decision,
    if any. The suffix of each path selects the format of the file.
    """
    from matplotlib.colors import PowerNorm

    weighed = [
        k
        for k, decision in enumerate(record.decisions)
        if decision.changes or decision.alternatives or decision.refused
    ]
    spread = np.linspace(0, len(weighed) - 1, MOST_DECISIONS).round().astype(int)
    shown = [weighed[k] for k in np.unique(spread)]
    maps = [acquisition for k in shown if (acquisition := acquisitions[k]) is not None]
    norm = PowerNorm(0.5, 0.0, _most(maps))  # Square root: most acquisition values are small
    counts = [decision.observations for decision in record.decisions] + [len(record.observations)]
    figure = new_sheet(1.0 + 2.1 * len(shown), 5.7)
    panels = figure.subplots(2, len(shown), squeeze=False)
    image = None
    for (above, below), k, column in zip(panels.T, shown, [*shown[1:], len(record.decisions)], strict=True):
        decision = record.decisions[k]
        image = _draw_choice(above, record, decision, acquisitions[k], norm) or image
        # Several decisions may have equally many observations: take the next decision with more.
        later = next((count for count in counts[k + 1 :] if count > counts[k]), counts[-1])
        _draw_outcome(below, record, (counts[k], later, counts[column]))
        day = f"day {decision.day}, " if len(record.days) > 1 else ""
        above.set_title(f"{k + 1}: {day}{duration(decision.time_s)}\n{decision.event}", fontsize=8)
    panels[0, 0].set_ylabel("candidates and choice", fontsize=9)
    panels[1, 0].set_ylabel("outcome", fontsize=9)
    if image is not None:
        bar = figure.colorbar(image, ax=list(panels[0]), fraction=0.02, pad=0.01)
        bar.set_label("acquisition value", fontsize=8)
        bar.ax.tick_params(labelsize=7)
    _legend(figure)
    figure.suptitle(f"{title}: {len(shown)} of {len(record.decisions)} decisions", fontsize=10)
    save_sheet(figure, paths)


def _most(maps: Sequence[AcquisitionMap]) -> float:
    """Return the value at the top of the colour scale; 0.5 % of the positive values exceed the top."""
    values = [acquisition.values[acquisition.values > 0.0] for acquisition in maps]
    known = np.concatenate(values) if values else np.empty(0)
    return float(np.quantile(known, _SCALE_QUANTILE)) if len(known) else 1.0


def _draw_choice(
    axes: Axes, record: RunRecord, decision: DecisionRecord, acquisition: AcquisitionMap | None, norm: Any
) -> Any:
    """Draw acquisition map, candidates and choice; return the image of the map, or None without a map."""
    image = None
    _frame(axes, record)
    if acquisition is not None:
        width_m, height_m = (side * acquisition.cell_m for side in acquisition.values.shape)
        image = axes.imshow(
            np.ma.masked_less_equal(acquisition.values, 0.0).T,
            origin="lower",
            extent=(0.0, width_m, 0.0, height_m),
            interpolation="nearest",
            cmap="YlGnBu",
            norm=norm,
            zorder=1,
        )
    else:
        axes.text(0.5, 0.02, "no acquisition map", transform=axes.transAxes, fontsize=7, ha="center")
    begins = {change.system_id: change.position_m for change in decision.changes}
    for candidate in decision.alternatives[:_MOST_CANDIDATES]:
        points = np.asarray(candidate.points_m)
        if candidate.system_id in begins:
            points = np.vstack([np.asarray(begins[candidate.system_id])[None], points])
        axes.plot(*points.T, **_CANDIDATE, alpha=0.8, zorder=3)
        axes.plot(*points[-1], color=_CANDIDATE["color"], marker="o", markersize=2.5, zorder=3)
    for change in decision.changes:
        path = np.vstack([np.asarray(change.position_m)[None], change.path_m])
        colour = LINE_COLOURS[change.system_id % len(LINE_COLOURS)]
        axes.plot(*path.T, color="white", linewidth=2.8, zorder=4)
        axes.plot(*path.T, color=colour, linewidth=1.5, zorder=5)
        axes.plot(*path[0], color=colour, marker="o", markersize=4.5, markeredgecolor="white", zorder=6)
    if decision.refused:
        axes.text(0.5, 0.5, "refused", transform=axes.transAxes, fontsize=8, ha="center", zorder=7)
    return image


def _draw_outcome(axes: Axes, record: RunRecord, counts: tuple[int, int, int]) -> None:
    """Draw the readings; `counts`: their number at this decision, the next decision and the next column's."""
    _frame(axes, record)
    begin, until, end = counts
    seen, grid = record.observations, record.farm.grid()
    x_m, y_m = ((column + 0.5) * grid.cell_size_m for column in (seen.x, seen.y))
    sick = np.zeros(len(seen), np.bool_)
    for k, field in enumerate(record.fields):
        if field.kind == "disease":
            hosts = field.hosts(grid)[seen.x, seen.y]
            sick |= hosts & (np.nan_to_num(seen.values[:, k], nan=1.0) < SICK_BELOW)
    size = min(5.0, 40_000.0 / max(len(seen), 1))
    before, new = np.arange(len(seen)) < begin, slice(begin, end)
    axes.scatter(
        x_m[before & ~sick], y_m[before & ~sick], s=0.4 * size, color=_BEFORE, linewidths=0, zorder=2
    )
    axes.scatter(x_m[before & sick], y_m[before & sick], s=size, color=_SICK_BEFORE, linewidths=0, zorder=3)
    for chosen, colour, marker in ((~sick[new], _HEALTHY, "o"), (sick[new], _SICK, "s")):
        at = x_m[new][chosen], y_m[new][chosen]
        axes.scatter(
            *at, s=size * (1.0 if marker == "o" else 2.4), color=colour, marker=marker, linewidths=0, zorder=4
        )
    lines = [f"then {until - begin} readings, {np.count_nonzero(sick[begin:until])} sick"]
    if end > until:
        lines.append(f"until the next column {end - begin}, {np.count_nonzero(sick[new])} sick")
    losses = [_loss_after(record, count) for count in counts]
    lines.append("loss " + " → ".join(f"{loss:.3f}" for loss in losses if loss is not None))
    axes.set_xlabel("\n".join(lines), fontsize=7.5)


def _loss_after(record: RunRecord, count: int) -> float | None:
    """Return the loss of the last estimate from at most `count` observations; None before any estimate."""
    history = record.history
    known = int(np.searchsorted(history.observations, count, side="right"))
    return history.entries[known - 1].loss if known else None


def _frame(axes: Axes, record: RunRecord) -> None:
    draw_farm(axes, record.farm, legend=False)
    for image in axes.images:
        image.set_alpha(0.35)
    axes.set_facecolor(LAND)
    axes.set(xticks=[], yticks=[], xlabel="", ylabel="")


def _legend(figure: Any) -> None:
    from matplotlib.lines import Line2D

    def dot(colour: str, marker: str, label: str) -> Line2D:
        return Line2D([], [], color=colour, marker=marker, markersize=4, linestyle="", label=label)

    handles = [
        Line2D([], [], **_CANDIDATE, marker="o", markersize=2.5, label="candidate"),
        Line2D([], [], color=LINE_COLOURS[1], linewidth=1.5, marker="o", markersize=4, label="chosen"),
        dot(_BEFORE, "o", "read before"),
        dot(_SICK_BEFORE, "o", "of it sick"),
        dot(_HEALTHY, "o", "read until the next column"),
        dot(_SICK, "s", "of it sick"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=6, fontsize=8, frameon=False)
