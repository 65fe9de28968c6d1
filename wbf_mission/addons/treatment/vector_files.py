"""Vector files of zones (GeoJSON, GeoPackage) and prescriptions (Shapefile), written by GDAL."""

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
    """Write the zones of all fields to ``zones.geojson`` (RFC 7946) and ``zones.gpkg``; return the files."""
    columns: dict[str, list[Any]] = {
        "field": [zone.field for zone in zones],
        "zone": [zone.word for zone in zones],
        "area_ha": [round(zone.area_ha, 6) for zone in zones],
        "need": [round(zone.need, 6) for zone in zones],
        "gain": [zone.gain for zone in zones],
        "rate": [zone.rate for zone in zones],
        "rate_unit": [zone.rate_unit for zone in zones],
    }
    files = [folder / "zones.geojson", folder / "zones.gpkg"]
    _write(files[0], farm, zones, columns, driver="GeoJSON", RFC7946="YES", WRITE_NAME="NO")
    _write(files[1], farm, zones, columns, driver="GPKG", layer=_LAYER)
    return files


def write_prescription(path: Path, farm: Farm, zones: Sequence[Zone]) -> None:
    """Write the zones of one field as a zipped Shapefile; the column RATE is 0 in untreated zones."""
    columns: dict[str, list[Any]] = {
        "RATE": [zone.rate for zone in zones],
        "UNIT": [zone.rate_unit for zone in zones],
        "ZONE": [zone.word for zone in zones],
        "AREA_HA": [round(zone.area_ha, 6) for zone in zones],
    }
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        shape = Path(folder) / f"{path.stem}.shp"
        _write(shape, farm, zones, columns, driver="ESRI Shapefile", encoding="UTF-8")
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for part in sorted(Path(folder).iterdir()):
                # ZipInfo defaults to 1980, so that equal maps give equal files.
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
        geometry=np.array(shapely.to_wkb(to_wgs84(farm, [zone.polygon for zone in zones])), np.object_),
        field_data=arrays,
        fields=list(columns),
        geometry_type="Polygon",
        crs=_WGS84,
        **how,
    )
