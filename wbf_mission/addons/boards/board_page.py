"""The leaderboard as a page with plots, and as JSON values."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from msgspec import structs

from geo.texts import one_line
from wbf_mission.addons.base.intervals import Interval
from wbf_mission.addons.base.pages import Page, Picture, Section, Table
from wbf_mission.addons.base.plots import new_figure, save_figure
from wbf_mission.addons.boards.board import SHOWN_DIGEST, Board, BoardTable, Entry, Line
from wbf_mission.addons.boards.comparison import doubt_in_words, verdict
from wbf_mission.bench.spec import seeds_text

_MOST_DRAWN, _FEWEST_DRAWN = 24, 2
_GREY, _BLUE = "#777777", "#1f6fb4"
_NAMED = ("planner, estimator", "submission", "kind")
_ABOUT = (
    "Scores: 0 is perfect; a table has the mean over the run and the score at its end, each with a 95 %"
    " interval over the environments. Difference: the score over the run minus the score of the best frozen"
    " baseline on the same environment; positive is better; all intervals of a table hold together in 95 of"
    " 100 cases. Failed: the number of runs without a result, which count as the worst score. Bad: the"
    " fraction of a policy's answers that were not flown, or came too late. Flown again: the number of rows"
    " that were flown again for this board, and whether the results were the same; if no row was flown again,"
    " only the author vouches for the results. Brackets after a name contain digests of submitted code. A"
    " baseline is a pack in the folder of frozen baselines; every other pack is a submission."
)


def board_page(board: Board, pictures: Mapping[int, Picture] | None = None) -> Page:
    """Return the board as a page; `pictures` are keyed by the number of their table."""
    sections = [
        Section(
            title_of(table),
            text=f"Flown by wbf-mission {', '.join(table.versions)}, behaviour {table.code}."
            f" {doubt_in_words(len(table.seeds))}",
            pictures=(pictures[number],) if pictures and number in pictures else (),
            tables=tuple(one for one in (board_table(table), difference_table(table)) if one.rows),
        )
        for number, table in enumerate(board.tables)
    ]
    sections.append(Section("Submissions", tables=(_submissions(board.entries),)))
    if board.refused:
        refused = Table("Files that are left out", ("file", "why"), tuple(board.refused.items()))
        sections.append(Section("Refused files", tables=(refused,)))
    return Page("Leaderboard", _ABOUT, tuple(sections))


def draw_board(board: Board, folder: Path) -> dict[int, Picture]:
    """For each table with several methods, draw the scores over the run into `folder`."""
    found = {}
    for number, table in enumerate(board.tables):
        lines = [line for line in table.lines if math.isfinite(line.standing.score.low)][:_MOST_DRAWN]
        if len(lines) < _FEWEST_DRAWN:
            continue
        figure = new_figure(9.0, 0.9 + 0.24 * len(lines))
        axes = figure.add_subplot()
        for place, line in enumerate(lines):
            score, colour = line.standing.score, _GREY if line.entry.frozen else _BLUE
            axes.plot([score.low, score.high], [place, place], color=colour, linewidth=2.0)
            axes.plot(score.mean, place, "o", color=colour, markersize=5.0)
        axes.set_yticks(range(len(lines)), [_label(line) for line in lines], fontsize=8)
        axes.set_ylim(len(lines) - 0.5, -0.5)
        axes.set_xlabel("score over the run (0 is perfect) with its 95 % interval", fontsize=8)
        axes.tick_params(axis="x", labelsize=8)
        axes.grid(axis="x", alpha=0.3)
        figure.tight_layout()
        save_figure(figure, folder / f"board-{number + 1}.png")
        of = "" if len(lines) == len(table.lines) else f" (the best {len(lines)} of {len(table.lines)})"
        found[number] = Picture(f"board-{number + 1}.png", f"Scores of {title_of(table)}{of}")
    return found


def _label(line: Line) -> str:
    text = f"{line.standing.planner}, {line.standing.estimator}"
    whose = "" if line.entry.frozen else f" ({line.entry.submission.name})"
    return one_line(text + whose, 60).replace("$", r"\$")


def title_of(table: BoardTable) -> str:
    """Return the title of a table: its scenario and environments."""
    return f"{table.scenario}, {table.environments}"


def board_table(table: BoardTable) -> Table:
    """Return a table of the methods and their scores, best method first."""
    columns = ("run", "run 95 %", "end", "end 95 %", "failed", "bad", "flown again")
    return _table("Scores", table.lines, columns)


def difference_table(table: BoardTable) -> Table:
    """Return a table of score differences from the best baseline; it is empty if there is no baseline."""
    best = next((_cells(line)[_NAMED[0]] for line in table.lines if line.against is None), "")
    others = [line for line in table.lines if line.against is not None]
    columns = ("difference", "difference 95 %", "verdict", "better on")
    return _table(f"Against the best baseline, {best}", others, columns)


def short_table(table: BoardTable) -> Table:
    """Return a table of the methods with fewer columns, so that it fits a terminal."""
    columns = ("run", "run 95 %", "end", "difference", "verdict", "failed", "flown again")
    return _table(title_of(table), table.lines, columns)


def _table(title: str, lines: Sequence[Line], columns: Sequence[str]) -> Table:
    columns = (*_NAMED, *columns)
    header = tuple("95 %" if column.endswith(" 95 %") else column for column in columns)
    rows = tuple(tuple(cells[column] for column in columns) for cells in map(_cells, lines))
    return Table(title, header, rows, texts=len(_NAMED))


def _cells(line: Line) -> dict[str, str]:
    """Return the table cells of a method, keyed by column name."""
    standing, against = line.standing, line.against
    run, run_limits = _interval(standing.score)
    end, end_limits = _interval(standing.final_score)
    cells = {
        "planner, estimator": standing.named + (f" [{line.own}]" if line.own else ""),
        "submission": line.entry.submission.name,
        "kind": _kind(line.entry),
        "run": run,
        "run 95 %": run_limits,
        "end": end,
        "end 95 %": end_limits,
        "failed": str(standing.failed),
        "bad": "-" if math.isnan(standing.bad_share) else f"{standing.bad_share:.1%}",
        "flown again": _again(line),
        "difference": "-",
        "verdict": "-",
    }
    if against is not None:
        difference, difference_limits = _interval(against.score, "+")
        cells |= {
            "difference": difference,
            "difference 95 %": difference_limits,
            "verdict": verdict(against.score),
            "better on": "-" if math.isnan(against.better) else f"{against.better:.0%}",
        }
    return cells


def _kind(entry: Entry) -> str:
    return "baseline" if entry.frozen else "submission"


def _again(line: Line) -> str:
    standing = line.standing
    return str(line.entry.verification.of(standing.scenario, standing.planner, standing.estimator))


def _interval(interval: Interval, sign: str = "-") -> tuple[str, str]:
    limits = "-" if math.isnan(interval.low) else f"{interval.low:{sign}#.3g} to {interval.high:{sign}#.3g}"
    return "-" if math.isnan(interval.mean) else f"{interval.mean:{sign}#.3g}", limits


def _submissions(entries: Sequence[Entry]) -> Table:
    rows = tuple(
        (
            entry.submission.name,
            _kind(entry),
            entry.submission.by,
            entry.submission.about or "-",
            str(entry.verification),
            entry.submission.made,
            entry.digest[:SHOWN_DIGEST],
        )
        for entry in entries
    )
    header = ("submission", "kind", "by", "about", "flown again", "flown until", "SHA-256")
    return Table("Authors and files", header, rows, texts=5)


def board_values(board: Board) -> dict[str, Any]:
    """Return the board as JSON values."""
    return {
        "tables": [
            {
                "scenario": table.scenario,
                "versions": list(table.versions),
                "code": table.code,
                "seeds": seeds_text(table.seeds),
                "environments": len(table.seeds),
                "held_out": table.held_out,
                "methods": [_line_values(line) for line in table.lines],
            }
            for table in board.tables
        ],
        "submissions": [
            {
                "file": str(entry.path),
                "sha256": entry.digest,
                "frozen": entry.frozen,
                "verification": dataclasses.asdict(entry.verification),
                **structs.asdict(entry.submission),
            }
            for entry in board.entries
        ],
        "refused": board.refused,
    }


def _line_values(line: Line) -> dict[str, Any]:
    against = line.against
    return {
        "name": line.entry.submission.name,
        "by": line.entry.submission.by,
        "frozen": line.entry.frozen,
        "own_code": line.own,
        **dataclasses.asdict(line.standing),
        "against_the_best_baseline": None
        if against is None
        else {
            **dataclasses.asdict(against.score),
            "verdict": verdict(against.score),
            "better": against.better,
        },
        "sha256": line.entry.digest,
        "flown_again": _again(line),
    }
