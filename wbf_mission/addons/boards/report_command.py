"""``wbf-mission bench report``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wbf_mission.addons.base.pages import bench_page
from wbf_mission.cli import options
from wbf_mission.cli.command import Command
from wbf_mission.cli.options import option
from wbf_mission.cli.output import Output
from wbf_mission.exit_codes import ExitCode

EXAMPLES = """
Examples
wbf-mission bench report results
wbf-mission bench report results --out report
"""


@options.speaks(quiet=False)
def report_command(
    output: Output,
    folder: Annotated[Path, typer.Argument(help="Folder of the results.")],
    out: Annotated[
        Path | None,
        option("Write a report into this folder: report.md, report.html and a picture for each scenario."),
    ] = None,
) -> int:
    """Print the standings of the results in a folder, also during a benchmark, or write a report."""
    from wbf_mission.addons.boards.printed import print_standings
    from wbf_mission.addons.boards.report import report_page
    from wbf_mission.bench.requests import read_asked
    from wbf_mission.bench.rows import read_rows
    from wbf_mission.results.storage import ResultError

    rows = read_rows(folder)
    if not rows:
        msg = f"{folder}: holds no results of a benchmark; give the folder of 'bench run --out'"
        raise ResultError(msg)
    if out is not None:
        write_page = bench_page()
        page = report_page(rows, out, title=f"Benchmark of {len(rows)} runs", asked=read_asked(folder))
        page.write(out / "report.md")
        write_page(out / "report.html", page, out, rows)
        pictures = [picture.file for section in page.sections for picture in section.pictures]
        files = ["report.md", "report.html", *pictures]
        output.note(f"written: {', '.join(str(out / file) for file in files)}")
    print_standings(output, rows, title=f"{folder}: {len(rows)} runs")
    return ExitCode.GOOD


COMMAND = Command(report_command, EXAMPLES)
