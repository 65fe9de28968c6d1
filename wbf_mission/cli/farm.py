"""``wbf-mission farm``: list, show, draw."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wbf_mission.cli import options
from wbf_mission.cli.output import Output, distance

app = typer.Typer(
    no_args_is_help=True, help="Look at farms: list them, show one, draw one, save one as GeoJSON."
)

FarmArgument = Annotated[
    str, typer.Argument(help="Name of a farm or a GeoJSON file.", autocompletion=options._complete("farm"))
]


@app.command("list")
def list_command(json: options.Json = False, quiet: options.Quiet = False) -> None:
    """List the farms that are known by name."""
    from geo import farm_names, get_farm

    farms = [get_farm(name) for name in farm_names()]
    values = [
        {
            "name": farm.name,
            "width_cells": farm.width_cells,
            "height_cells": farm.height_cells,
            "owner_cells": farm.owner_cells,
            "latitude_deg": farm.frame.latitude_deg,
            "longitude_deg": farm.frame.longitude_deg,
        }
        for farm in farms
    ]
    rows = [
        [
            farm.name,
            f"{farm.width_cells} x {farm.height_cells}",
            f"{farm.width_cells * farm.cell_size_m:.1f} x {farm.height_cells * farm.cell_size_m:.1f}",
            str(farm.owner_cells),
        ]
        for farm in farms
    ]
    Output(as_json=json, quiet=quiet).table(values, ["farm", "cells", "metres", "owner's cells"], rows)


@app.command("show", epilog="[bold]Example[/bold]\n\nwbf-mission farm show waterberry")
def show_command(farm: FarmArgument, json: options.Json = False, quiet: options.Quiet = False) -> None:
    """Show a farm's size, place, patches and crops."""
    import numpy as np

    from geo import Crop, get_farm

    place = get_farm(farm)
    grid = place.grid()
    counts = {
        crop.name.lower(): {
            "cells": int(np.count_nonzero(grid.crop == crop)),
            "owner_cells": int(np.count_nonzero((grid.crop == crop) & grid.owned)),
        }
        for crop in Crop
    }
    area = place.owner_area
    values = {
        "name": place.name,
        "width_cells": place.width_cells,
        "height_cells": place.height_cells,
        "cell_size_m": place.cell_size_m,
        "latitude_deg": place.frame.latitude_deg,
        "longitude_deg": place.frame.longitude_deg,
        "altitude_m": place.frame.altitude_m,
        "rotation_deg": place.frame.rotation_deg,
        "owner": place.owner,
        "owner_cells": place.owner_cells,
        "owner_area_m2": float(area.area),
        "home_m": list(place.home_m),
        "crops": counts,
        "patches": [
            {
                "name": patch.name,
                "crop": patch.crop.name.lower(),
                "owner": patch.owner,
                "area_m2": patch.polygon.area,
            }
            for patch in place.patches
        ],
    }
    rows = {
        "size": f"{place.width_cells} x {place.height_cells} cells of {place.cell_size_m:g} m",
        "origin": f"{place.frame.latitude_deg:.6f}, {place.frame.longitude_deg:.6f}, "
        f"{place.frame.altitude_m:g} m AMSL",
        "rotation": f"{place.frame.rotation_deg:g} degrees anticlockwise from east",
        "owner": f"{place.owner}: {place.owner_cells} cells, {area.area / 10_000:.2f} ha",
        "home": f"{distance(place.home_m[0])} east, {distance(place.home_m[1])} north of the origin",
        **{
            f"crop: {name}": f"{count['cells']} cells, {count['owner_cells']} of them the owner's"
            for name, count in counts.items()
            if count["cells"]
        },
        **{
            f"patch {i}": f"{patch.name} ({patch.crop.name.lower()}, {patch.owner})"
            for i, patch in enumerate(place.patches, 1)
        },
    }
    Output(as_json=json, quiet=quiet).result(values, rows, title=place.name)


@app.command("draw", epilog="[bold]Example[/bold]\n\nwbf-mission farm draw waterberry --out waterberry.png")
def draw_command(
    farm: FarmArgument,
    out: Annotated[
        Path | None, typer.Option(help="PNG file.  [default: FARM.png]", show_default=False)
    ] = None,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Draw a farm's crops and the owner's land as a PNG picture."""
    from geo import get_farm
    from wbf_mission.plots import plot_farm

    place = get_farm(farm)
    target = plot_farm(place, _with_suffix(out or Path(f"{place.name.lower()}.png"), ".png"))
    Output(as_json=json, quiet=quiet).result({"file": str(target)}, title="Drawn")


@app.command(
    "save", epilog="[bold]Example[/bold]\n\nwbf-mission farm save miniberry-30 --out my-farm.geojson"
)
def save_command(
    farm: FarmArgument,
    out: Annotated[Path, typer.Option(help="GeoJSON file.")],
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Save a farm as GeoJSON, a start for a farm file of your own."""
    from geo import get_farm, save_farm

    save_farm(get_farm(farm), _with_suffix(out, ".geojson", ".json"))
    Output(as_json=json, quiet=quiet).result({"file": str(out)}, title="Saved")


def _with_suffix(path: Path, *suffixes: str) -> Path:
    from geo import FarmError

    if path.suffix.lower() not in suffixes:
        msg = f"{path}: the file's name has to end in {' or '.join(suffixes)}"
        raise FarmError(msg)
    return path
