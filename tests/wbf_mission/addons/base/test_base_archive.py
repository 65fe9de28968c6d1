"""Archives of users: what is damaged or too large is refused in a line."""

import io
import zipfile

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wbf_mission.addons.base.archive import MAX_MEMBERS, Archive, ArchiveError, archive_of

NAMES = st.text("abc/._", min_size=1, max_size=12).filter(lambda name: "._" not in name)


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
