"""What five flights and thirty commands give changes only on purpose."""

import json

import pytest
from write_golden_outputs import COMMANDS, FLIGHTS, TABLE, digests
from write_golden_rows import libraries

KEPT = json.loads(TABLE.read_text())


def test_every_flight_and_command_is_kept():
    assert {f"fly {name}" for name in FLIGHTS} | COMMANDS.keys() <= KEPT["outputs"].keys()
    assert (len(FLIGHTS), len(COMMANDS)) == (5, 30)


@pytest.mark.slow
def test_outputs_are_those_that_were_kept(tmp_path):
    # Where a change is meant: python tools/write_golden_outputs.py, and say in the commit why.
    if KEPT["libraries"] != libraries():
        pytest.skip(f"other libraries than {KEPT['libraries']}: last bits of outputs may differ")
    now = digests(tmp_path)
    names = KEPT["outputs"].keys() | now.keys()
    assert not [name for name in sorted(names) if KEPT["outputs"].get(name) != now.get(name)]
