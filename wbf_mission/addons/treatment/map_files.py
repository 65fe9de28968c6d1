"""Files of a treatment map for GIS, sprayer and farmer: GeoTIFF, GeoJSON, GeoPackage, Shapefile, HTML."""

from __future__ import annotations

import tempfile
import warnings
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from geo import Farm
from sensors.fields import Field
from sensors.scoring.information import InformationModel
from wbf_mission.addons.treatment.farmer_page import write_page
from wbf_mission.addons.treatment.gis import UtmCells, gdal_errors, gis, raster
from wbf_mission.addons.treatment.treatment_map import TreatmentMap
from wbf_mission.addons.treatment.zone_shapes import Zone
from wbf_mission.progress import Progress
from wbf_mission.results.files import write_json

PAGE, SUMMARY = "report.html", "map.json"
_VALUES, _RATES = ("map_", ".tif"), ("prescription_", ".zip")
NODATA = -9999.0
_STRIP = 512


def is_part(name: str) -> bool:
    """Return whether `name` is the name of a file that `write_map` may write."""
    many = any(name.startswith(start) and name.endswith(end) for start, end in (_VALUES, _RATES))
    return many or name in (PAGE, "zones.geojson", "zones.gpkg", "observations.parquet", SUMMARY)


def write_map(of: TreatmentMap, folder: Path, progress: Progress, **more: Any) -> list[Path]:
    """Write a treatment map into a folder, and return the files; `more` is added to the summary.

    Each field gets a map_NAME.tif and a prescription_NAME.zip. All fields share zones.geojson, zones.gpkg and
    report.html. Raises MapError if the extra ``gis`` is not installed, or the farm does not fit into UTM.
    """
    folder.mkdir(exist_ok=True)
    with gdal_errors(folder):
        names = [zones.field.name for zones in of.zone_maps]
        steps = len(names) + 2
        progress("writing the map", 0, steps)
        files = []
        for number, name in enumerate(names, start=1):
            files.append(folder / name.join(_VALUES))
            deviation = of.states_deviation
            write_geotiff(files[-1], of.farm, of.fields[name], of.model, deviation=deviation, day=of.day)
            progress("writing the map", number, steps)
        files += write_zones(folder, of.farm, of.zones)
        for name in names:
            zones = [zone for zone in of.zones if zone.field == name]
            if zones:
                files.append(folder / name.join(_RATES))
                write_prescription(files[-1], of.farm, zones)
        progress("writing the map", steps - 1, steps)
    files += [folder / name for name in (PAGE, "observations.parquet", SUMMARY)]
    write_page(files[-3], of)
    progress("writing the map", steps, steps)
    of.observations.save(files[-2])
    write_json(files[-1], {**of.summary(), **more})
    return files


def write_geotiff(
    path: Path, farm: Farm, field: Field, model: InformationModel, *, deviation: bool, day: int
) -> UtmCells:
    """Write the estimate of one field as a cloud-optimised GeoTIFF, float32, and return its georeference.

    Band 1 is the value in the field's unit, band 2 the uncertainty. Cells outside the owner's land or without
    the field's crops are `NODATA`. If `deviation`, the uncertainty is a standard deviation; otherwise it is
    on the estimator's own scale. Raises MapError if rasterio is not installed, or `UtmCells.of` fails.
    """
    rasterio, copying = gis("rasterio"), gis("rasterio.shutil")
    cells = UtmCells.of(farm)
    k = model.fields.index(field.name)
    mask = field.mask(farm.grid())
    width = field.range[1] - field.range[0]
    profile = {
        "driver": "GTiff",
        "width": farm.width_cells,
        "height": farm.height_cells,
        "count": 2,
        "dtype": "float32",
        "nodata": NODATA,
        "crs": f"EPSG:{cells.epsg}",
        "transform": rasterio.Affine(*cells.affine),
        "tiled": True,
        "blockxsize": _STRIP,
        "blockysize": _STRIP,
        "BIGTIFF": "IF_SAFER",
    }
    # GDAL's COG driver can only copy an existing raster; this raster is a file on disk to save memory.
    plain = path.with_name(f".{path.name}.plain.tif")
    scale = "standard deviation" if deviation else "doubt on the estimator's own scale"
    with warnings.catch_warnings():
        # rasterio warns about tiles that are larger than the raster.
        warnings.simplefilter("ignore", rasterio.errors.RasterioDeprecationWarning)
        try:
            with rasterio.open(plain, "w", **profile) as file:
                for top in range(0, farm.height_cells, _STRIP):
                    rows = slice(top, min(top + _STRIP, farm.height_cells))
                    value = field.to_unit(raster(model.value[k])[rows])
                    doubt = raster(model.uncertainty[k])[rows] * np.float32(width if deviation else 1.0)
                    for band, array in ((1, value), (2, doubt)):
                        part = np.where(raster(mask)[rows], array, np.float32(NODATA)).astype(np.float32)
                        window = rasterio.windows.Window(0, top, farm.width_cells, len(part))
                        file.write(part, band, window=window)
                file.descriptions = (f"{field.title}: value", f"{field.title}: uncertainty ({scale})")
                file.units = (field.unit, field.unit if deviation else "")
                file.update_tags(farm=farm.name, field=field.name, day=day, software="wbf-mission")
            copying.copy(
                plain,
                path,
                driver="COG",
                COMPRESS="DEFLATE",
                LEVEL="1",
                PREDICTOR="YES",
                NUM_THREADS="ALL_CPUS",
                OVERVIEW_RESAMPLING="AVERAGE",
            )
        finally:
            plain.unlink(missing_ok=True)
    return cells


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
    _write(files[1], farm, zones, columns, driver="GPKG", layer="zones")
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
                # ZipInfo's default date is always in 1980, so equal maps give equal files.
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
        geometry=np.array(shapely.to_wkb(_to_wgs84(farm, [zone.polygon for zone in zones])), np.object_),
        field_data=arrays,
        fields=list(columns),
        geometry_type="Polygon",
        crs="EPSG:4326",
        **how,
    )


def _to_wgs84(farm: Farm, polygons: Sequence[shapely.Polygon]) -> NDArray[np.object_]:
    """Convert polygons from the farm's frame to longitude and latitude (degrees).

    Beyond the antimeridian, longitudes exceed 180 degrees, so that polygons stay connected.
    """
    origin = farm.frame.longitude_deg

    def transform(xy: NDArray[np.float64]) -> NDArray[np.float64]:
        latitude, longitude = farm.frame.to_wgs84(xy[:, 0], xy[:, 1])
        return np.column_stack((origin + (longitude - origin + 180.0) % 360.0 - 180.0, latitude))

    moved: NDArray[np.object_] = shapely.transform(np.array(polygons, np.object_), transform)
    return moved
