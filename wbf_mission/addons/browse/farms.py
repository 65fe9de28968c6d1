"""Commands ``wbf-mission farm list``, ``show``, ``draw`` and ``save``."""

from __future__ import annotations

from dataclasses import replace
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from geo.texts import distance, file_stem
from wbf_mission.cli import options
from wbf_mission.cli.command import Command
from wbf_mission.cli.options import Overwrite, option, refuse_overwrite
from wbf_mission.cli.output import Output
from wbf_mission.scenario import FarmOptions
from wbf_mission.scenario.option import options_of

if TYPE_CHECKING:
    from geo.farm import Farm

FarmArgument = Annotated[
    str,
    typer.Argument(
        help=f"{options_of(FarmOptions)['name'].help}.",
        autocompletion=options.complete("farm"),
    ),
]


_READS_FARM = options.scenario_options(
    "farm", without=(*options.OF_DAYS, "farm", "fields", "seed", "scenario")
)
"""Decorator that adds the options for reading a farm file to a command whose argument is a farm."""


def _load(given: options.Given, name: str, output: Output) -> Farm:
    """Return the farm, and print the notes that were made when it was read."""
    farm = replace(given.scenario().farm, name=name).load()
    output.notes(farm.notes)
    return farm


@options.speaks()
def list_command(output: Output) -> None:
    """List the farms that are known by name."""
    from geo import farm_names, get_farm

    farms = [get_farm(name) for name in farm_names()]
    rows = [
        [
            farm.name,
            f"{farm.width_cells} x {farm.height_cells}",
            f"{farm.width_cells * farm.cell_size_m:.1f} x {farm.height_cells * farm.cell_size_m:.1f}",
            str(farm.owner_cells),
        ]
        for farm in farms
    ]
    values = [_values(farm, "name", *_CELLS, "owner_cells", *_PLACE) for farm in farms]
    output.table(values, ["farm", "cells", "metres", "owner's cells"], rows)


_CELLS = ("width_cells", "height_cells")
_PLACE = ("frame.latitude_deg", "frame.longitude_deg")


def _values(farm: Any, *names: str) -> dict[str, Any]:
    """Return attributes of a farm, keyed by the last part of their dotted names."""
    return {name.rpartition(".")[2]: attrgetter(name)(farm) for name in names}


@_READS_FARM
@options.speaks()
def show_command(given: options.Given, output: Output, *, farm: FarmArgument) -> None:
    """Show a farm's size, position, patches, crops and obstacles."""
    import numpy as np
    import shapely

    shown = _load(given, farm, output)
    grid = shown.grid()
    counts = {
        crop: {
            "cells": int(np.count_nonzero(grid.crop == number)),
            "owner_cells": int(np.count_nonzero((grid.crop == number) & grid.owned)),
        }
        for number, crop in enumerate(grid.crops)
    }
    area, home = shown.owner_area, shapely.Point(shown.home_m)
    values = {
        **_values(shown, "name", *_CELLS, "cell_size_m", *_PLACE),
        **_values(shown, "frame.altitude_m", "frame.rotation_deg", "owner", "owner_cells"),
        "owner_area_m2": float(area.area),
        "home_m": list(shown.home_m),
        "crops": counts,
        "patches": [
            {"name": patch.name, "crop": str(patch.crop), "owner": patch.owner, "area_m2": patch.polygon.area}
            for patch in shown.patches
        ],
        "obstacles": [
            {
                **_values(obstacle, "name", "height_m", "margin_m"),
                "bounds_m": list(obstacle.polygon.bounds),
                "area_m2": obstacle.polygon.area,
                "from_home_m": obstacle.polygon.distance(home),
            }
            for obstacle in shown.obstacles
        ],
        "rally_m": [list(place) for place in shown.rally_m],
        "notes": list(shown.notes),
    }
    rows = {
        "size": f"{shown.width_cells} x {shown.height_cells} cells of {shown.cell_size_m:g} m",
        "origin": f"{shown.frame.latitude_deg:.6f}, {shown.frame.longitude_deg:.6f}, "
        f"{shown.frame.altitude_m:g} m AMSL",
        "rotation": f"{shown.frame.rotation_deg:g} degrees anticlockwise from east",
        "owner": f"{shown.owner}: {shown.owner_cells} cells, {area.area / 10_000:.2f} ha",
        "home": f"{distance(shown.home_m[0])} east, {distance(shown.home_m[1])} north of the origin",
        **{
            f"crop: {name}": f"{count['cells']} cells, {count['owner_cells']} of them the owner's"
            for name, count in counts.items()
            if count["cells"]
        },
        **{f"patch {i}": f"{p.name} ({p.crop}, {p.owner})" for i, p in enumerate(shown.patches, 1)},
        **{
            f"obstacle {i}": f"{obstacle.name + ': ' if obstacle.name else ''}x {x0:.1f} to {x1:.1f} m, "
            f"y {y0:.1f} to {y1:.1f} m; {obstacle.polygon.area:.1f} m2, "
            f"{'not to be flown over' if obstacle.height_m is None else f'{obstacle.height_m:g} m high'}, "
            f"{distance(obstacle.polygon.distance(home))} from home"
            for i, obstacle in enumerate(shown.obstacles, 1)
            for x0, y0, x1, y1 in [obstacle.polygon.bounds]
        },
        **{
            f"rally point {i}": f"{distance(x)} east, {distance(y)} north of the origin"
            for i, (x, y) in enumerate(shown.rally_m, 1)
        },
    }
    output.result(values, rows, title=shown.name)


@_READS_FARM
@options.speaks()
def draw_command(
    given: options.Given,
    output: Output,
    *,
    farm: FarmArgument,
    out: Annotated[Path | None, option("PNG file.  [default: FARM.png]")] = None,
) -> None:
    """Draw a farm's crops, the owner's border, obstacles and home as a PNG picture."""
    from wbf_mission.results.products import PICTURES, product

    made: Any = product(PICTURES)
    shown = _load(given, farm, output)
    target = out or Path(f"{file_stem(shown.name.lower(), 'farm')}.png")
    refuse_overwrite(target, [farm])
    _require_suffix(target, ".png")
    made.plot_farm(shown, target)
    output.result({"file": str(target)}, title="Drawn")


@_READS_FARM
@options.speaks()
def save_command(
    given: options.Given,
    output: Output,
    *,
    farm: FarmArgument,
    out: Annotated[Path, option("GeoJSON file.")],
    overwrite: Overwrite = False,
) -> None:
    """Save a farm as GeoJSON: convert or repair a file of another program, or start your own farm file."""
    from geo import save_farm
    from geo.geojson import farm_document
    from wbf_mission.addons.base.antimeridian import cut

    refuse_overwrite(out, [farm], suffixes=(".geojson",), overwrite=overwrite)
    _require_suffix(out, ".geojson", ".json")
    shown = _load(given, farm, output)
    document = farm_document(shown)
    for feature in document["features"]:
        feature["geometry"] = cut(feature["geometry"])
    save_farm(shown, out, document)
    output.result({"file": str(out)}, title="Saved")


def _require_suffix(path: Path, *suffixes: str) -> None:
    from geo import FarmError

    if path.suffix.lower() not in suffixes:
        msg = f"{path}: the file name must end in {' or '.join(suffixes)}"
        raise FarmError(msg)


LIST = Command(list_command, "")
SHOW = Command(show_command, "Example\nwbf-mission farm show waterberry")
DRAW = Command(draw_command, "Example\nwbf-mission farm draw waterberry --out waterberry.png")
SAVE = Command(save_command, "Example\nwbf-mission farm save miniberry-30 --out my-farm.geojson")
