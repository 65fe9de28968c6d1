"""The worked example, from the border of a field to a treatment map: each command, and what came of it."""

import json
import shlex
import shutil
import time
from pathlib import Path

import numpy as np
import pytest
import rasterio
import shapely

from geo import load_farm
from mission.files import read_mission
from wbf_mission.cli.app import main
from wbf_mission.results.result import load_result

REPOSITORY = Path(__file__).parents[2]
PAGE = REPOSITORY / "docs" / "field-to-map.md"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where the commands of the page have run."""
    path = tmp_path_factory.mktemp("example")
    shutil.copytree(REPOSITORY / "missions", path / "missions")
    lines = [one for one in PAGE.read_text("utf-8").splitlines() if one.startswith("wbf-mission ")]
    assert [shlex.split(one)[1] for one in lines] == [
        "farm",
        "farm",
        "plan",
        "preflight",
        "convert",
        "fly",
        "map",
    ]
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(path)
        begun = time.process_time()
        for line in lines:
            assert main([*shlex.split(line)[1:], "--quiet"]) == 0, line
        print(f"CPU time of the page: {time.process_time() - begun:.0f} s")  # noqa: T201
    return path


@pytest.fixture(scope="module")
def field():
    return load_farm(REPOSITORY / "missions" / "strawberry-field.kml")


@pytest.mark.slow
def test_the_plan_is_for_this_land(folder, field):
    mission = read_mission(folder / "rows.plan")
    assert read_mission(folder / "rows.kml") == mission
    places = np.array([(one.x, one.y) for one in mission.items if one.has_position and one.command == 16])
    way = shapely.LineString(np.column_stack(field.frame.from_wgs84(*places.T)))
    house, mast = (one.polygon for one in field.obstacles)
    assert way.intersects(house) and way.distance(mast) > 5.0
    assert field.scouting(["strawberry"]).scouted_area.area < 0.98 * field.owner_area.area  # without the pond
    assert len(mission.rally) == 1 and len(mission.fence) >= 8


@pytest.mark.slow
def test_what_is_treated_is_sick(folder):
    result = load_result(folder / "flown")
    summary = result.summary()
    assert (
        summary["coverage"] == pytest.approx(summary["predicted_coverage"], abs=0.01)
        and summary["coverage"] > 0.06
    )
    sick = result.truth[result.fields.index("ccr")] < 0.75
    zones = json.loads((folder / "map" / "zones.geojson").read_text("utf-8"))["features"]
    found = {}
    for zone in ("treat", "healthy"):
        shapes = [
            shapely.from_geojson(json.dumps(one["geometry"]))
            for one in zones
            if (one["properties"]["field"], one["properties"]["zone"]) == ("ccr", zone)
        ]
        land = shapely.union_all(shapes)
        x, y = np.nonzero(result.fields["ccr"].mask(result.farm.grid()))
        latitude, longitude = result.farm.frame.to_wgs84(*result.farm.cell_centre(x, y))
        inside = shapely.contains_xy(land, longitude, latitude)
        found[zone] = sick[x[inside], y[inside]].mean()
    assert found["treat"] > 0.1 > 20.0 * found["healthy"]


@pytest.mark.slow
def test_other_programs_find_the_map_and_the_next_flight(folder, field):
    with rasterio.open(folder / "map" / "map_soil.tif") as file:
        value = file.read(1)
        assert file.crs.to_epsg() == 32617 and value.shape == (field.height_cells, field.width_cells)
    for name in ("zones.gpkg", "prescription_ccr.zip", "report.html", "map.json"):
        assert (folder / "map" / name).stat().st_size > 500
    told = json.loads((folder / "map" / "map.json").read_text("utf-8"))["next"]
    assert 0.0 < told["gain"] < told["gain_of_all"]
    assert len(read_mission(folder / "again.plan").items) > 5
