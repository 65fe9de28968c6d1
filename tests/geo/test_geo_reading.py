"""Files of users: what is no small, regular file is refused at once."""

import os

import pytest

from geo.reading import UnreadableError, read_file, read_text, read_toml


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
