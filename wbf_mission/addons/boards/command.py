"""Commands ``submit``, ``board``, ``verify`` and ``seal``, for results that others can check.

All four are commands of the group ``bench``.
"""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from geo.texts import file_stem
from wbf_mission.addons.boards.standings_command import print_table, rows_in
from wbf_mission.cli import options
from wbf_mission.cli.command import Command, provided
from wbf_mission.cli.options import option
from wbf_mission.cli.output import Output
from wbf_mission.exit_codes import ExitCode

if TYPE_CHECKING:
    from collections.abc import Sequence

    from wbf_mission.addons.boards.board import Board
    from wbf_mission.addons.boards.sealed import Secret
    from wbf_mission.addons.boards.verification import Verification
    from wbf_mission.bench.rows import BenchRow
    from wbf_mission.scenario import Choice

SUBMIT_EXAMPLES = """
Examples
wbf-mission bench submit results --name "My policy" --by "A. Grower, Example Farm"
wbf-mission bench submit results --name UCB --by "A. Grower" --code my_policy.py --verify 10 --out ucb.zip
"""
BOARD_EXAMPLES = """
Examples
wbf-mission bench board results
wbf-mission bench board results ucb.zip --out board
wbf-mission bench board baselines *.zip --seal round.seal.json --secret round.secret --out board
"""
VERIFY_EXAMPLES = """
Examples
wbf-mission bench verify ucb.zip
wbf-mission bench verify ucb.zip --environments 100 --json
"""
SEAL_EXAMPLES = """
Examples
wbf-mission bench seal --environments 40 --out round
wbf-mission bench run --sealed round.secret --scenarios WBF/Miniberry-30-v1 --out held-out
"""
_CHECKED = "What is checked"
_SHOWN = 5

_VERIFY = "Number of rows of each method to fly again and compare; 0 flies none."
_rows = options.whole_number_in(0, 10_000_000)
SealFile = Annotated[Path | None, option("Seal file of a finished round; requires --secret.", panel=_CHECKED)]
SecretFile = Annotated[
    Path | None, option("Secret file of this round; the secret identifies the environments.", panel=_CHECKED)
]


def _secret(seal: Path | None, secret: Path | None) -> Secret | None:
    from wbf_mission.addons.boards.sealed import opened
    from wbf_mission.scenario import ScenarioError

    if (seal is None) != (secret is None):
        raise ScenarioError("--seal and --secret belong together: give both files of the round, or neither")
    return None if seal is None or secret is None else opened(seal, secret)


@options.speaks()
def submit_command(
    output: Output,
    folder: Annotated[Path, typer.Argument(help="Folder of the results.")],
    *,
    name: Annotated[str, option("Title of the submission on boards.")],
    by: Annotated[str, option("Author of the submission.")],
    about: Annotated[str, option("Short description.")] = "",
    code: Annotated[
        list[Path] | None, option("File or folder of your own code to pack; may be repeated.")
    ] = None,
    out: Annotated[Path | None, option("Pack file.  [default: NAME.zip in lower case]")] = None,
    verify: Annotated[int, option(_VERIFY, panel=_CHECKED, parser=_rows)] = 1,
    seal: SealFile = None,
    secret: SecretFile = None,
) -> int:
    """Check the results of a benchmark, and pack them into one file that others can check.

    All scenarios must be in the catalogue, all rows must have the same behaviour numbers, and no seed may be
    missing. Failed runs are allowed, and reported.
    """
    from wbf_mission.addons.boards.audit import require_asked, require_whole
    from wbf_mission.addons.boards.sealed import require_seeds
    from wbf_mission.addons.boards.submission import SUFFIX, code_files, made_when, require_texts, write_pack
    from wbf_mission.addons.boards.verification import fly_again
    from wbf_mission.results.storage import ResultError

    rows = rows_in(folder)
    path = out or Path(file_stem(name.lower(), "submission", "a-z0-9") + SUFFIX)
    if path.suffix.lower() != SUFFIX:
        raise ResultError(f"--out {path}: a pack is a {SUFFIX} file; give a name with this suffix")
    options.refuse_overwrite(path, suffixes=(SUFFIX,))
    opened = _secret(seal, secret)
    try:
        require_asked(rows, folder)
        require_whole(rows, sealed=opened is not None)
        if opened is not None:
            require_seeds(opened, rows)
    except ResultError as error:
        raise ResultError(f"{folder}: {error}") from None
    require_texts({"name": name, "by": by, "about": about}, "--")
    files = code_files(code or ())
    own = _own(code, rows) if code else {}
    with output.progress() as progress:
        found = fly_again(rows, verify, own=own, progress=progress)
    if found.differing:
        for one in found.differing[:_SHOWN]:
            output.warn(one.why)
        raise ResultError(
            f"{folder}: {len(found.differing)} of {len(found.rows)} rows differ from a second flight"
        )
    _warn_of(output, rows, found)
    told = write_pack(
        path,
        rows,
        name=name,
        by=by,
        about=about,
        made=made_when(folder),
        seal="" if opened is None else opened.seal().seal,
        code=files,
    )
    failed = sum(row.error is not None for row in rows)
    scenarios = ", ".join(one.scenario for one in told.flown)
    size = path.stat().st_size
    output.result(
        {
            "file": str(path),
            "bytes": size,
            "rows": len(rows),
            "failed": failed,
            "scenarios": [one.scenario for one in told.flown],
            "code": told.code,
            "flown_again": str(found),
        },
        {
            "pack": f"{path}, {size / 1e3:.0f} kB",
            "rows": f"{len(rows)}" + (f", {failed} of runs that failed" if failed else ""),
            "scenarios": scenarios,
            "code": f"wbf-mission {told.version}, behaviour {told.code}",
            "flown again": str(found),
        },
    )
    return ExitCode.GOOD


def _warn_of(output: Output, rows: Sequence[BenchRow], found: Verification) -> None:
    if found.left_out:
        output.warn(str(found))
    failed = [row for row in rows if row.error is not None]
    for row in failed[:_SHOWN]:
        output.warn(f"{row.named} failed: {row.error}")
    if len(failed) > _SHOWN:
        output.warn(f"{len(failed) - _SHOWN} more runs failed; boards count each as the worst score")


def _own(code: Sequence[Path], rows: Sequence[BenchRow]) -> dict[tuple[str, str], Choice]:
    """Return the submitted planners, policies and estimators of the rows, by name and code digest.

    Raises ResultError unless the files and folders have every one of them unchanged.
    """
    from wbf_mission.addons.boards.apart import held_by
    from wbf_mission.results.storage import ResultError

    names = ", ".join(map(str, code))
    wanted = {
        (kind, getattr(row, kind), row.codes[kind])
        for row in rows
        for kind in ("planner", "estimator")
        if kind in row.codes
    }
    if not wanted:
        raise ResultError(f"--code {names}: the rows use only built-in methods; leave --code out")
    files = [file for one in code for file in (sorted(one.rglob("*.py")) if one.is_dir() else [one])]
    try:
        return {(label, code): held_by(files, kind, label, code) for kind, label, code in sorted(wanted)}
    except ResultError as error:
        raise ResultError(f"--code {names}: {error}; give the code of the rows, or fly again") from None


@options.speaks()
def board_command(
    output: Output,
    packs: Annotated[
        list[Path],
        typer.Argument(help="Files written by 'bench submit', and folders of baselines, like results/."),
    ],
    *,
    out: Annotated[
        Path | None, option("Write the board into this folder: board.md, board.html, board.json, pictures.")
    ] = None,
    verify: Annotated[
        int | None,
        option(
            _VERIFY,
            panel=_CHECKED,
            parser=_rows,
            show_default="1, but 0 for the frozen baselines of this version",
        ),
    ] = None,
    seal: SealFile = None,
    secret: SecretFile = None,
) -> int:
    """Make a leaderboard of submissions and frozen baselines.

    A table compares methods flown with the same behaviour numbers on the same environments. A file that fails
    a check is left out with a warning; the exit code is then 1. Code in a pack is never run.
    """
    from wbf_mission.addons.boards.board import board_of, packs_of
    from wbf_mission.addons.boards.board_page import board_values, short_table

    opened = _secret(seal, secret)
    if out is not None:
        provided("bench")  # If no add-on writes pages, the command fails here, before the flights
    with output.progress() as progress:
        board = board_of(packs_of(packs), verify=verify, secret=opened, progress=progress)
    if not board.entries:
        from wbf_mission.results.storage import ResultError

        more = len(board.refused) - 1
        first = next(iter(board.refused.values()))
        raise ResultError(
            f"{first}; no pack is left for a board" + (f" ({more} more refused)" if more else "")
        )
    for why in board.refused.values():
        output.warn(f"left out: {why}")
    if out is not None:
        _write(output, board, out)
    if output.as_json:
        output.raw_json(board_values(board))
    else:
        for table in board.tables:
            print_table(output, short_table(table))
    differing = [one for one in board.entries if one.verification.differing]
    for entry in board.entries:
        for again in entry.verification.differing[:_SHOWN]:
            output.warn(f"{entry.path}: {again.why}")
        if entry.verification.left_out:
            output.warn(f"{entry.path}: {entry.verification}")
    return ExitCode.NOT_GOOD if board.refused or differing else ExitCode.GOOD


def _write(output: Output, board: Board, out: Path) -> None:
    from wbf_mission.addons.boards.board_page import board_page, board_values, draw_board
    from wbf_mission.results.files import write_json

    out.mkdir(parents=True, exist_ok=True)
    page = board_page(board, draw_board(board, out))
    page.write(out / "board.md")
    provided("bench")(out / "board.html", page, out)
    write_json(out / "board.json", board_values(board))
    output.note(f"written: {out / 'board.md'}, {out / 'board.html'}, {out / 'board.json'}")


@options.speaks(quiet=False)
def seal_command(
    output: Output,
    *,
    out: Annotated[Path, option("Path of the secret file and the seal file, without their suffixes.")],
    environments: Annotated[
        int, option("Number of environments of the round.", parser=options.whole_number_in(1, 10_000))
    ] = 40,
    scenarios: Annotated[
        str | None, option("Ids of the round's scenarios, separated by commas.  [default: any]")
    ] = None,
) -> int:
    """Create the secret of a round of held-out environments, and its seal.

    Publish NAME.seal.json at once. Keep NAME.secret for 'bench run --sealed', and publish it after the round.
    """
    from wbf_mission.addons.boards.sealed import new_secret, write_round

    names = [one.strip() for one in (scenarios or "").split(",") if one.strip()]
    secret = new_secret(environments, names, datetime.datetime.now(datetime.UTC))
    kept, published = write_round(secret, out)
    output.result(
        {"secret": str(kept), "seal": str(published), "digest": secret.seal().seal},
        {
            "secret": f"{kept}: keep it until the round ends",
            "seal": f"{published}: publish it now",
            "digest": secret.seal().seal,
        },
    )
    return ExitCode.GOOD


@options.speaks()
def verify_command(
    output: Output,
    pack: Annotated[Path, typer.Argument(help="File written by 'bench submit --code'.")],
    *,
    environments: Annotated[
        int,
        option("Number of fresh environments of each scenario.", parser=options.whole_number_in(2, 10_000)),
    ] = 20,
) -> int:
    """Fly the code of a submission on fresh environments, and compare the scores with the submitted scores.

    The seeds are drawn from the system's randomness, and printed after the last flight. The code runs in a
    separate process, which receives neither the run nor its files. Read the code first, and run it where it
    can do no harm, such as in a container without network. The exit code is 1 if a method scores worse than
    in its rows or was not flown, and 2 if no method was flown.
    """
    import tempfile

    import msgspec
    import numpy as np

    from wbf_mission.addons.base.intervals import score_text
    from wbf_mission.addons.boards.audit import require_whole
    from wbf_mission.addons.boards.comparison import difference
    from wbf_mission.addons.boards.fresh import fly_fresh
    from wbf_mission.addons.boards.submission import read_pack, unpack_code
    from wbf_mission.results.storage import ResultError

    read = read_pack(pack)
    try:
        require_whole(read.rows, sealed=bool(read.submission.seal))
        with tempfile.TemporaryDirectory() as folder, output.progress() as progress:
            unpack_code(read, Path(folder))
            found = fly_fresh(read.rows, Path(folder), environments, progress=progress)
        if not found.gaps:
            told = [f"{', '.join(method)}: {why}" for method, why in found.left_out]
            raise ResultError(f"cannot be flown: {'; '.join(told[:_SHOWN])}")
    except ResultError as error:
        raise ResultError(f"{pack}: {error}") from None
    values = [msgspec.to_builtins(gap) | {"verdict": gap.verdict} for gap in found.gaps]
    table = [
        [
            ", ".join(gap.method),
            score_text(float(np.mean(gap.open_scores))),
            score_text(float(np.mean(gap.fresh_scores)))
            + (f", {len(gap.failed)} failed" if gap.failed else ""),
            *difference(gap.gap),
            gap.verdict,
        ]
        for gap in found.gaps
    ]
    header = ["scenario, planner, estimator", "open", "fresh", "gap", "95 %", "verdict"]
    title = f"{pack}: scores on the open and on {environments} fresh environments"
    if output.as_json:
        left = [{"method": method, "why": why} for method, why in found.left_out]
        output.raw_json({"gaps": values, "seeds": found.seeds, "left_out": left})
    else:
        output.table(None, header, table, title=title)
    for scenario, seeds in found.seeds.items():
        output.note(f"{scenario}: the seeds were {','.join(map(str, seeds))}")
    for gap in found.gaps:
        for why in dict.fromkeys(gap.failed):
            output.warn(f"{', '.join(gap.method)}: {why}")
    for method, why in found.left_out:
        output.warn(f"{', '.join(method)}: not flown: {why}")
    worse = any(gap.gap.high < 0.0 for gap in found.gaps)
    return ExitCode.NOT_GOOD if worse or found.left_out else ExitCode.GOOD


SUBMIT = Command(submit_command, SUBMIT_EXAMPLES)
BOARD = Command(board_command, BOARD_EXAMPLES)
VERIFY = Command(verify_command, VERIFY_EXAMPLES)
SEAL = Command(seal_command, SEAL_EXAMPLES)
