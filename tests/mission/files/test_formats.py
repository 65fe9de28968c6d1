"""The choice of the format by suffix, and errors that name the file."""

import pytest
from any_missions import GUARDED, MISSION
from packages import install

from mission.errors import MissionFileError
from mission.files import mission_formats, read_mission, write_mission, writer_for


def names(folder):
    return [entry.name for entry in folder.iterdir()]


@pytest.mark.parametrize("suffix", [".plan", ".waypoints", ".wpl", ".txt", ".Json"])
def test_suffix_chooses_the_format(tmp_path, suffix):
    path = tmp_path / f"mission{suffix}"
    write_mission(MISSION, path)
    assert read_mission(path) == MISSION
    assert read_mission(str(path)) == MISSION
    assert names(tmp_path) == [path.name]


def test_unknown_suffixes_list_the_known_ones(tmp_path):
    for name in ("mission.xyz", "mission", "plan"):
        with pytest.raises(MissionFileError, match=r"unknown suffix .*read from \.plan, \.way.* or \."):
            read_mission(tmp_path / name)
        with pytest.raises(MissionFileError, match=r"written to \.plan, .* or \."):
            write_mission(MISSION, tmp_path / name)
    with pytest.raises(MissionFileError, match="no writer for fence or rally text files"):
        writer_for("field.fen")
    assert names(tmp_path) == []


PACKAGE = """
from mission.files import MissionFormat, native

FORMATS = [
    MissionFormat("mine", (".mine", ".Mine.plan"), native.loads, native.dumps),
    MissionFormat("other", (".json",)),
]
"""


def test_a_package_brings_formats_and_replaces_none(tmp_path, monkeypatch):
    (tmp_path / "mission_formats_of_a_test.py").write_text(PACKAGE)
    install(tmp_path, "mine", "[wbf_mission.mission_formats]\nmine = mission_formats_of_a_test:FORMATS\n")
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("a.mine", "b.mine.plan", "c.json"):
        write_mission(MISSION, tmp_path / name)
        assert (tmp_path / name).read_text().startswith('{\n  "format": "wbf-mission"')
        assert read_mission(tmp_path / name) == MISSION
    assert "mine" in [mission_format.name for mission_format in mission_formats()]


def test_a_package_that_cannot_be_loaded_is_named_where_a_format_is_missed(tmp_path, monkeypatch):
    install(tmp_path, "broken", "[wbf_mission.mission_formats]\nbroken = no_such_module_of_a_test:FORMATS\n")
    monkeypatch.syspath_prepend(tmp_path)
    write_mission(MISSION, tmp_path / "a.plan")
    assert read_mission(tmp_path / "a.plan") == MISSION
    with pytest.raises(MissionFileError, match=r"of broken \(no_such_module_of_a_test:FORMATS\) cannot be"):
        read_mission(tmp_path / "a.mine")


KML = b'<?xml version="1.0"?>\n<kml xmlns="http://www.opengis.net/kml/2.2"></kml>'


@pytest.mark.parametrize(
    ("content", "found"),
    [
        (b"", "an empty file"),
        (KML, "a KML file"),
        (b"<!DOCTYPE html><html>", "an HTML page"),
        (b"PK\x03\x04rest", "a ZIP archive"),
        (b"\x89PNG\r\n\x1a\n\0\0\0", "a binary file"),
        ("QGC WPL 110".encode("utf-16"), "UTF-16"),
        (b"hello\nworld", "a text file of another kind"),
        (b'{"type": "FeatureCollection", "features": []}', "a GeoJSON file"),
    ],
)
@pytest.mark.parametrize("suffix", [".plan", ".waypoints", ".json"])
def test_foreign_files_are_recognised(tmp_path, content, found, suffix):
    path = tmp_path / f"mission{suffix}"
    path.write_bytes(content)
    with pytest.raises(MissionFileError) as caught:
        read_mission(path)
    text = str(caught.value)
    assert text.startswith(f"{path}: this is ")
    assert found in text
    assert "give a mission" in text or "rename it to end in" in text
    assert text.isprintable()


def test_files_that_cannot_be_read(tmp_path):
    (tmp_path / "folder.plan").mkdir()
    for name, part in (("missing.plan", "no such file"), ("folder.plan", "a folder"), ("n\0l.plan", "NUL")):
        with pytest.raises(MissionFileError, match="cannot be read") as caught:
            read_mission(tmp_path / name)
        assert part in str(caught.value)


def test_files_that_cannot_be_written(tmp_path):
    (tmp_path / "folder.plan").mkdir()
    for name in ("folder.plan", "missing/mission.plan", "n\0l.plan", "x" * 300 + ".plan"):
        with pytest.raises(MissionFileError, match="cannot be written"):
            write_mission(MISSION, tmp_path / name)
    assert names(tmp_path) == ["folder.plan"]


def test_failed_writing_keeps_the_older_file(tmp_path):
    path = tmp_path / "mission.waypoints"
    write_mission(MISSION, path)
    with pytest.raises(MissionFileError, match=r"mission\.waypoints: cannot be written: .*holds one plan"):
        write_mission(GUARDED, path)
    assert read_mission(path) == MISSION
    assert names(tmp_path) == [path.name]


def test_too_large_a_file(tmp_path):
    path = tmp_path / "huge.plan"
    with path.open("wb") as file:
        file.truncate(64 * 2**20 + 1)
    with pytest.raises(MissionFileError, match="larger than 64 MiB"):
        read_mission(path)
