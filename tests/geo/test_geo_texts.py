"""Texts from outside: shown in one printable line; numbers in them are read strictly."""

import math
from pathlib import PureWindowsPath

import pytest
from hypothesis import given
from hypothesis import strategies as st

from geo.texts import file_stem, one_line, parse_number, parse_whole, printable, unknown


@given(st.text(), st.integers(4, 60))
def test_any_text_becomes_one_printable_line(text, length):
    line = one_line(text, length)
    assert line.isprintable()
    assert len(line) <= length
    assert all(part.isprintable() for part in printable(text).split("\n"))


def test_control_characters_are_spelled_out():
    assert one_line("a\0b\nc\x1b[31m") == "a\\x00b c\\x1b[31m"
    assert one_line("x" * 30, 10) == "xxxxxxx..."


@given(st.floats(allow_nan=False), st.integers())
def test_numbers_as_programs_write_them_are_read(value, number):
    assert parse_number(repr(value)) == value
    assert parse_whole(f" {number} ") == number


@pytest.mark.parametrize("text", ["1_0", "", "ten", "\u0661", "\uff11", "1,5", "0x10"])
def test_other_spellings_are_refused(text):
    with pytest.raises(ValueError, match="is not a number"):
        parse_number(text)
    with pytest.raises(ValueError, match="is not a whole number"):
        parse_whole(text)


def test_what_only_a_whole_number_is_not():
    assert math.isnan(parse_number("nan"))
    with pytest.raises(ValueError, match=r"'1\.5' is not a whole number"):
        parse_whole("1.5")


NAMES = st.text() | st.sampled_from(
    ["con", "AUX.txt", " nul", "lpt9", "COM¹.a", "prn ", "..", "a." * 60, "C:\\farm"]
)


@given(NAMES, st.sampled_from([r"\w", r"\w .-", r"\w.+", "a-z0-9"]))
def test_any_text_becomes_a_file_name_that_windows_takes(text, kept):
    path = PureWindowsPath(name := file_stem(text, "farm", kept))
    assert path.name == name and path.parent == PureWindowsPath(".")
    assert 0 < len(name) <= 101 and name == name.strip(" .") and not set(name) & set('<>:"/\\|?*')
    assert not path.with_name(f"{name}.png").is_reserved()


def test_an_unknown_name_is_told_with_what_is_known():
    told = "unknown mode 'aut' (is 'AUTO' meant?): choose AUTO, RTL, or another one"
    assert unknown("mode", "aut", ["AUTO", "RTL"], ", or another one") == told
    assert (
        unknown("crop", "TOMATOE", ["tomato"]) == "unknown crop 'TOMATOE' (is 'tomato' meant?): choose tomato"
    )
    assert unknown("mode", "HOVER", ["AUTO", "RTL"]) == "unknown mode 'HOVER': choose AUTO, RTL"
    long = "\n" * 60
    assert unknown("crop", long + "x", []) == f"unknown crop {long!r}: there is none"
