"""Telemetry logs, read back by us and by pymavlink."""

from __future__ import annotations

import os

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink import mavutil

from mission.errors import LinkError
from mission.link import FrameWriter, TlogWriter, read_tlog, tlog
from mission.link.codec.dialect import mavlink

START_S = 1_800_000_000.25


def write(path, number=20):
    writer = FrameWriter(1, 1)
    with TlogWriter(path) as log:
        for index in range(number):
            log.write(writer.encode(mavlink.MAVLink_mission_current_message(index)), START_S + index / 8)
            log.write(
                writer.encode(mavlink.MAVLink_statustext_message(6, b"text %d" % index)), START_S + index / 8
            )
    assert log.frames == 2 * number


def test_mavutil_reads_it(tmp_path):
    path = tmp_path / "flight.tlog"
    write(path)
    log = mavutil.mavlink_connection(str(path), dialect="all")
    seen = []
    while (message := log.recv_match(blocking=False)) is not None:
        seen.append((message.get_type(), message._timestamp))
    log.close()
    assert len(seen) == 40
    assert seen[0] == ("MISSION_CURRENT", START_S)
    assert seen[-1] == ("STATUSTEXT", START_S + 19 / 8)


@given(st.binary(max_size=60), st.integers(0, 400))
def test_damage_costs_only_what_it_hits(tmp_path_factory, garbage, at):
    path = tmp_path_factory.mktemp("tlog") / "flight.tlog"
    write(path, 10)
    data = path.read_bytes()
    at = min(at, len(data))
    path.write_bytes(data[:at] + garbage + data[at:-3])
    assert 16 <= len(list(read_tlog(path))) <= 20


def test_errors(tmp_path):
    with pytest.raises(LinkError, match="cannot be written"):
        TlogWriter(tmp_path / "missing" / "flight.tlog")
    with pytest.raises(LinkError, match="cannot be read"):
        list(read_tlog(tmp_path / "none.tlog"))
    with pytest.raises(LinkError, match="cannot be read: it is a folder, a pipe or a device"):
        list(read_tlog("/dev/zero"))
    empty = tmp_path / "empty.tlog"
    empty.write_bytes(b"")
    assert list(read_tlog(empty)) == []


def test_a_log_beyond_the_limit_is_refused_before_it_fills_the_memory(tmp_path, monkeypatch):
    assert tlog.MAX_LOG_BYTES == 2**30
    monkeypatch.setattr(tlog, "MAX_LOG_BYTES", 2**16)
    path = tmp_path / "huge.tlog"
    write(path)
    os.truncate(path, 2**16)
    assert len(list(read_tlog(path))) == 40
    os.truncate(path, 2**16 + 1)
    with pytest.raises(LinkError, match=r"huge\.tlog: the log cannot be read: it is larger than"):
        list(read_tlog(path))
