"""Exports a run to a Rerun recording, with a blueprint: map, scene, layers, plots and log over time."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from numpy.typing import NDArray

from geo.atomic import atomic_path
from geo.imports import load_extra
from wbf_mission import events
from wbf_mission.addons.base.plots import fence_rings, rgb
from wbf_mission.addons.export import scene

if TYPE_CHECKING:
    from wbf_mission.run.record import RunRecord

TIME_LINE = "time"
_LEVELS = (*3 * ("CRITICAL",), "ERROR", "WARN", "INFO", "INFO", "DEBUG")  # By MAV_SEVERITY


class RerunRecording(scene.Scene):
    """A Rerun recording of a run."""

    def __init__(self, rr: Any, recording: Any, record: RunRecord, epoch_s: float) -> None:
        super().__init__(record)
        self._rr, self._recording = rr, recording
        self._epoch = np.datetime64(round(epoch_s * 1e9), "ns")
        self._states: dict[int, list[events.VehicleMoved]] = {}

    def _at(self, time_s: float) -> np.datetime64:
        return self._epoch + np.timedelta64(round(time_s * 1e9), "ns")

    def _log(self, time_s: float, path: str, what: Any) -> None:
        self._recording.set_time(TIME_LINE, timestamp=self._at(time_s))
        self._recording.log(path, what)

    def _say(self, time_s: float, severity: int, name: str, text: str) -> None:
        level = _LEVELS[min(max(severity, 0), len(_LEVELS) - 1)]
        self._log(time_s, f"log/{name.replace(' ', '_')}", self._rr.TextLog(text, level=level))

    def _begin(self, event: events.RunBegun) -> None:  # noqa: ARG002
        rr, farm, size = self._rr, self.farm, self.size_m
        shapes = [(patch.polygon, scene.crop_colour(str(patch.crop)), 0.0) for patch in farm.patches]
        shapes += [
            (obstacle.polygon, scene.OBSTACLE, obstacle.height_m or size) for obstacle in farm.obstacles
        ]
        rings = [
            (shapely.get_coordinates(ring), rgb(colour), height_m)
            for polygon, colour, height_m in shapes
            for ring in (polygon.exterior, *polygon.interiors)
        ]
        colours = [colour for _, colour, _ in rings]
        places = [scene.places_of(self.farm, ring) for ring, _, _ in rings]
        self._recording.log("map/farm", rr.GeoLineStrings(lat_lon=places, colors=colours), static=True)
        home = scene.places_of(self.farm, np.array([farm.home_m]))
        self._recording.log("map/home", rr.GeoPoints(lat_lon=home, colors=[(0, 0, 0)]), static=True)
        strips, of_strips = [], []
        for ring, colour, height_m in rings:
            tops = [_raised(ring, 0.0), _raised(ring, height_m)] if height_m else [_raised(ring, 0.0)]
            edges = [np.array([(*xy, 0.0), (*xy, height_m)]) for xy in ring[:-1]] if height_m else []
            strips += tops + edges
            of_strips += [colour] * len(tops + edges)
        self._recording.log("scene/farm", rr.LineStrips3D(strips, colors=of_strips), static=True)

    def _plan(self, event: events.Planned) -> None:
        rr, number, colour = self._rr, event.system_id, rgb(scene.vehicle_colour(event.system_id))
        rings = [np.vstack((ring, ring[:1])) for ring, _ in fence_rings(event.mission.fence, self.farm.frame)]
        colours = [colour] + [rgb(scene.FENCE)] * len(rings)
        lines = [event.path_m, *rings] if len(event.path_m) else rings
        places = rr.GeoLineStrings(
            lat_lon=[scene.places_of(self.farm, line) for line in lines], colors=colours[-len(lines) :]
        )
        height_m = scene.highest_m(event.mission, self.farm)
        heights = [height_m if line is event.path_m else 0.0 for line in lines]
        strips = [_raised(line, height) for line, height in zip(lines, heights, strict=True)]
        self._log(event.time_s, f"map/vehicle_{number}/plan", places)
        drawn = rr.LineStrips3D(strips, colors=[(*shade, 128) for shade in colours[-len(lines) :]])
        self._log(event.time_s, f"scene/vehicle_{number}/plan", drawn)
        body = rr.Arrows3D(vectors=[(self.size_m, 0.0, 0.0)], radii=[0.15 * self.size_m], colors=[colour])
        self._recording.log(f"scene/vehicle_{number}/body", body, static=True)

    def _move(self, event: events.VehicleMoved) -> None:
        self._states.setdefault(event.system_id, []).append(event)

    def _land(self, event: events.FlightEnded) -> None:
        rr, number = self._rr, event.system_id
        states = self._states.pop(number, [])
        if len(states) < 2:
            return
        times = rr.TimeColumn(TIME_LINE, timestamp=np.array([self._at(state.time_s) for state in states]))
        flown = np.array([(state.x_m, state.y_m, state.height_m) for state in states])
        places, yaws = scene.places_of(self.farm, flown), _yaws(states, flown, self.farm.frame.rotation_deg)
        turned = np.column_stack([np.zeros((len(yaws), 2)), np.sin(0.5 * yaws), np.cos(0.5 * yaws)])
        colour = rgb(scene.vehicle_colour(number))

        def send(path: str, columns: Any) -> None:
            self._recording.send_columns(path, indexes=[times], columns=columns)

        send(f"map/vehicle_{number}/fix", rr.GeoPoints.columns(positions=places))
        self._recording.log(
            f"map/vehicle_{number}/fix",
            rr.GeoPoints.from_fields(colors=[colour], radii=rr.Radius.ui_points(6.0)),
            static=True,
        )
        send(f"scene/vehicle_{number}/body", rr.Transform3D.columns(translation=flown, quaternion=turned))
        for what in ("height_m", "speed_m_s", "battery"):
            values = [getattr(state, what) for state in states]
            if None not in values:
                path = f"plots/{what}/vehicle_{number}"
                send(path, rr.Scalars.columns(scalars=values))
                self._recording.log(path, rr.SeriesLines(colors=[colour]), static=True)
        step = -(-len(states) // scene.TRACK_POINTS)
        for end in np.unique(np.linspace(2, len(states), scene.SHOWN_AGAIN).astype(int)).tolist():
            rows = np.unique(np.append(np.arange(0, end, step), end - 1))
            line = rr.LineStrips3D([flown[rows]], colors=[colour])
            self._log(states[end - 1].time_s, f"scene/vehicle_{number}/track", line)
            track = rr.GeoLineStrings(lat_lon=[places[rows]], colors=[colour])
            self._log(states[end - 1].time_s, f"map/vehicle_{number}/track", track)

    def _show_readings(
        self,
        time_s: float,
        places_m: NDArray[np.float64],
        values: NDArray[np.float32],  # noqa: ARG002
        colours: scene.Colours,
    ) -> None:
        if len(places_m):
            radii = [0.4 * self.farm.cell_size_m]
            points = self._rr.Points3D(_raised(places_m, 0.0), colors=colours, radii=radii)
            self._log(time_s, "scene/readings", points)

    def _score(self, event: events.Estimated) -> None:
        if event.score is not None:
            self._log(event.time_s, "plots/score", self._rr.Scalars(event.score.score))
            for name, loss in zip(event.score.fields, event.score.field_loss, strict=True):
                self._log(event.time_s, f"plots/loss/{name}", self._rr.Scalars(loss))

    def _show_layer(self, time_s: float, name: str, means: scene.Pixels, colours: scene.Colours) -> None:  # noqa: ARG002
        # The first row of an image is at the top.
        rows = np.ascontiguousarray(colours.transpose(1, 0, 2)[::-1])
        self._log(time_s, f"layers/{name}", self._rr.Image(rows, "RGBA"))


def _raised(points: NDArray[np.floating], height_m: float) -> NDArray[np.float64]:
    """Return points, float64[n, 2], with `height_m` as third coordinate."""
    return np.column_stack([points, np.full(len(points), height_m)])


def _yaws(
    states: list[events.VehicleMoved], flown: NDArray[np.float64], rotation_deg: float
) -> NDArray[np.float64]:
    """Return yaws, anticlockwise from the x axis: from the heading if it is known, else from the track."""
    steps = np.diff(flown[:, :2], axis=0, append=flown[-1:, :2])
    along = np.arctan2(steps[:, 1], steps[:, 0])
    headings = np.array([math.nan if state.heading_rad is None else state.heading_rad for state in states])
    yaws = 0.5 * math.pi - headings - math.radians(rotation_deg)
    return np.where(np.isfinite(yaws), yaws, along)


def blueprint_of(rrb: Any, result: RunRecord) -> Any:
    """Return the Rerun blueprint of a run, with views of scene, map, layers, log and plots."""
    whats = ("truth", "estimate", "uncertainty")
    layers = [
        rrb.Horizontal(
            *(rrb.Spatial2DView(origin=f"layers/{field.name}/{what}", name=what) for what in whats),
            name=field.title,
        )
        for field in result.fields
    ]
    plots = ("score", "loss", "height_m", "speed_m_s", "battery")
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(
                rrb.Tabs(
                    rrb.Spatial3DView(origin="scene", name="Scene"),
                    rrb.MapView(origin="map", name="Map"),
                    *layers,
                ),
                rrb.TextLogView(origin="log", name="Log"),
                row_shares=[3, 1],
            ),
            rrb.Vertical(*(rrb.TimeSeriesView(origin=f"plots/{plot}", name=plot) for plot in plots)),
            column_shares=[2, 1],
        ),
        collapse_panels=True,
    )


def write_rrd(
    record: RunRecord, files: tuple[Path, ...], run_events: Iterable[events.Event], epoch_s: float
) -> None:
    """Write the events of a finished run as a Rerun recording.

    ExportError if the packages of the extra ``rerun`` are not installed.
    """
    rr = load_extra("rerun", "rerun", "recordings of Rerun need", scene.ExportError)
    rrb = load_extra("rerun.blueprint", "rerun", "recordings of Rerun need", scene.ExportError)
    with atomic_path(files[0]) as temporary:
        recording = rr.RecordingStream("wbf-mission")
        recording.set_log_time_enabled(False)
        recording.set_log_tick_enabled(False)
        recording.save(temporary, default_blueprint=blueprint_of(rrb, record))
        try:
            log = RerunRecording(rr, recording, record, epoch_s)
            for event in run_events:
                log.take(event)
        finally:
            recording.flush()
            recording.disconnect()
