"""``wbf-mission farm generate``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from geo.texts import duration
from wbf_mission.cli import options
from wbf_mission.cli.command import Command
from wbf_mission.cli.options import option
from wbf_mission.cli.output import Output
from wbf_mission.exit_codes import ExitCode
from wbf_mission.scenario import ScenarioError

EXAMPLES = """
Examples
wbf-mission farm generate --farm miniberry-30 --count 50 --jobs 2 --out environments/miniberry
wbf-mission farm generate --farm waterberry --keep 6 --count 8 --jobs 2 --out environments/day-6
"""


@options.scenario_options("farm", without=options.OF_DAYS)
@options.speaks()
def generate_command(
    given: options.Given,
    output: Output,
    count: Annotated[
        int, option("Number of environments.", parser=options.whole_number_in(1, 100_000), min=1, max=100_000)
    ] = 1,
    days: Annotated[
        int | None,
        option(
            "Days after the first day, 0 to 126.  [default: 15, or the last day of --keep]",
            parser=options.whole_number_in(0, 126),
        ),
    ] = None,
    keep: Annotated[str | None, option("Days to keep, such as 6 or 1-15 or 0,6,15.  [default: all]")] = None,
    jobs: options.Jobs = 1,
    out: Annotated[Path | None, option("Folder.  [default: environments/NAME_OF_FARM]")] = None,
) -> int:
    """Generate environments of a farm: diseases and soil on each day, as Zarr stores.

    Ctrl-C keeps the finished environments; repeat the command to generate the missing environments.
    """
    import time

    from joblib import cpu_count

    from wbf_mission.addons.ensembles.ensemble import generate_ensemble
    from wbf_mission.bench.spec import seed_ranges

    options.require_processes(jobs)
    scenario = given.scenario()
    shown = scenario.farm.load()
    output.notes(shown.notes, "farm")
    kept = None if keep is None else _days(keep)
    if kept is not None and days is not None and max(kept) > days:
        msg = f"--keep {keep} has days after --days {days}: leave --days out, or keep days up to {days}"
        raise ScenarioError(msg)
    last = days if days is not None else 15 if kept is None else max(kept)
    folder = out or Path("environments") / shown.name.lower()
    begin = time.perf_counter()
    try:
        with output.progress() as progress:
            ensemble = generate_ensemble(
                shown.grid(),
                folder,
                members=count,
                seed=scenario.seed,
                days=last if kept is None else max(kept),
                keep_days=kept,
                farm_name=shown.name,
                jobs=cpu_count() if jobs < 0 else jobs,
                progress=lambda done, total: progress("environments", done, total),
            )
    except KeyboardInterrupt:
        output.warn(f"stopped; finished environments in {folder} are kept; repeat the command for the others")
        return ExitCode.INTERRUPTED
    seconds = time.perf_counter() - begin
    size = sum(path.stat().st_size for path in ensemble.folder.rglob("*") if path.is_file())
    made, found, days_kept = len(ensemble.made), len(ensemble.found), ensemble.header.days
    values = {
        "folder": str(folder),
        "farm": shown.name,
        "members": len(ensemble),
        "generated": made,
        "found": found,
        "days": list(days_kept),
        "bytes": size,
        "wall_time_s": seconds,
    }
    rows = {
        "folder": str(folder),
        "environments": f"{count}: {made} generated now, {found} existed already",
        "days": seed_ranges(days_kept).replace("..", "-").replace(",", ", "),
        "size": f"{size / 1e6:.1f} MB",
        "wall time": duration(seconds),
    }
    output.result(values, rows, title=f"{shown.name}: environments")
    return ExitCode.GOOD


def _days(text: str) -> list[int]:
    """Parse a list of days, such as ``0,6,10-15``.

    >>> _days("0,4-6")
    [0, 4, 5, 6]
    """
    days: set[int] = set()
    for part in text.split(","):
        first, dash, last = (word.strip() for word in part.partition("-"))
        numbers = (first, last if dash else first)
        good = all(number.isascii() and number.isdecimal() and len(number) <= 3 for number in numbers)
        if not good or int(numbers[0]) > int(numbers[1]) or int(numbers[1]) > 126:
            msg = f"--keep {text!r} is not a list of days in 0..126: give for example 6, 1-15 or 0,6,15"
            raise ScenarioError(msg)
        days.update(range(int(numbers[0]), int(numbers[1]) + 1))
    return sorted(days)


GENERATE = Command(generate_command, EXAMPLES)
