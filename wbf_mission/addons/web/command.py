"""Commands ``report`` and ``studio``."""

from __future__ import annotations

import contextlib
import tempfile
import threading
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from wbf_mission.cli import options
from wbf_mission.cli.command import Command, provided
from wbf_mission.cli.options import TargetError, option, refuse_overwrite
from wbf_mission.cli.output import Output

if TYPE_CHECKING:
    from wbf_mission.progress import Progress

REPORT_EXAMPLES = """
Examples
wbf-mission report runs/mine --open
wbf-mission report runs/mine runs/other --out both.html
wbf-mission report results --out standings.html
"""


@options.speaks()
def report_command(
    output: Output,
    *,
    folder: Annotated[Path, typer.Argument(help="Results of a run, or of a benchmark.")],
    other: Annotated[
        Path | None, typer.Argument(help="Results of another run over the same farm, shown beside it.")
    ] = None,
    out: Annotated[
        Path | None,
        option(
            "The HTML file.  [default: FOLDER.html beside the folder; for two runs FOLDER-OTHER.html]",
            panel=options.OUTPUT_PANEL,
        ),
    ] = None,
    opens: Annotated[bool, option("Open it in the browser.", "--open", panel=options.OUTPUT_PANEL)] = False,
    overwrite: Annotated[
        bool, option("Replace an existing file.", "--overwrite", panel=options.OUTPUT_PANEL)
    ] = False,
) -> None:
    """Show a finished run, two runs side by side, or a benchmark as one self-contained HTML file.

    The file of a run has a summary for the farmer that prints on one sheet, and the page of 'fly --live' with
    a slider that replays the run. The file of a benchmark has standings that can be sorted and filtered.
    """
    from wbf_mission.bench.rows import holds_rows
    from wbf_mission.results.storage import ResultError

    folders = [folder] if other is None else [folder, other]
    is_bench = [holds_rows(each) for each in folders]
    if other is not None and any(is_bench):
        raise ResultError("a benchmark is shown alone: give only its folder, or the results of two runs")
    names = "-".join(each.resolve().name for each in folders)
    path = out or folder.resolve().with_name(f"{names}.html")
    refuse_overwrite(path)
    if path.exists() and not overwrite:
        raise TargetError(f"{path}: is there already; give another name with --out, or --overwrite")
    with output.progress() as progress:
        values = _bench(folder, path) if is_bench[0] else _runs(folders, path, progress)
    for note in values["notes"]:
        output.note(f"note: {note}")
    rows = {"of": values["title"], "report": f"{path}, {values['bytes'] / 1e6:.1f} MB"}
    output.result({"report": str(path), **values}, rows)
    if opens:
        import webbrowser

        if not webbrowser.open(path.resolve().as_uri()):
            output.warn(f"no browser could be started; open {path} in a browser")


def _bench(folder: Path, path: Path) -> dict[str, Any]:
    """Write the page of a benchmark; return the page's properties, which the command prints."""
    from wbf_mission.addons.web.bench_page import write_bench_page
    from wbf_mission.bench.requests import read_asked
    from wbf_mission.bench.rows import read_rows

    rows = read_rows(folder)
    with tempfile.TemporaryDirectory() as pictures:
        page = provided("bench.report")(
            rows, Path(pictures), title=f"Benchmark of {len(rows)} runs", asked=read_asked(folder)
        )
        write_bench_page(path, page, Path(pictures), rows)
    return {"title": page.title, "bytes": path.stat().st_size, "runs": len(rows), "notes": []}


def _runs(folders: list[Path], path: Path, progress: Progress) -> dict[str, Any]:
    """Write the page of one or two runs; return the page's properties, which the command prints."""
    from wbf_mission.addons.web.report import write_report
    from wbf_mission.results.result import load_result

    results = []
    for number, folder in enumerate(folders):
        progress("reading", number, len(folders))
        results.append(load_result(folder, probabilities=False, lazy=True))
    progress("reading", len(folders), len(folders))
    logs = [log if (log := folder / "flight.tlog").is_file() else None for folder in folders]
    report = write_report(path, results, logs=logs, progress=progress)
    values = {"title": report.title, "bytes": report.size, "moments": list(report.moments)}
    return {**values, "notes": list(report.notes)}


REPORT = Command(report_command, REPORT_EXAMPLES)


STUDIO_EXAMPLES = """
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
            f"Port of the page; 0 takes any free port. A browser keeps drafts for each port. [default: "
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


STUDIO = Command(studio_command, STUDIO_EXAMPLES, BEGINNERS)
