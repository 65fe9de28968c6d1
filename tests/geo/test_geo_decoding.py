"""What is wrong with a JSON or TOML document, in words for who wrote it."""

import json
import tomllib
from typing import Annotated, Literal

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import Meta
from sweeps import sweep

from geo.reading import misfit, not_json, not_toml, place_in_words


class Document(msgspec.Struct, forbid_unknown_fields=True):
    count: Annotated[int, Meta(ge=0, le=5)]
    numbers: list[Annotated[float, Meta(gt=0)]] = []
    pair: tuple[float, float] | None = None
    kind: Literal["x", "y"] = "x"
    table: dict[str, int] = {}
    yes: bool = True


@pytest.mark.parametrize(
    ("document", "text"),
    [
        ('{"count": 1,}', "line 1, column 13: a comma stands before a closing brace"),
        ('{"count" 1}', "line 1, column 10: a colon is missing"),
        ('{"count":\n-Infinity}', "line 2, column 1: -Infinity is no number in JSON; write null"),
        ('// a comment\n{"count": 1}', "line 1, column 1: '/' is not allowed here"),
        ('{"count": 1,\n"kind": ', "line 2: it ends in the middle"),
        ("", "line 1: it ends in the middle"),
    ],
)
def test_where_a_document_is_no_json(document, text):
    with pytest.raises(msgspec.DecodeError) as error:
        msgspec.json.decode(document)
    assert not_json(error.value, document.encode()) == text


@pytest.mark.parametrize(
    ("document", "text"),
    [
        ({}, "count is missing"),
        ([], "it is a list; give a table of names and values"),
        ({"count": 9}, "count: it is out of range; give a whole number <= 5"),
        ({"count": 1, "numbers": [1.0, 0]}, "number 2: it is out of range; give a number > 0"),
        ({"count": 1, "pair": [1.0]}, "pair: give a list with 2 entries"),
        ({"count": 1, "pair": 3}, "pair: it is a whole number; give a list or null"),
        ({"count": 1, "kind": "z"}, "kind: 'z' is unknown"),
        ({"count": 1, "table": {"k": None}}, "table, an entry: it is null; give a whole number"),
        ({"count": 1, "no": 0}, "no is unknown; leave it out"),
    ],
)
def test_what_does_not_fit(document, text):
    with pytest.raises(msgspec.ValidationError) as error:
        msgspec.json.decode(json.dumps(document), type=Document)
    assert misfit(error.value) == text


def test_a_part_of_a_document_is_placed_in_it():
    with pytest.raises(msgspec.ValidationError) as error:
        msgspec.convert({"count": "1"}, Document)
    assert misfit(error.value, "parts[2]") == "part 3, count: it is a text; give a whole number"


@given(st.binary(max_size=40))
def test_any_bytes_are_told_in_one_line(data):
    try:
        msgspec.json.decode(data)
    except (ValueError, msgspec.DecodeError) as error:
        text = not_json(error, data)
        assert text.isprintable()
        assert "malformed" not in text


@sweep(few=25, many=200)
@given(st.recursive(st.none() | st.integers() | st.text(max_size=3), lambda one: st.lists(one, max_size=3)))
def test_any_misfit_is_told_without_the_library_s_words(document):
    try:
        msgspec.convert(document, Document)
    except msgspec.ValidationError as error:
        assert "`" not in misfit(error)
        assert "Expected" not in misfit(error)


def test_where_a_document_is_no_toml():
    for document, text in (("a = ?", "line 1, column 5: invalid value"), ("a = 1 b", "line 1, column 7: ")):
        with pytest.raises(tomllib.TOMLDecodeError) as error:
            tomllib.loads(document)
        assert not_toml(error.value).startswith(text)


def test_places_count_from_1():
    assert place_in_words("") == ""
    assert place_in_words("[0].x") == "entry 1, x"
