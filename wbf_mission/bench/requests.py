"""Requests stored in a benchmark folder (``asked.json``): specifications, commands and scenario cards."""

from __future__ import annotations

import datetime
import json
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec

from geo.reading import MAX_TEXT_BYTES, UnreadableError, misfit, not_json, read_file
from wbf_mission.bench.cards import Card, card_of
from wbf_mission.bench.spec import BenchSpec, seeds_text
from wbf_mission.results.files import write_json
from wbf_mission.results.storage import ResultError
from wbf_mission.scenario import Choice

ASKED = "asked.json"


class Asked(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A request to fly one specification.

    Attributes
    ----------
    when : str
        Time of the first such request, UTC (ISO 8601).
    command : str
        Command line; empty for a request from Python.
    specification : str
        TOML file for ``bench run``; objects given from Python are named in a comment.
    """

    when: str
    command: str
    specification: str


class AskedFor(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All requests of a folder in order of time, and the cards of its scenarios."""

    asked: list[Asked] = []
    cards: list[Card] = []


def read_asked(folder: Path) -> AskedFor:
    """Return the requests of a folder; empty for an old folder without the file.

    ResultError if the file is damaged.
    """
    path = folder / ASKED
    if not path.exists():
        return AskedFor()
    try:
        data = read_file(path, MAX_TEXT_BYTES)
        return msgspec.json.decode(data, type=AskedFor)
    except UnreadableError as error:
        why = str(error)
    except msgspec.ValidationError as error:
        why = misfit(error)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        why = not_json(error, data)
    raise ResultError(f"{path}: is no list of requests: {why}; remove it") from None


def keep_asked(folder: Path, spec: BenchSpec, command: str) -> None:
    """Add a request to the file of a folder, unless the file already has it."""
    found = read_asked(folder)
    now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    asked = Asked(now, command, specification_text(spec))
    new = all((old.command, old.specification) != (command, asked.specification) for old in found.asked)
    known = {(card.scenario, card.meaning) for card in found.cards}
    made = [card_of(name, scenario) for name, scenario in spec.scenarios]
    cards = [card for card in made if (card.scenario, card.meaning) not in known]
    if new or cards:
        write_json(
            folder / ASKED, AskedFor([*found.asked, *([asked] if new else [])], [*found.cards, *cards])
        )


def specification_text(spec: BenchSpec) -> str:
    """Return a specification as TOML for `BenchSpec.read`.

    Examples
    --------
    >>> print(specification_text(BenchSpec.of(planners=["spiral"], estimators=["gp"], seeds="100..139")))
    scenarios = ["WBF/Miniberry-30-v1"]
    planners = ["spiral"]
    estimators = ["gp"]
    seeds = "100..139"
    """
    seeds = seeds_text(spec.seeds)
    lines = [
        f"scenarios = {_texts([name for name, _ in spec.scenarios])}",
        *_choices("planners", spec.planners),
        *_choices("estimators", spec.estimators),
        f"seeds = {seeds}" if seeds.isdigit() else f"seeds = {json.dumps(seeds)}",
    ]
    return "\n".join(lines)


def _choices(key: str, choices: Sequence[Choice]) -> Iterator[str]:
    named = [str(choice) for choice in choices if choice.made is None]
    own = [str(choice) for choice in choices if choice.made is not None]
    if named:
        yield f"{key} = {_texts(named)}"
    if own:
        yield f"# {key} of your own, which no file names: give all on the command line: {_texts(own)}"


def _texts(texts: Sequence[str]) -> str:
    return json.dumps(list(texts), ensure_ascii=False)
