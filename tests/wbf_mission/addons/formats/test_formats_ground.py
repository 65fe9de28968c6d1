"""Heights of the ground: bilinear, holes, several tiles, coordinate systems; and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import rasterio
from rasterio.transform import Affine, from_origin

from geo.errors import GroundError
from wbf_mission.addons.formats import ground as module
from wbf_mission.addons.formats.ground import Ground

PLACE = 28.05, -82.15
BOUNDS = PLACE[0] - 0.004, PLACE[1] - 0.004, PLACE[0] + 0.004, PLACE[1] + 0.004


def geotiff(
    path: Path,
    heights: np.ndarray,
    *,
    transform: Affine | None = None,
    crs: str | None = "EPSG:4326",
    **more: object,
) -> str:
    rows, columns = heights.shape
    own = transform or from_origin(PLACE[1] - 0.005, PLACE[0] + 0.005, 0.01 / columns, 0.01 / rows)
    units, scale = more.pop("units", None), more.pop("scale", None)
    with rasterio.open(
        path, "w", "GTiff", columns, rows, 1, crs=crs, transform=own, dtype=heights.dtype, **more
    ) as out:
        out.write(heights, 1)
        if units:
            out.units = (str(units),)
        if scale:
            out.scales = (float(str(scale)),)
    return str(path)


def plane(size: int = 100) -> np.ndarray:
    row, column = np.mgrid[:size, :size]
    return (20.0 + 0.3 * column - 0.2 * row).astype(np.float32)


def test_a_plane_is_met_between_the_pixels(tmp_path: Path) -> None:
    ground = Ground.read([geotiff(tmp_path / "a.tif", plane())], BOUNDS)
    rng = np.random.default_rng(1)
    latitude, longitude = PLACE[0] + rng.uniform(-0.003, 0.003, 50), PLACE[1] + rng.uniform(-0.003, 0.003, 50)
    column = (longitude - (PLACE[1] - 0.005)) / 1e-4 - 0.5
    row = (PLACE[0] + 0.005 - latitude) / 1e-4 - 0.5
    assert ground.heights(latitude, longitude) == pytest.approx(20.0 + 0.3 * column - 0.2 * row, abs=1e-3)
    assert ground.step_m == pytest.approx(9.8, abs=0.1)


@pytest.mark.parametrize("crs", ["EPSG:32617", "EPSG:3857"])
def test_other_coordinate_systems_and_turned_rasters(tmp_path: Path, crs: str) -> None:
    """The height is the easting less a constant, whatever the raster's rows run along."""
    from pyproj import Transformer

    to = Transformer.from_crs("EPSG:4326", crs, always_xy=True)
    x0, y0 = to.transform(PLACE[1], PLACE[0])
    turned = (
        Affine.translation(x0, y0)
        * Affine.rotation(30.0)
        * Affine.scale(10.0, -10.0)
        * Affine.translation(-60, -60)
    )
    column, row = np.meshgrid(np.arange(120) + 0.5, np.arange(120) + 0.5)
    x, _ = turned * (column, row)
    path = geotiff(tmp_path / "b.tif", (x - x0).astype(np.float32), transform=turned, crs=crs)
    ground = Ground.read([path], (PLACE[0] - 0.001, PLACE[1] - 0.001, PLACE[0] + 0.001, PLACE[1] + 0.001))
    latitude, longitude = PLACE[0] + np.linspace(-8e-4, 8e-4, 9), PLACE[1] + np.linspace(8e-4, -8e-4, 9)
    expected = to.transform(longitude, latitude)[0] - x0
    assert ground.heights(latitude, longitude) == pytest.approx(expected, abs=0.01)


def test_an_srtm_tile_is_read_by_its_name(tmp_path: Path) -> None:
    heights = np.full((1201, 1201), 5, ">i2")
    heights[600:, :] = 45
    heights[10, 10] = -32768
    path = tmp_path / "N28W083.hgt"
    path.write_bytes(heights.tobytes())
    ground = Ground.read([str(path)], BOUNDS)
    assert ground.heights(np.array([28.05]), np.array([-82.15]))[0] == pytest.approx(45.0)
    assert ground.step_m == pytest.approx(81.9, abs=1.0)
    north = Ground.read([str(path)], (28.8, -82.2, 28.9, -82.1))
    assert north.heights(np.array([28.85]), np.array([-82.15]))[0] == pytest.approx(5.0)


def test_holes_are_filled_from_their_neighbours_or_another_tile(tmp_path: Path) -> None:
    holed = np.full((100, 100), 7.0, np.float32)
    holed[50, 50] = -9999.0
    holed[20:40, 20:40] = np.nan
    first = geotiff(tmp_path / "c.tif", holed, nodata=-9999.0)
    second = geotiff(tmp_path / "d.tif", np.full((100, 100), 9.0, np.float32))
    middle = np.array([PLACE[0] - 0.00004]), np.array([PLACE[1] + 0.00004])
    hole = np.array([PLACE[0] + 0.002]), np.array([PLACE[1] - 0.002])
    alone = Ground.read([first], BOUNDS)
    assert alone.heights(*middle)[0] == pytest.approx(7.0)
    with pytest.raises(GroundError, match=r"there is no height at 28\.052000, -82\.152000; give a raster"):
        alone.heights(*hole)
    both = Ground.read([first, second], BOUNDS)
    assert both.heights(*hole)[0] == pytest.approx(9.0)
    assert both.heights(*middle)[0] == pytest.approx(7.0)


@pytest.mark.parametrize(
    ("units", "metres"),
    [
        (None, 1.0),
        ("Metre", 1.0),
        ("FEET", 0.3048),
        ("foot (international)", 0.3048),
        ("US survey foot", 1200 / 3937),
        ("ftUS", 1200 / 3937),
    ],
)
def test_units_and_scales_are_heeded(tmp_path: Path, units: str | None, metres: float) -> None:
    path = geotiff(tmp_path / "e.tif", np.full((50, 50), 5000, np.int16), units=units, scale=0.5)
    ground = Ground.read([path], BOUNDS)
    assert ground.heights(np.array([PLACE[0]]), np.array([PLACE[1]]))[0] == pytest.approx(2500 * metres, 1e-8)


@pytest.mark.parametrize("units", ["cm", "-"])
def test_heights_in_another_unit_are_refused(tmp_path: Path, units: str) -> None:
    path = geotiff(tmp_path / "e.tif", plane(), units=units)
    with pytest.raises(GroundError) as caught:
        Ground.read([path], BOUNDS)
    assert str(caught.value).startswith(f"terrain {path}: its heights are in '{units}'; give a raster in met")


def test_what_is_no_ground_is_refused_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    junk = tmp_path / "junk.tif"
    junk.write_bytes(b"II*\0junk" * 40)
    nowhere = geotiff(tmp_path / "f.tif", plane(), crs=None)
    site = geotiff(tmp_path / "s.tif", plane(), crs='LOCAL_CS["building site",UNIT["metre",1]]')
    away = geotiff(tmp_path / "g.tif", plane(), transform=from_origin(10.0, 50.0, 1e-4, 1e-4))
    good = geotiff(tmp_path / "h.tif", plane())
    for paths, told in [
        ([str(junk)], "cannot be read as a raster of heights"),
        ([str(tmp_path / "none.tif")], "cannot be read as a raster of heights"),
        ([nowhere], "it has no coordinate system"),
        ([site], "cannot be read as a raster of heights"),
        ([away], "no pixel lies within"),
    ]:
        with pytest.raises(GroundError, match=told) as caught:
            Ground.read(paths, BOUNDS)
        assert "\n" not in str(caught.value)
    monkeypatch.setattr(module, "_MAX_PIXELS", 100)
    with pytest.raises(GroundError, match="at most 100 are read"):
        Ground.read([good], BOUNDS)
