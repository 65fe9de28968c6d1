"""Export to a Rerun recording: map, scene, layers, plots and log on one time line, with a blueprint."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from numpy.typing import NDArray

from geo.atomic import atomic_path
from geo.errors import WbfMissionError
from geo.imports import load_extra
from mission.outcome import in_words
from wbf_mission import events
from wbf_mission.addons.base.fence_rings import fence_rings
from wbf_mission.addons.export import style
from wbf_mission.addons.export.layers import Layers, reading_colours
from wbf_mission.addons.export.tracks import highest_m

if TYPE_CHECKING:
    from wbf_mission.run.record import RunRecord

TIME_LINE = "time"
_LEVELS = (*3 * ("CRITICAL",), "ERROR", "WARN", "INFO", "INFO", "DEBUG")  # By MAV_SEVERITY


class ExportError(WbfMissionError, ValueError):
    """A run that cannot be exported."""


class RerunRecording:
    """Writer of a finished run's events to a Rerun recording."""

    def __init__(self, rr: Any, recording: Any, record: RunRecord, epoch_s: float) -> None:
        self._rr, self._recording = rr, recording
        self._epoch = np.datetime64(round(epoch_s * 1e9), "ns")
        self._farm, self._fields, self._layers = record.farm, record.fields, Layers(record)
        self._states: dict[int, list[events.VehicleMoved]] = {}
        self._seen: list[events.Seen] = []
        self._readings_a_show = max(1, len(record.observations) // style.SHOWN_AGAIN)
        self._readings = 0
        self._size_m = style.vehicle_size_m(record.farm)

    def take(self, event: events.Event) -> None:
        """Log an event."""
        match event:
            case events.RunBegun():
                self._log_farm()
                self._say(0.0, "INFO", "run", event.title)
            case events.DayBegun():
                self._seen = []
                if event.truth is not None:
                    self._log_layers(event.time_s, "truth", event.truth)
            case events.Planned():
                self._log_plan(event)
            case events.VehicleMoved():
                self._states.setdefault(event.system_id, []).append(event)
            case events.VehicleSaid():
                level = _LEVELS[min(max(event.severity, 0), len(_LEVELS) - 1)]
                self._say(event.time_s, level, f"vehicle {event.system_id}", event.text)
            case events.Seen():
                self._seen.append(event)
                self._readings += len(event.observations)
                if self._readings >= self._readings_a_show:
                    self._log_readings(event.offset_s + float(event.observations.time_s.max()))
            case events.Estimated():
                self._log_estimate(event)
            case events.Decided() if event.record.refused or event.record.reason:
                level = "WARN" if event.record.refused else "INFO"
                self._say(event.time_s, level, "policy", event.record.refused or event.record.reason)
            case events.FlightEnded():
                self._log_flight(event.system_id)
                self._end(event.time_s, f"vehicle {event.system_id}", event.outcome, event.reason)
            case events.RunEnded():
                self._log_readings(event.time_s)
                self._end(event.time_s, "run", event.outcome, event.reason)
            case _:
                pass

    def _at(self, time_s: float) -> np.datetime64:
        return self._epoch + np.timedelta64(round(time_s * 1e9), "ns")

    def _log(self, time_s: float, path: str, what: Any) -> None:
        self._recording.set_time(TIME_LINE, timestamp=self._at(time_s))
        self._recording.log(path, what)

    def _say(self, time_s: float, level: str, who: str, text: str) -> None:
        self._log(time_s, f"log/{who.replace(' ', '_')}", self._rr.TextLog(text, level=level))

    def _end(self, time_s: float, who: str, outcome: str, reason: str) -> None:
        self._say(time_s, "INFO", who, in_words(outcome, reason))

    def _log_farm(self) -> None:
        rr, farm, size = self._rr, self._farm, self._size_m
        shapes = [(patch.polygon, style.crop_colour(str(patch.crop)), 0.0) for patch in farm.patches]
        shapes += [
            (obstacle.polygon, style.OBSTACLE, obstacle.height_m or size) for obstacle in farm.obstacles
        ]
        rings = [
            (shapely.get_coordinates(ring), style.rgb(colour), height_m)
            for polygon, colour, height_m in shapes
            for ring in (polygon.exterior, *polygon.interiors)
        ]
        colours = [colour for _, colour, _ in rings]
        places = [style.places_of(self._farm, ring) for ring, _, _ in rings]
        self._recording.log("map/farm", rr.GeoLineStrings(lat_lon=places, colors=colours), static=True)
        home = style.places_of(self._farm, np.array([farm.home_m]))
        self._recording.log("map/home", rr.GeoPoints(lat_lon=home, colors=[(0, 0, 0)]), static=True)
        strips, of_strips = [], []
        for ring, colour, height_m in rings:
            tops = [_raised(ring, 0.0), _raised(ring, height_m)] if height_m else [_raised(ring, 0.0)]
            edges = [np.array([(*xy, 0.0), (*xy, height_m)]) for xy in ring[:-1]] if height_m else []
            strips += tops + edges
            of_strips += [colour] * len(tops + edges)
        self._recording.log("scene/farm", rr.LineStrips3D(strips, colors=of_strips), static=True)

    def _log_plan(self, event: events.Planned) -> None:
        rr, number, colour = self._rr, event.system_id, style.rgb(style.vehicle_colour(event.system_id))
        rings = [
            np.vstack((ring, ring[:1])) for ring, _ in fence_rings(event.mission.fence, self._farm.frame)
        ]
        colours = [colour] + [style.rgb(style.FENCE)] * len(rings)
        lines = [event.path_m, *rings] if len(event.path_m) else rings
        places = rr.GeoLineStrings(
            lat_lon=[style.places_of(self._farm, line) for line in lines], colors=colours[-len(lines) :]
        )
        height_m = highest_m(event.mission, self._farm)
        heights = [height_m if line is event.path_m else 0.0 for line in lines]
        strips = [_raised(line, height) for line, height in zip(lines, heights, strict=True)]
        self._log(event.time_s, f"map/vehicle_{number}/plan", places)
        scene = rr.LineStrips3D(strips, colors=[(*one, 128) for one in colours[-len(lines) :]])
        self._log(event.time_s, f"scene/vehicle_{number}/plan", scene)
        body = rr.Arrows3D(vectors=[(self._size_m, 0.0, 0.0)], radii=[0.15 * self._size_m], colors=[colour])
        self._recording.log(f"scene/vehicle_{number}/body", body, static=True)

    def _log_flight(self, number: int) -> None:
        """Log the states of a flight and its growing track."""
        rr, states = self._rr, self._states.pop(number, [])
        if len(states) < 2:
            return
        times = rr.TimeColumn(TIME_LINE, timestamp=np.array([self._at(state.time_s) for state in states]))
        flown = np.array([(state.x_m, state.y_m, state.height_m) for state in states])
        places, yaws = style.places_of(self._farm, flown), _yaws(states, flown, self._farm.frame.rotation_deg)
        turned = np.column_stack([np.zeros((len(yaws), 2)), np.sin(0.5 * yaws), np.cos(0.5 * yaws)])
        colour = style.rgb(style.vehicle_colour(number))

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
        step = -(-len(states) // style.TRACK_POINTS)
        for end in np.unique(np.linspace(2, len(states), style.SHOWN_AGAIN).astype(int)).tolist():
            rows = np.unique(np.append(np.arange(0, end, step), end - 1))
            line = rr.LineStrips3D([flown[rows]], colors=[colour])
            self._log(states[end - 1].time_s, f"scene/vehicle_{number}/track", line)
            track = rr.GeoLineStrings(lat_lon=[places[rows]], colors=[colour])
            self._log(states[end - 1].time_s, f"map/vehicle_{number}/track", track)

    def _log_readings(self, time_s: float) -> None:
        """Log all readings of the current day."""
        self._readings = 0
        if not self._seen:
            return
        parts = [one.observations for one in self._seen]
        cells = np.concatenate([np.stack([part.x, part.y], 1) for part in parts]) + 0.5
        values = np.concatenate([part.values for part in parts])
        points = self._rr.Points3D(
            _raised(self._farm.cell_size_m * cells, 0.0),
            colors=reading_colours(self._fields, values),
            radii=[0.4 * self._farm.cell_size_m],
        )
        self._log(time_s, "scene/readings", points)

    def _log_estimate(self, event: events.Estimated) -> None:
        if event.score is not None:
            self._log(event.time_s, "plots/score", self._rr.Scalars(event.score.score))
            for name, loss in zip(event.score.fields, event.score.field_loss, strict=True):
                self._log(event.time_s, f"plots/loss/{name}", self._rr.Scalars(loss))
        if event.model is not None:
            self._log_layers(event.time_s, "estimate", event.model.value)
            self._log_layers(event.time_s, "uncertainty", event.model.uncertainty)

    def _log_layers(self, time_s: float, what: str, values: NDArray[np.float32]) -> None:
        layers = self._layers
        for k, field in enumerate(self._fields):
            colours = layers.uncertainty_colours if what == "uncertainty" else layers.colours
            painted = colours(k, layers.means(k, values[k]))
            # Image rows start at the top.
            rows = np.ascontiguousarray(painted.transpose(1, 0, 2)[::-1])
            self._log(time_s, f"layers/{field.name}/{what}", self._rr.Image(rows, "RGBA"))


def _raised(points: NDArray[np.floating], height_m: float) -> NDArray[np.float64]:
    """Return points, float64[n, 2], with the height `height_m`."""
    return np.column_stack([points, np.full(len(points), height_m)])


def _yaws(
    states: list[events.VehicleMoved], flown: NDArray[np.float64], rotation_deg: float
) -> NDArray[np.float64]:
    """Return yaws, anticlockwise from the x axis: the heading if known, else the track direction."""
    steps = np.diff(flown[:, :2], axis=0, append=flown[-1:, :2])
    along = np.arctan2(steps[:, 1], steps[:, 0])
    told = np.array([math.nan if state.heading_rad is None else state.heading_rad for state in states])
    looks = 0.5 * math.pi - told - math.radians(rotation_deg)
    return np.where(np.isfinite(looks), looks, along)


def blueprint_of(rrb: Any, result: RunRecord) -> Any:
    """Return the Rerun blueprint of a run: map and log, scene and layers, plots."""
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

    Raises
    ------
    ExportError
        If the packages of the extra ``rerun`` are not installed.
    """
    rr = load_extra("rerun", "rerun", "recordings of Rerun need", ExportError)
    rrb = load_extra("rerun.blueprint", "rerun", "recordings of Rerun need", ExportError)
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
