"""The simulator command with a signing key."""

import json

import pytest

from mission.link import FrameReader, Signing, key_from_text, read_tlog
from wbf_mission.cli.app import main

QUICK = ["sim", "--no-camera", "--listen", "udpin:127.0.0.1:0", "--speed", "max", "-q", "--json"]


@pytest.mark.parametrize("way", ["phrase", "hexadecimal", "file", "environment"])
def test_everything_is_signed_and_the_key_is_in_no_file(tmp_path, capsys, monkeypatch, way):
    log, phrase = tmp_path / "flight.tlog", "correct horse battery"
    key = key_from_text(phrase)
    if way == "environment":
        monkeypatch.setenv("WBF_MISSION_SIGNING_KEY", phrase)
        given = []
    else:
        (tmp_path / "key").write_text(f"{phrase}\n")
        given = [
            "--signing-key",
            {"phrase": phrase, "hexadecimal": key.hex(), "file": f"@{tmp_path}/key"}[way],
        ]
    assert main([*QUICK, *given, "--duration", "2", "--tlog", str(log)]) == 0
    told = capsys.readouterr()
    json.loads(told.out)
    assert phrase not in told.out + told.err
    data = log.read_bytes()
    assert key not in data
    reader = FrameReader(signing=Signing(key))
    frames = [message.get_msgbuf() for _, message in read_tlog(log)]
    assert len(frames) > 50
    assert sum(len(reader.feed(bytes(frame))) for frame in frames) == len(frames)


def test_a_key_file_that_is_not_there_is_one_line(capsys):
    assert main([*QUICK, "--signing-key", "@/nowhere/key", "--duration", "1"]) == 2
    err = capsys.readouterr().err
    assert "signing key: /nowhere/key cannot be read" in err
    assert "Traceback" not in err
