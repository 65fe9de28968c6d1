"""The files of a treatment map, opened by GDAL and by a browser."""

import re
import zipfile
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pyogrio
import pytest
import rasterio
import shapely
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Transformer
from sweeps import sweep

from geo import Crop, Farm, LocalFrame, Patch, get_farm
from sensors.dynamics.continuous import Measured
from sensors.fields import ALL_CROPS, PAPER_FIELDS, Field, FieldSet
from sensors.observations import Observations
from sensors.scoring.information import InformationModel
from wbf_mission.addons.treatment.gis import MapError, UtmCells
from wbf_mission.addons.treatment.map_files import NODATA, write_geotiff, write_map
from wbf_mission.addons.treatment.treatment_map import HEALTHY, LOOK, TREAT, TreatmentMap, costs_of, zones_of
from wbf_mission.progress import silent

WIDTH, HEIGHT, CELL_M = 700, 540, 0.5


def farm_at(
    latitude, longitude, rotation_deg, *, name="Nia's <farm> & co", cells=(WIDTH, HEIGHT), cell_m=CELL_M
):
    """Tomatoes on a slanted piece of land, with strawberries beside it that are another's."""
    w, h = cells[0] * cell_m, cells[1] * cell_m
    land = shapely.Polygon([(0.0, 0.0), (0.8 * w, 0.1 * h), (0.9 * w, h), (0.1 * w, 0.9 * h)])
    frame = LocalFrame(latitude, longitude, 200.0, rotation_deg)
    patches = (
        Patch("neighbour", Crop.STRAWBERRY, "other", shapely.box(0.0, 0.0, w, h)),
        Patch("mine", Crop.TOMATO, "owner", land),
    )
    return Farm(name, frame, *cells, patches, "owner", (0.0, 0.0), cell_m)


def estimate(shape):
    """Sick about two places, and less sure of the right side."""
    x, y = np.meshgrid(*(np.linspace(0.0, 1.0, n, dtype=np.float32) for n in shape), indexing="ij")
    ill = np.exp(-((x - 0.3) ** 2 + (y - 0.4) ** 2) / 0.004) + np.exp(
        -((x - 0.6) ** 2 + (y - 0.7) ** 2) / 0.01
    )
    value = np.stack([1.0 - 0.5 * ill.clip(0.0, 1.0), np.ones(shape), 0.2 + 0.4 * x + 0.001 * y])
    doubt = np.stack([0.01 + 0.2 * (x > 0.65), np.ones(shape), 0.02 + 0.0 * x])
    return InformationModel(value.astype(np.float32), doubt.astype(np.float32))


def treatment_of(farm, **how):
    seen = Observations([100, 300], [100, 300], [0.0, 1.0], [6, 6], [[1, np.nan, 0.4], [0.5, np.nan, 0.5]])
    made = TreatmentMap(
        farm, PAPER_FIELDS, estimate(farm.grid().shape), seen, 6, "gp", True, costs_of(PAPER_FIELDS, {}), 5.0
    )
    return replace(made, source="flight.tlog", notes=("3 of 9 readings lie <outside>",), **how)


FARMS = {
    "south, turned": (farm_at(-33.5, 150.31, 25.0), 32756),
    "north": (farm_at(28.05, -82.15, 0.0), 32617),
    "near the date line, upside down": (farm_at(52.0, 179.98, -160.0), 32660),
}


@pytest.fixture(scope="module", params=["south, turned", "near the date line, upside down"])
def written(request, tmp_path_factory):
    farm, epsg = FARMS[request.param]
    of, folder = treatment_of(farm), tmp_path_factory.mktemp("map")
    files = write_map(of, folder, silent)
    assert sorted(folder.iterdir()) == sorted(files)
    return of, folder, epsg


def test_gdal_opens_cloud_optimised_rasters(written):
    of, folder, epsg = written
    assert sorted(path.name for path in folder.glob("*.tif")) == ["map_soil.tif", "map_tylcv.tif"]
    with rasterio.open(folder / "map_tylcv.tif") as file:
        assert file.crs.to_epsg() == epsg
        assert file.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
        assert file.overviews(1) == file.overviews(2) == [2]
        assert file.block_shapes == [(512, 512)] * 2
        assert file.dtypes == ("float32", "float32")
        assert file.nodatavals == (NODATA, NODATA)
        assert file.descriptions == (
            "TYLCV (tomato): value",
            "TYLCV (tomato): uncertainty (standard deviation)",
        )
        assert file.units == ("health", "health")
        assert (file.tags()["farm"], file.tags()["day"]) == (of.farm.name, "6")
        assert not file.tags().get("TIFFTAG_DATETIME")


def test_the_value_at_a_place_is_the_estimates(written):
    of, folder, epsg = written
    rng = np.random.default_rng(1)
    x, y = rng.integers(0, WIDTH, 400), rng.integers(0, HEIGHT, 400)
    # Anywhere in the cell but at its very edge.
    inside = rng.uniform(0.05, 0.95, (2, 400))
    latitude, longitude = of.farm.frame.to_wgs84((x + inside[0]) * CELL_M, (y + inside[1]) * CELL_M)
    east, north = Transformer.from_crs(4326, epsg, always_xy=True).transform(longitude, latitude)
    for k, name in ((0, "tylcv"), (2, "soil")):
        with rasterio.open(folder / f"map_{name}.tif") as file:
            found = np.array(list(file.sample(np.column_stack((east, north)))))
        mine = PAPER_FIELDS[name].mask(of.farm.grid())[x, y]
        assert 100 < mine.sum() < 400
        for band, array in enumerate((of.model.value[k], of.model.uncertainty[k])):
            assert found[:, band].tolist() == np.where(mine, array[x, y], np.float32(NODATA)).tolist()


def read(path, **how):
    meta, _, geometry, columns = pyogrio.raw.read(path, **how)
    return meta, shapely.from_wkb(geometry), dict(zip(meta["fields"], columns, strict=True))


@pytest.mark.parametrize("name", ["zones.geojson", "zones.gpkg"])
def test_gdal_opens_zones_that_are_where_they_were_decided(name, written):
    of, folder, _ = written
    meta, shapes, columns = read(folder / name)
    assert meta["crs"] == "EPSG:4326"
    assert set(meta["fields"]) == {"field", "zone", "area_ha", "need", "gain", "rate", "rate_unit"}
    assert shapely.is_valid(shapes).all()
    for one in of.zone_maps:
        mine = columns["field"] == one.field.name
        x, y = np.nonzero(one.zone)
        middles = (x + 0.5) * one.block_m, (y + 0.5) * one.block_m
        points = shapely.points(*middles)
        kept = shapely.contains(shapely.buffer(of.farm.owner_area, -0.1), points)
        latitude, longitude = of.farm.frame.to_wgs84(*(m[kept] for m in middles))
        tree = shapely.STRtree(shapes[mine])
        point, polygon = tree.query(shapely.points(longitude, latitude), predicate="within")
        assert np.bincount(point).tolist() == [1] * int(kept.sum())  # in one zone each
        words = columns["zone"][mine][polygon]
        assert words.tolist() == [one.word(zone) for zone in one.zone[x, y][kept][point].tolist()]
        assert set(one.zone.ravel().tolist()) >= {HEALTHY, LOOK, TREAT}


@sweep(few=10, many=60)
@given(st.integers(0, 2**32 - 1), st.floats(0.2, 0.8))
def test_any_pattern_of_blocks_becomes_valid_polygons(seed, share):
    farm = farm_at(0.0, 20.0, 7.0, cells=(60, 44))
    of = treatment_of(farm, observations=Observations.empty(), block_m=1.0)
    one, rng = of.zone_maps[0], np.random.default_rng(seed)
    drawn = rng.choice([HEALTHY, LOOK, TREAT], one.zone.shape, p=[share, (1 - share) / 2, (1 - share) / 2])
    found = zones_of(farm, replace(one, zone=np.where(one.zone > 0, drawn, 0).astype(np.uint8)))
    polygons = np.array([zone.polygon for zone in found])
    assert shapely.is_valid(polygons).all()
    # No two of them share land.
    assert shapely.area(shapely.union_all(polygons)) == pytest.approx(shapely.area(polygons).sum())
    assert {zone.polygon.geom_type for zone in found} == {"Polygon"}
    assert all(0.0 <= zone.need <= 1.0 and zone.gain >= 0.0 for zone in found)


def test_an_owner_who_grows_nothing_of_it_gets_no_map():
    of = treatment_of(FARMS["north"][0])
    fields = FieldSet((PAPER_FIELDS["ccr"],))
    values = np.ones((1, WIDTH, HEIGHT), np.float32)
    none = replace(of, fields=fields, model=InformationModel(values, values, fields=("ccr",)),
                   observations=Observations.empty(("ccr",)))  # fmt: skip
    with pytest.raises(MapError, match="its owner grows no strawberry; give other --fields"):
        none.summary()


def test_a_prescription_is_a_zipped_shapefile_with_rates(written):
    of, folder, _ = written
    path = folder / "prescription_tylcv.zip"
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        suffixes = ("cpg", "dbf", "prj", "shp", "shx")
        assert archive.namelist() == [f"prescription_tylcv.{suffix}" for suffix in suffixes]
        assert archive.read("prescription_tylcv.cpg") == b"UTF-8"
        assert b"GCS_WGS_1984" in archive.read("prescription_tylcv.prj")
    meta, shapes, columns = read(f"/vsizip/{path}")
    assert meta["crs"] == "EPSG:4326"
    assert list(columns) == ["RATE", "UNIT", "ZONE", "AREA_HA"]
    assert set(zip(columns["ZONE"], columns["RATE"], columns["UNIT"], strict=True)) == {
        ("treat", 200.0, "L/ha"),
        ("look again", 0.0, "L/ha"),
        ("healthy", 0.0, "L/ha"),
    }
    told = of.summary()["fields"]["tylcv"]
    assert columns["AREA_HA"][columns["RATE"] > 0].sum() == pytest.approx(told["prescribed_ha"], abs=1e-5)
    assert shapely.is_valid(shapes).all()


class _Page(HTMLParser):
    def __init__(self):
        super().__init__()
        self.tags, self.links, self.text = [], [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.links += [value for name, value in attrs if name in ("href", "src")]

    def handle_data(self, data):
        self.text.append(data)


def test_the_page_needs_nothing_else_and_shows_names_as_they_are(written):
    of, folder, _ = written
    text = (folder / "report.html").read_text(encoding="utf-8")
    page = _Page()
    page.feed(text)
    assert page.links
    assert all(link.startswith("data:image/png;base64,") for link in page.links)
    assert not {"script", "link", "iframe", "farm"} & set(page.tags)
    assert not re.search(r"url\((?!#)|@import", text)
    words = " ".join(page.text)
    assert "Nia's <farm> & co: what to treat" in words
    assert "3 of 9 readings lie <outside>." in words
    told = of.summary()["fields"]["tylcv"]
    assert f"Treat {told['prescribed_ha']:.2f} ha: {200 * told['prescribed_ha']:,.0f} L at 200 L/ha." in words
    for zone in (one for one in of.zones if one.zone == TREAT and one.field == "tylcv"):
        assert f"{zone.latitude_deg:.5f}, {zone.longitude_deg:.5f}" in words
    # North is where the frame's x axis, to the right, is so far anticlockwise from east.
    assert text.count(f'rotate({of.farm.frame.rotation_deg:.2f})"') == 2
    treat = [one for one in of.zones if one.zone == TREAT and one.field == "tylcv"]
    worst_first = sorted(treat, key=lambda one: -one.need * one.area_ha)
    places = [words.index(f"{one.latitude_deg:.5f}, {one.longitude_deg:.5f}") for one in worst_first]
    assert len(places) == 2
    assert places == sorted(places)


def test_an_estimator_without_a_deviation_is_told(tmp_path):
    of = treatment_of(FARMS["north"][0], states_deviation=False)
    write_map(of, tmp_path / "map", silent)
    with rasterio.open(tmp_path / "map" / "map_tylcv.tif") as file:
        assert file.descriptions[1] == "TYLCV (tomato): uncertainty (on the estimator's own scale)"
        assert file.units[1] in ("", None)
    assert "gives no uncertainty" in (tmp_path / "map" / "report.html").read_text()
    assert all(one.zone != LOOK for one in of.zones)


@pytest.mark.parametrize(
    ("farm", "told"),
    [
        (farm_at(85.0, 10.0, 0.0), "latitude 85.0 lies beyond UTM"),
        (
            farm_at(45.0, 8.9, 0.0, cells=(14_000, 14_000), cell_m=10.0),
            "in UTM its cells would be .* m off; choose",
        ),
    ],
)
def test_farms_that_do_not_fit_are_refused(farm, told):
    with pytest.raises(MapError, match=told):
        UtmCells.of(farm)


def test_a_raster_is_in_the_unit_of_its_field(tmp_path):
    ph = Field("ph", Measured(), (ALL_CROPS,), default=0.5, unit="pH", range=(4.0, 9.0))
    farm = get_farm("miniberry-10")
    value, doubt = np.full((1, 10, 10), 0.5, np.float32), np.full((1, 10, 10), 0.02, np.float32)
    value[0, 3, 7] = 0.1
    model = InformationModel(value, doubt, fields=("ph",))
    write_geotiff(tmp_path / "ph.tif", farm, ph, model, deviation=True, day=6)
    with rasterio.open(tmp_path / "ph.tif") as file:
        levels, doubts = file.read()
        assert file.units == ("pH", "pH")
    assert sorted(np.unique(levels)) == pytest.approx([4.5, 6.5]) and doubts == pytest.approx(0.1)
    assert levels[::-1].T[3, 7] == pytest.approx(4.5)
