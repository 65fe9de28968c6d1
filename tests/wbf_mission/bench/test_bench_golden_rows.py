"""A small benchmark whose results change only with a behaviour number."""

import copy
import json
import subprocess
import sys

import pytest
import write_golden_rows
from write_golden_rows import TABLE, changes

from wbf_mission.version import BEHAVIOUR

KEPT = json.loads(TABLE.read_text())


def test_the_golden_rows_are_of_these_numbers():
    # After raising a number: python tools/write_golden_rows.py.
    assert KEPT["behaviour"] == BEHAVIOUR


@pytest.mark.slow
def test_results_change_only_with_a_number(tmp_path):
    out = tmp_path / "now.json"
    subprocess.run([sys.executable, write_golden_rows.__file__, "--out", out], check=True)
    assert not list(changes(KEPT, json.loads(out.read_text())))


def test_a_change_is_found_to_the_bit_or_nearly():
    name = next(iter(KEPT["rows"]))
    now = copy.deepcopy(KEPT)
    now["rows"][name]["score"] *= 1.0 + 1e-9
    assert [text.split(": ")[1].split()[0] for text in changes(KEPT, now)] == ["score"]
    now["libraries"] = {**now["libraries"], "numpy": "another"}
    assert not list(changes(KEPT, now))
    now["rows"][name]["path_length_m"] *= 1.0 + 1e-5
    del now["rows"][list(KEPT["rows"])[1]]
    assert len(list(changes(KEPT, now))) == 2
