"""Zones and prescriptions in the files that GIS, farm software and terminals of sprayers read, by GDAL."""

from __future__ import annotations

import tempfile
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from geo import Farm
from wbf_mission.addons.treatment.gis import gis
from wbf_mission.addons.treatment.zone_shapes import Zone, to_wgs84

_WGS84 = "EPSG:4326"
_LAYER = "zones"


def write_zones(folder: Path, farm: Farm, zones: Sequence[Zone]) -> list[Path]:
    """Write ``zones.geojson`` (RFC 7946) and ``zones.gpkg`` of all fields, in WGS84; return the files."""
    columns: dict[str, list[Any]] = {
        "field": [one.field for one in zones],
        "zone": [one.word for one in zones],
        "area_ha": [round(one.area_ha, 6) for one in zones],
        "need": [round(one.need, 6) for one in zones],
        "gain": [one.gain for one in zones],
        "rate": [one.rate for one in zones],
        "rate_unit": [one.rate_unit for one in zones],
    }
    files = [folder / "zones.geojson", folder / "zones.gpkg"]
    _write(files[0], farm, zones, columns, driver="GeoJSON", RFC7946="YES", WRITE_NAME="NO")
    _write(files[1], farm, zones, columns, driver="GPKG", layer=_LAYER)
    return files


def write_prescription(path: Path, farm: Farm, zones: Sequence[Zone]) -> None:
    """Write the zones of one field as a zipped Shapefile with the column RATE, 0 where nothing is treated."""
    columns: dict[str, list[Any]] = {
        "RATE": [one.rate for one in zones],
        "UNIT": [one.rate_unit for one in zones],
        "ZONE": [one.word for one in zones],
        "AREA_HA": [round(one.area_ha, 6) for one in zones],
    }
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        shape = Path(folder) / f"{path.stem}.shp"
        _write(shape, farm, zones, columns, driver="ESRI Shapefile", encoding="UTF-8")
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for part in sorted(Path(folder).iterdir()):
                # Of the epoch of such archives: the same map gives the same file.
                entry = zipfile.ZipInfo(part.name)
                entry.compress_type = zipfile.ZIP_DEFLATED
                archive.writestr(entry, part.read_bytes())


def _write(path: Path, farm: Farm, zones: Sequence[Zone], columns: dict[str, list[Any]], **how: Any) -> None:
    texts = [isinstance(next(iter(values), ""), str) for values in columns.values()]
    arrays = [
        np.array(values, np.object_ if text else np.float64)
        for text, values in zip(texts, columns.values(), strict=True)
    ]
    gis("pyogrio.raw").write(
        path,
        geometry=np.array(shapely.to_wkb(to_wgs84(farm, [one.polygon for one in zones])), np.object_),
        field_data=arrays,
        fields=list(columns),
        geometry_type="Polygon",
        crs=_WGS84,
        **how,
    )
