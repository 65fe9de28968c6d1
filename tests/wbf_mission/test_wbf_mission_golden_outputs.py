"""What five flights and thirty commands give changes only on purpose."""

import json

import pytest
import write_golden_outputs
from mcap.writer import Writer
from processes import run_forked
from write_golden_outputs import COMMANDS, FLIGHTS, TABLE, digests, mcap_messages

from wbf_mission.bench.provenance import libraries

KEPT = json.loads(TABLE.read_text())


def test_every_flight_and_command_is_kept():
    assert {f"fly {name}" for name in FLIGHTS} | COMMANDS.keys() <= KEPT["outputs"].keys()
    assert (len(FLIGHTS), len(COMMANDS)) == (5, 30)


@pytest.mark.parametrize(
    ("library", "message", "same"),
    [
        ("wbf-mission 9.9", {"value": 1, "compute_s": 0.7}, True),
        ("wbf-mission 0.2.0", {"value": 2, "compute_s": 0.5}, False),
    ],
)
def test_an_mcap_is_kept_without_version_and_clock(tmp_path, library, message, same):
    def kept(library, message):
        with (tmp_path / "some.mcap").open("wb") as file:
            writer = Writer(file)
            writer.start(library=library)
            schema = writer.register_schema("wbf_mission.Some", "jsonschema", b"{}")
            data = json.dumps(message, separators=(",", ":")).encode()
            writer.add_message(writer.register_channel("/some", "json", schema), 5, data, 5)
            writer.finish()
        return mcap_messages(tmp_path / "some.mcap")

    assert (kept(library, message) == kept("wbf-mission 0.2.0", {"value": 1, "compute_s": 0.5})) is same


def run_apart(folder, command):
    """Run a command in a process of its own, as the tool does, but a fork that has imported what it needs."""
    out, err = folder / "printed.out", folder / "printed.err"
    code = run_forked(command.split(), folder, out, err)
    told = out.read_bytes() or err.read_bytes()
    for file in (out, err):
        file.unlink()
    return f"exit code {code}\n".encode() + write_golden_outputs._stable(told, folder)


@pytest.mark.slow
def test_outputs_are_those_that_were_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(write_golden_outputs, "_run", run_apart)
    # Where a change is meant: python tools/write_golden_outputs.py, and say in the commit why.
    if KEPT["libraries"] != libraries():
        pytest.skip(f"other libraries than {KEPT['libraries']}: last bits of outputs may differ")
    now = digests(tmp_path)
    names = KEPT["outputs"].keys() | now.keys()
    assert not [name for name in sorted(names) if KEPT["outputs"].get(name) != now.get(name)]
