"""Files and archives of users: what is no small, regular file is refused at once."""

import io
import os
import zipfile

import pytest
from hypothesis import given
from hypothesis import strategies as st

from geo.reading import (
    MAX_MEMBERS,
    Archive,
    ArchiveError,
    UnreadableError,
    archive_of,
    read_file,
    read_text,
    read_toml,
)

NAMES = st.text("abc/._", min_size=1, max_size=12).filter(lambda name: "._" not in name)


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
    for text in ("a = ", "a = " + "[" * 100_000, "a = 1\na = 2"):
        path.write_text(text)
        with pytest.raises(UnreadableError) as caught:
            read_toml(path)
        assert "\n" not in str(caught.value)


@given(st.dictionaries(NAMES, st.binary(max_size=200), max_size=5))
def test_what_is_packed_is_unpacked(members):
    packed = archive_of(members)
    with Archive(packed, 1000) as archive:
        assert archive.names == list(members)
        assert {name: archive.read(name) for name in members} == members
        assert archive.room == 1000 - sum(map(len, members.values()))
    assert packed == archive_of(members)


def test_all_members_share_the_room(tmp_path):
    path = tmp_path / "a.zip"
    path.write_bytes(archive_of({"a": bytes(3 << 20), "b": bytes(3 << 20)}))
    with Archive(path, 5 << 20) as archive:
        assert len(archive.read("a")) == 3 << 20
        with pytest.raises(ArchiveError, match="more than 5 MiB"):
            archive.read("b")


@pytest.mark.parametrize("as_bytes", [True, False])
def test_too_many_members_are_refused(tmp_path, as_bytes):
    path = tmp_path / "a.zip"
    path.write_bytes(archive_of({str(k): b"" for k in range(MAX_MEMBERS + 1)}))
    with pytest.raises(ArchiveError, match="more than 1000"):
        Archive(path.read_bytes() if as_bytes else path, 1)


@given(st.data())
def test_damage_is_told_in_a_line(data):
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.txt", "what is told " * 30)
    packed = bytearray(made.getvalue())
    packed[data.draw(st.integers(0, len(packed) - 1))] ^= data.draw(st.integers(1, 255))
    try:
        with Archive(bytes(packed), 10_000) as archive:
            for name in archive.names:
                archive.read(name)
    except ArchiveError as error:
        assert "\n" not in str(error)
