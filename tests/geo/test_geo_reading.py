"""Files of users: what is no small, regular file is refused at once."""

import json
import os
import tomllib
from typing import Annotated, Literal

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import Meta

from geo.reading import (
    UnreadableError,
    misfit,
    not_json,
    not_toml,
    place_in_words,
    read_file,
    read_text,
    read_toml,
)


def test_a_file_is_read_up_to_its_limit(tmp_path):
    path = tmp_path / "data"
    path.write_bytes(b"12345")
    assert read_file(path, 5) == b"12345"
    with pytest.raises(UnreadableError, match="larger than"):
        read_file(path, 4)


def test_what_is_no_file_is_refused_without_waiting(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for name, text in {
        "pipe": "a folder, a pipe or a device",
        ".": "a folder",
        "none": "no such file",
    }.items():
        with pytest.raises(UnreadableError, match=text):
            read_file(tmp_path / name, 100)
    with pytest.raises(UnreadableError, match="in its name"):
        read_file(tmp_path / "a\0b", 100)


def test_text_is_utf_8_with_or_without_a_mark(tmp_path):
    path = tmp_path / "text"
    path.write_bytes("\ufeffgrün".encode())
    assert read_text(path) == "grün"
    path.write_bytes(b"gr\xfcn")
    with pytest.raises(UnreadableError, match=r"no.* UTF-8 text \(byte 2\)"):
        read_text(path)


def test_toml_of_any_kind_is_read_or_refused(tmp_path):
    path = tmp_path / "scenario.toml"
    path.write_text("[farm]\nname = 'a'\n")
    assert read_toml(path) == {"farm": {"name": "a"}}
    for text in ("a = ", "a = " + "[" * 100_000, "a = 1\na = 2", "a = " + "9" * 5000):
        path.write_text(text)
        with pytest.raises(UnreadableError) as caught:
            read_toml(path)
        assert "\n" not in str(caught.value)


# What is wrong with a JSON or TOML document, in words for who wrote it


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
        ('{"count":\n-Infinity}', "line 2, column 1: -Infinity is not a number in JSON; write null"),
        ('// a comment\n{"count": 1}', "line 1, column 1: '/' is not allowed here"),
        ('{"count": 1,\n"kind": ', "line 2: it ends in the middle"),
        ('{"count": 1e999}', "a number in it is too large"),
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
        ({"count": 9}, "count: it is out of range; give a whole number <= 5"),
        ({"count": 1, "numbers": [1.0, 0]}, "number 2: it is out of range; give a number > 0"),
        ({"count": 1, "pair": [1.0]}, "pair: give a list with 2 entries"),
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


def test_where_a_document_is_no_toml():
    for document, text in (("a = ?", "line 1, column 5: invalid value"), ("a = 1 b", "line 1, column 7: ")):
        with pytest.raises(tomllib.TOMLDecodeError) as error:
            tomllib.loads(document)
        assert not_toml(error.value).startswith(text)


def test_places_count_from_1():
    assert place_in_words("") == ""
    assert place_in_words("[0].x") == "entry 1, x"
