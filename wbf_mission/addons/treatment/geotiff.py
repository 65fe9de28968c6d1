"""Cloud-optimised GeoTIFF files of estimates."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from geo import Farm
from sensors.fields import Field
from sensors.scoring.information import InformationModel
from wbf_mission.addons.treatment.gis import UtmCells, gis, raster

NODATA = -9999.0
_STRIP = 512


def write_geotiff(
    path: Path, farm: Farm, field: Field, model: InformationModel, *, deviation: bool, day: int
) -> UtmCells:
    """Write the estimate of one field as float32, and return the georeference of the cells.

    Band 1 is the value in the field's unit, band 2 the uncertainty. Cells outside the owner's land or without
    the field's crops are `NODATA`. `deviation`: the uncertainty is a standard deviation; otherwise it has the
    estimator's own scale.

    Raises
    ------
    MapError
        If rasterio is not installed, or `UtmCells.of` fails.
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
    # GDAL's COG driver can only copy an existing raster; a file on disk saves memory.
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
