"""Makes missions from drawn or recorded paths: each point of a path becomes a waypoint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice

from geo.texts import one_line
from mission.errors import MissionFileError
from mission.files.common import make_item, make_mission
from mission.model import MAX_ITEMS, Command, Frame, Mission, MissionItem

_MOST_NAMES = 8


@dataclass(frozen=True, slots=True)
class Point:
    """A position (degrees), altitude (m) and altitude frame; None if the file has no altitude."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float | None = None
    frame: Frame | None = None
    where: str = ""


@dataclass(frozen=True, slots=True)
class DrawnPath:
    """A drawn path, with its name in the file and its points in order."""

    name: str
    points: Sequence[Point]


@dataclass(frozen=True, slots=True)
class Drawing:
    """The paths in a file with drawings or tracks."""

    paths: Sequence[DrawnPath]
    areas: int = 0  # Number of polygons in the file, which are not used.
    no_altitudes: str = "the file gives none"  # Reason for missing altitudes, for the error message.
    notes: tuple[str, ...] = ()  # Notes on the file.

    def mission(self, altitude_m: float | None = None, name: str | None = None) -> tuple[Mission, list[str]]:
        """Return a mission along the path `name` (default: the only path), and notes on the mission.

        MissionFileError if there is no such path, or a point has no altitude and `altitude_m` is None.
        """
        path = self._chosen(name)
        if len(path.points) > MAX_ITEMS:
            raise MissionFileError(
                f"{path.name}: {len(path.points)} points, but MAVLink allows {MAX_ITEMS} items; drop points"
            )
        made = make_mission((self._waypoint(point, path, altitude_m) for point in path.points), None)
        names = {Frame.GLOBAL_RELATIVE_ALT: "above home", Frame.GLOBAL: "above sea level"}
        frames = {item.frame for item in made.items}
        above = " and ".join(name for frame, name in names.items() if frame in frames)
        notes = [
            *self.notes,
            f"the {len(path.points)} points of {path.name} are waypoints, altitudes {above};"
            " no take-off, landing, speed or home is added",
        ]
        if self.areas:
            notes.append(f"{self.areas} polygons are left out")
        return made, notes

    def _waypoint(self, point: Point, path: DrawnPath, altitude_m: float | None) -> MissionItem:
        frame: Frame | None = Frame.GLOBAL_RELATIVE_ALT
        if altitude_m is None:
            altitude_m, frame = point.altitude_m, point.frame
        where = f"{path.name}, {point.where}"
        if altitude_m is None or frame is None:
            raise MissionFileError(
                f"{where}: no altitude to fly at ({self.no_altitudes}); give an altitude above home"
                " (convert --altitude METRES)"
            )
        place = (point.latitude_deg, point.longitude_deg, altitude_m)
        return make_item(where, Command.NAV_WAYPOINT, frame, (0.0, 0.0, 0.0, None), place, autocontinue=True)

    def _chosen(self, name: str | None) -> DrawnPath:
        paths = [path for path in self.paths if path.points and name in (None, path.name)]
        if len(paths) == 1:
            return paths[0]
        known = ", ".join(repr(path.name) for path in islice(self.paths, _MOST_NAMES))
        known += f" and {len(self.paths) - _MOST_NAMES} more" if len(self.paths) > _MOST_NAMES else ""
        if name is not None and self.paths:
            problem = "is there more than once" if paths else "is not there"
            raise MissionFileError(one_line(f"the path {name!r} {problem}; the paths are {known}"))
        if paths:
            raise MissionFileError(one_line(f"{len(paths)} paths: {known}; choose one (convert --path NAME)"))
        if self.areas:
            raise MissionFileError(
                f"{self.areas} areas (polygons), but no path; to plan a flight over a field, give the file as"
                " a farm (wbf-mission plan --farm FILE)"
            )
        raise MissionFileError("the file has no path; draw a line, or give a mission")
