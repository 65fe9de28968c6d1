"""``wbf-mission studio``."""

from __future__ import annotations

import contextlib
import threading
from functools import partial
from pathlib import Path
from typing import Annotated

from wbf_mission.cli import options
from wbf_mission.cli.command import Command
from wbf_mission.cli.options import option
from wbf_mission.cli.output import Output

EXAMPLES = """
Examples
wbf-mission studio
wbf-mission studio --farm my-farm.geojson --vehicle mapping-quad --open
wbf-mission studio --farm miniberry-100 --planner lawnmower --budget 10min --port 8080
"""
BEGINNERS = (
    *("--farm", "--planner", "--policy", "--budget", "--vehicle", "--autopilot"),
    *("--altitude", "--camera", "--wind", "--seed", "--port", "--open"),
)
_PAGE = "The page"
_USUAL_PORT = 8735


@options.scenario_options(
    *("farm", "mission", "vehicle", "weather", "camera", "estimate"),
    without=("mission", "terrain", "days", "flights_per_day", "world"),
    defaults={"farm": "miniberry-100"},
)
@options.speaks()
def studio_command(
    given: options.Given,
    output: Output,
    *,
    port: Annotated[
        int | None,
        option(
            f"Port of the page; 0 takes any free port. Browsers keep drafts for each port. [default: "
            f"{_USUAL_PORT}, or any free port if {_USUAL_PORT} is taken]",
            panel=_PAGE,
            parser=options.whole_number_in(0, 65_535),
        ),
    ] = None,
    open_page: Annotated[
        bool, option("Open the page in the browser.", "--open/--no-open", panel=_PAGE)
    ] = False,
    tiles: Annotated[
        Path | None,
        option("Raster tiles behind the farm: an MBTiles or PMTiles file of your own.", panel=_PAGE),
    ] = None,
) -> None:
    """Plan in the browser: draw a farm, choose options, see the path at once; save, upload, fly and watch.

    The page is served to this machine only, until Ctrl-C. Options of the scenario set the first draft.
    """
    import webbrowser

    from mission.errors import LinkError
    from wbf_mission.addons.web.server import LiveServer
    from wbf_mission.addons.web.studio import Studio
    from wbf_mission.addons.web.view import View

    start = given.scenario()
    start.farm.load()  # Raises an error for an unreadable farm
    studio = Studio(start)
    serve = partial(LiveServer, View(), tiles=tiles, routes=studio.routes(), home="studio")
    with contextlib.ExitStack() as ends:
        ends.enter_context(contextlib.suppress(KeyboardInterrupt))
        try:
            server = ends.enter_context(serve(port=_USUAL_PORT if port is None else port))
        except LinkError:
            if port is not None:
                raise
            server = ends.enter_context(serve(port=0))
        ends.callback(studio.close)
        studio.begin(server)
        output.result({"url": server.url}, {"page": server.url, "end": "Ctrl-C"}, title="Studio")
        if open_page:
            webbrowser.open(server.url)
        threading.Event().wait()


COMMAND = Command(studio_command, EXAMPLES, BEGINNERS)
