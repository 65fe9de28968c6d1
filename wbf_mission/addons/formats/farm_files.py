"""Reads farm files: KML, KMZ, Shapefile, GeoPackage and GPX by GDAL, and ``.poly``; repairs polygons.

Files are not trusted. GDAL is given only local files that begin with the bytes of their format: if a file
named ``.gpkg`` contained a list of web addresses, GDAL would open these. This module unpacks archives, with
a size limit. XML with entities or external links is refused.
"""

from __future__ import annotations

import contextlib
import logging
import re
import sqlite3
import struct
import tempfile
import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.parsers import expat

import msgspec
import numpy as np
import shapely
from numpy.typing import NDArray

from geo.errors import FarmError
from geo.features import (
    KNOWN,
    MAX_FEATURES,
    MAX_VERTICES,
    Document,
    Entry,
    Feature,
    farm_properties,
    kind_of,
    short_line,
)
from geo.frame import EXAMPLE_CRS, Coordinates, LocalFrame, coordinates_of
from geo.imports import load_extra
from geo.reading import UnreadableError, read_file, read_text
from geo.texts import decimal_point, one_line, parse_number
from wbf_mission.addons.base.archive import Archive, ArchiveError

# Limits that protect against hostile files.
_MAX_BYTES = 128 * 2**20
_MAX_TEXT_BYTES = 32 * 2**20  # Limit for XML and .poly files.
_MAX_LAYERS = 100
_MAX_DEPTH = 100  # Limit of nesting in XML.
_MAX_GAP_M = 5.0  # Maximum gap between the ends of a track round a field: the error of a handheld receiver.
_SHOWN_GAP_M = 0.05  # Smaller gaps are rounding errors.
_SHAPEFILE = (".shp", ".shx", ".dbf", ".prj", ".cpg")
_WKB = dict(enumerate(("Point", "LineString", "Polygon", "MultiPoint", "MultiLineString", "MultiPolygon"), 1))
_WKB[7] = "GeometryCollection"
_GPX_LAYERS = ("routes", "tracks", "waypoints")  # Other GPX layers repeat the points of these layers.
_POLY_WORDS = re.compile(r"(name|color):(.*)", re.IGNORECASE)


def read_vector(path: Path, layer: str | None = None, crs: str | None = None) -> Document:
    """Return the features of a file: of all layers, or of one layer. A .zip must contain a Shapefile.

    `crs` is the coordinate system of a file that states none. FarmError if GDAL is not installed, or the file
    cannot be used.
    """
    needed = f"{path}: {path.suffix.lower()} files need"
    load_extra("pyogrio.raw", "gis", needed, FarmError)
    pyogrio = load_extra("pyogrio", "gis", needed, FarmError)
    logging.getLogger("pyogrio").addHandler(logging.NullHandler())
    document = Document({}, [])
    with _plain(path, document.notes) as (plain, inside), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            names = _layers(plain, pyogrio.list_layers)
            named = [inside] if plain.suffix.lower() == ".shp" else names
            if layer is not None:
                if layer not in named:
                    known = ", ".join(map(repr, named[:20]))
                    raise FarmError(f"there is no layer {layer!r:.60}; its layers are {known}")
                names = [names[named.index(layer)]]
            for name in names:
                where = "" if len(names) == 1 else f"layer {name!r:.60}, "
                _read_layer(pyogrio, plain, name, where, crs, document)
        except FarmError:
            raise
        except Exception as error:  # For a broken file, pyogrio may raise any error
            is_coding = isinstance(error, UnicodeError)
            text = "it has bytes that are not text" if is_coding else str(error) or type(error).__name__
            reason = one_line(text.replace(str(plain), path.name), 200)
            raise FarmError(f"cannot be read: {reason}; save the file again") from error
    return document


@contextlib.contextmanager
def _plain(path: Path, notes: list[str]) -> Iterator[tuple[Path, str]]:
    """Check a file; yield the path that GDAL may open, and the file's name; add notes on an archive."""
    suffix = path.suffix.lower()
    try:
        if suffix in (".kml", ".gpx"):
            _check_xml(read_file(path, _MAX_TEXT_BYTES), suffix)
        elif suffix in (".kmz", ".zip"):
            with tempfile.TemporaryDirectory() as folder:
                yield _unpacked(path, Path(folder), notes)
            return
        elif suffix == ".shp":
            _check_shapefile(path)
        else:
            _check_head(path, b"SQLite format 3\0", "GeoPackage")
    except UnreadableError as error:
        raise FarmError(f"cannot be read: {error}") from None
    absolute = path.resolve()
    if str(absolute).startswith("/vsi"):
        raise FarmError("is not an ordinary file")
    yield absolute, path.stem


def _check_head(path: Path, head: bytes, what: str) -> None:
    """Refuse a file that is too large, or does not begin with the bytes of its format."""
    try:
        if path.exists() and not path.is_file():
            raise FarmError("cannot be read: it is a folder, a pipe or a device, not a file")
        with path.open("rb") as file:
            begin = file.read(len(head))
    except FarmError:
        raise
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "it has an impossible name"
        raise FarmError(f"cannot be read: {reason.lower()}") from None
    if begin != head:
        raise FarmError(f"is no {what}")
    if path.stat().st_size > _MAX_BYTES:
        raise FarmError(f"is larger than {_MAX_BYTES / 2**20:g} MiB")


def _check_shapefile(path: Path) -> None:
    _check_head(path, b"\0\0\x27\x0a", "Shapefile")
    beside = [file for file in path.absolute().parent.iterdir() if file.stem == path.stem]
    siblings = {file.suffix.lower(): file for file in beside if file.is_file()}
    if ".shx" not in siblings:
        raise FarmError("its .shx is missing: a Shapefile has several files; copy .shp, .shx, .dbf and .prj")
    for suffix in set(_SHAPEFILE) & siblings.keys():
        if siblings[suffix].stat().st_size > _MAX_BYTES:
            raise FarmError(f"its {suffix} is larger than {_MAX_BYTES / 2**20:g} MiB")


def _check_xml(data: bytes, suffix: str) -> None:
    """Refuse XML that is neither KML nor GPX, has entities or external links, or is nested too deeply."""
    parser = expat.ParserCreate(namespace_separator=" ")
    open_elements: list[str] = []
    names: set[str] = set()

    def start(name: str, _: object) -> None:
        open_elements.append(name.rpartition(" ")[2])
        names.add(open_elements[-1])
        if len(open_elements) == 1 and open_elements[0] != suffix[1:]:
            raise FarmError(f"is no {suffix[1:].upper()}: it begins with <{open_elements[0]:.40}>")
        if len(open_elements) > _MAX_DEPTH:
            raise FarmError("is nested too deeply")

    def doctype(*_: object) -> None:
        raise FarmError("has a document type with entities (<!DOCTYPE>), which is not read; remove it")

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: open_elements.pop()
    parser.StartDoctypeDeclHandler = doctype
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise FarmError(f"is not XML (line {error.lineno}: {expat.errors.messages[error.code]})") from None
    except LookupError as error:
        raise FarmError(f"is not XML ({one_line(str(error), 60)})") from None
    if "NetworkLink" in names:
        raise FarmError("has a NetworkLink, which is not fetched; save a file with the fields themselves")


def _unpacked(path: Path, folder: Path, notes: list[str]) -> tuple[Path, str]:
    """Unpack the main KML of a .kmz, or the Shapefile of a .zip, with a size limit."""
    kmz = path.suffix.lower() == ".kmz"
    wanted = (".kml",) if kmz else _SHAPEFILE
    _check_head(path, b"PK", "archive")
    try:
        with Archive(path, _MAX_TEXT_BYTES if kmz else _MAX_BYTES) as archive:
            mains = [name for name in archive.names if name.lower().endswith(wanted[0])]
            if kmz and len(mains) > 1:
                mains[:], note = archive.kml()
                notes.append(note)
            if len(mains) != 1:
                named = f" ({one_line(', '.join(mains), 100)})" if mains else ""
                raise FarmError(f"holds {len(mains)} files {wanted[0]}{named}; give an archive with only one")
            main = mains[0][:-4]
            for name in archive.names:
                suffix = name[-4:].lower()
                if name[:-4] != main or suffix not in wanted:
                    continue
                data = archive.read(name)
                if kmz:
                    _check_xml(data, ".kml")
                (folder / f"unpacked{suffix}").write_bytes(data)
    except ArchiveError as error:
        raise FarmError(str(error)) from None
    plain = folder / f"unpacked{wanted[0]}"
    if not kmz:
        _check_shapefile(plain)
    return plain, Path(main).name


def _layers(plain: Path, list_layers: Any) -> list[str]:
    """Return the names of the layers with features."""
    if plain.suffix.lower() == ".gpkg":
        # Views are not read: their queries may never finish, or may need functions of GDAL.
        base = sqlite3.connect(f"{plain.as_uri()}?mode=ro&immutable=1", uri=True)
        with contextlib.closing(base):
            found = base.execute(
                "SELECT table_name FROM gpkg_contents JOIN sqlite_master ON name = table_name "
                "WHERE data_type = 'features' AND type = 'table'"
            ).fetchmany(_MAX_LAYERS + 1)
        names = [str(name) for (name,) in found]
    else:
        names = [str(name) for name, _ in list_layers(plain)]
    if plain.suffix.lower() == ".gpx":
        names = [name for name in _GPX_LAYERS if name in names]
    if not names:
        raise FarmError("has no layer with features (views are not read)")
    if len(names) > _MAX_LAYERS:
        raise FarmError(f"has more than {_MAX_LAYERS} layers; name one: FILE|layername=LAYER")
    return names


def _read_layer(
    pyogrio: Any, plain: Path, name: str, where: str, crs: str | None, document: Document
) -> None:
    """Add the features of a layer to a document."""
    options = {"IMMUTABLE": "YES"} if plain.suffix.lower() == ".gpkg" else {}
    fields = pyogrio.read_info(plain, layer=name, **options)["fields"]
    meta, _, geometries, columns = pyogrio.raw.read(
        plain,
        layer=name,
        columns=[field for field in fields if field.lower() in KNOWN],
        force_2d=True,
        max_features=MAX_FEATURES + 1,
        **options,
    )
    if geometries is None or not len(geometries):
        return
    if len(document.entries) + len(geometries) > MAX_FEATURES:
        raise FarmError(f"{where or 'it '}has more than {MAX_FEATURES} features; leave out other farms")
    shapes = shapely.from_wkb(geometries, on_invalid="fix")
    if int(shapely.get_num_coordinates(shapes).sum()) > MAX_VERTICES:
        raise FarmError(f"{where}has more than {MAX_VERTICES} vertices; simplify the polygons")
    own = _coordinates(meta["crs"], crs, shapes, name, document)
    takes_lines = plain.suffix.lower() in (".kml", ".gpx")
    kind = kind_of(name)
    for row, shape in enumerate(shapes):
        values = {}
        for field, column in zip(meta["fields"], columns, strict=True):
            value = column[row].item() if isinstance(column[row], np.generic) else column[row]
            values[str(field)] = value if isinstance(value, (int, float, str, bool)) else None
        properties = farm_properties(values, literal=False)
        if kind:
            properties.setdefault("kind", kind)
        geometry: dict[str, Any] | None = None
        note = useless = ""
        if shape is not None and shapely.from_wkb(geometries[row], on_invalid="ignore") is None:
            geometry, _ = _as_written(geometries[row], 0)
        elif shape is not None and not shape.is_empty:
            if takes_lines and shape.geom_type in ("LineString", "MultiLineString"):
                shape, note, useless = _border(shape)
            geometry = msgspec.json.decode(shapely.to_geojson(shape))
        entry = Entry(row + 1, properties, geometry, own, where, useless)
        document.entries.append(entry)
        if note:
            called = properties.get("name", "")
            document.notes.append(f"{entry.where}{f' ({called!r:.60})' if called else ''}: {note}")


def _border(line: Any) -> tuple[Any, str, str]:
    """Return the polygon of a closed line and a note on its gap; for an open line, the line and the fault."""
    xy = np.concatenate([shapely.get_coordinates(part) for part in shapely.get_parts(line)])
    east_m, north_m = LocalFrame(xy[0, 1], xy[0, 0]).from_wgs84(float(xy[-1, 1]), float(xy[-1, 0]))
    gap_m = float(np.hypot(east_m, north_m))
    if len(xy) < 4 or not gap_m <= _MAX_GAP_M:
        return line, "", f"lines that are open by more than {_MAX_GAP_M:g} m"
    note = f"a line, closed over {gap_m:.1f} m" if gap_m > _SHOWN_GAP_M else ""
    return shapely.Polygon(xy), note, ""


def _as_written(wkb: bytes, at: int) -> tuple[dict[str, Any], int]:
    """Convert well-known binary to GeoJSON with unchanged rings; return the GeoJSON and the next offset."""
    order = "<>"[wkb[at] == 0]
    kind, count = struct.unpack_from(f"{order}II", wkb, at + 1)
    name = _WKB.get(kind, "")
    if name == "Point":
        return {"type": name, "coordinates": list(struct.unpack_from(f"{order}2d", wkb, at + 5))}, at + 21
    parts: list[Any] = []
    at += 5 if name == "LineString" else 9
    for _ in range(1 if name == "LineString" else count):
        if name in ("LineString", "Polygon"):
            (length,) = struct.unpack_from(f"{order}I", wkb, at)
            parts.append(np.frombuffer(wkb, f"{order}f8", 2 * length, at + 4).reshape(-1, 2).tolist())
            at += 4 + 16 * length
        else:
            part, at = _as_written(wkb, at)
            parts.append(part if name == "GeometryCollection" else part["coordinates"])
    if name == "GeometryCollection":
        return {"type": name, "geometries": parts}, at
    return {"type": name, "coordinates": parts[0] if name == "LineString" else parts}, at


def _coordinates(
    own: str | None, given: str | None, shapes: NDArray[Any], name: str, document: Document
) -> Coordinates | None:
    # A GeoPackage without a coordinate system declares a local coordinate system.
    if own and not own.startswith(("LOCAL_CS", "ENGCRS")):
        if given is not None:
            raise FarmError(f"names a coordinate system; do not give {given!r:.60}, too")
        return None if own == "EPSG:4326" else Coordinates(own)
    if given is not None:
        return coordinates_of(given)
    west, south, east, north = shapely.total_bounds(shapes)
    if not (-180 <= west <= east <= 180 and -90 <= south <= north <= 90):
        raise FarmError(
            f"layer {name!r:.60} has no coordinate system (a Shapefile has it in its .prj), and its "
            f"coordinates are not degrees: give it with --farm-crs, such as {EXAMPLE_CRS}"
        )
    document.notes.append("no coordinate system is given: read as longitudes and latitudes of WGS 84")
    return None


def read_poly(path: Path, layer: str | None = None, crs: str | None = None) -> Document:
    """Return the polygons of a ``.poly`` file of Mission Planner; FarmError if the file cannot be read.

    Each line has the latitude and longitude of a corner; the last corner repeats the first; ``#`` begins a
    comment. Files of regions have lines ``Name:...`` and ``Color:...`` above each polygon. Source:
    ArduPilot/MissionPlanner, FlightPlanner.cs and Regions.cs.
    """
    if layer is not None:
        raise FarmError(f"a .poly has no layers; leave |{layer} out")
    if crs is not None:
        raise FarmError(f"a .poly is in degrees of WGS 84; leave out the coordinate system {crs!r:.60}")
    try:
        text = read_text(path, _MAX_TEXT_BYTES)
    except UnreadableError as error:
        raise FarmError(f"cannot be read: {error}") from None
    polygons: list[tuple[str, list[list[float]]]] = []
    corners = 0
    for number, line in enumerate(map(str.strip, text.split("\n")), 1):
        word = _POLY_WORDS.fullmatch(line)
        if not line or line.startswith("#"):
            continue
        if word is None:
            polygons = polygons or [("", [])]
            polygons[-1][1].append(_poly_corner(line, number))
            corners += 1
        elif word[1].lower() == "name":
            polygons.append((one_line(word[2].strip(), 60), []))
        if corners > MAX_VERTICES or len(polygons) > MAX_FEATURES:
            raise FarmError(f"line {number}: more than {MAX_VERTICES} corners; simplify the polygons")
    if not corners:
        raise FarmError("has no corners; give a .poly of Mission Planner")
    document = Document({}, [])
    for number, (name, ring) in enumerate(polygons, 1):
        geometry = {"type": "Polygon", "coordinates": [ring] if ring else []}
        document.entries.append(Entry(number, {"name": name} if name else {}, geometry))
    return document


def _poly_corner(line: str, number: int) -> list[float]:
    try:
        latitude_deg, longitude_deg = (parse_number(decimal_point(word)) for word in line.split())
    except ValueError:
        raise FarmError(
            f"line {number}: {line!r:.60} is not a latitude and a longitude, as in a .poly of Mission Planner"
        ) from None
    return [longitude_deg, latitude_deg]


_MAX_CHANGE = 0.01  # Maximum change, as a fraction of the area: fields are not measured more accurately.
_SLIVER = 0.001  # Parts below this fraction of the land are slivers between crossing sides.
_GRID_M = 1e-3  # Grid step of repaired corners, coarser than the rounding of degrees in files.


def mended(feature: Feature, notes: list[str]) -> list[Feature]:
    """Return the repaired parts of a feature with closed rings, or the unchanged feature if it is valid.

    A ring that crosses or touches itself is replaced by the land that it encloses (GEOS's "structure"
    method). Overlapping holes are joined and clipped to the land. Corners are rounded to whole millimetres.
    Parts smaller than a thousandth of the land are dropped. FarmError if these repairs change more than a
    hundredth of the area: corners in a wrong order cannot be repaired safely.
    """
    longitude_deg, latitude_deg = feature.rings[0][0].tolist()
    frame, changes = LocalFrame(latitude_deg, longitude_deg), list[str]()
    rings = [np.column_stack(frame.from_wgs84(ring[:, 1], ring[:, 0])) for ring in feature.rings]
    holes = [ring for ring in rings[1:] if len(np.unique(ring, axis=0)) >= 3]
    if len(holes) < len(rings) - 1:
        changes.append("holes that have no area are left out")
    if len(np.unique(rings[0], axis=0)) < 3:
        raise FarmError(f"{feature.where}: the polygon has no area")
    polygon = shapely.Polygon(rings[0], holes)
    if shapely.is_valid(polygon):
        parts = [polygon]
    else:
        reason = re.sub(r"\s*\[.*", "", shapely.is_valid_reason(polygon))
        changes.append(reason[:1].lower() + reason[1:])
        parts = _parts(rings[0], holes, feature.where)
    if not changes:
        return [feature]
    before, after = polygon.area, sum(part.area for part in parts)
    pieces = "" if len(parts) == 1 else f" in {len(parts)} parts"
    notes.append(f"{feature.where}: mended ({', '.join(changes)}): {before:.1f} -> {after:.1f} m2{pieces}")
    return [
        replace(
            feature,
            where=feature.where if len(parts) == 1 else f"{feature.where}, part {number}",
            name=feature.name if len(parts) == 1 else short_line(feature.name, f" {number}"),
            rings=tuple(_degrees(ring, frame) for ring in (part.exterior, *part.interiors)),
        )
        for number, part in enumerate(parts, 1)
    ]


def _degrees(ring: shapely.LinearRing, frame: LocalFrame) -> NDArray[np.float64]:
    xy = shapely.get_coordinates(ring)
    latitude_deg, longitude_deg = frame.to_wgs84(xy[:, 0], xy[:, 1])
    positions = np.column_stack([longitude_deg, latitude_deg])
    positions[-1] = positions[0]
    return positions


def _parts(shell: NDArray[np.float64], holes: list[NDArray[np.float64]], where: str) -> list[shapely.Polygon]:
    """Return the polygons that invalid rings enclose, largest first."""
    polygons = [shapely.Polygon(ring) for ring in (shell, *holes)]
    within = shapely.make_valid(polygons, method="structure", keep_collapsed=False)
    drawn = [polygon.area for polygon in polygons]
    changed = sum(abs(land.area - area) for land, area in zip(within, drawn, strict=True))
    land = within[0].difference(shapely.union_all(within[1:])) if holes else within[0]
    # On a grid, corners keep a distance from other sides, so that rounded positions leave the polygon valid.
    land = shapely.set_precision(land, _GRID_M)
    kept = [
        part
        for part in sorted(shapely.get_parts(land), key=lambda part: -part.area)
        if part.geom_type == "Polygon" and part.area > max(_SLIVER * land.area, _GRID_M * part.length)
    ]
    changed += land.area - sum(part.area for part in kept)
    if not kept or changed > _MAX_CHANGE * land.area:
        raise FarmError(
            f"{where}: cannot be mended safely: it has {drawn[0] - sum(drawn[1:]):.1f} m2 as drawn, but its "
            f"rings enclose {land.area:.1f} m2 (over {_MAX_CHANGE:.0%} differs); are its corners in order?"
        )
    return kept
