"""The commands that list, show, draw and save farms."""

import json
from pathlib import Path

import pytest
from command_line import run


def test_farm_list_show_draw_save(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    code, text, _ = run(capsys, "farm", "list", "--json")
    assert code == 0
    assert [farm["name"] for farm in json.loads(text)] == [
        "miniberry-10",
        "miniberry-30",
        "miniberry-100",
        "waterberry",
    ]
    code, text, _ = run(capsys, "farm", "show", "miniberry-30", "--json")
    assert json.loads(text)["owner_cells"] == 900
    picture, copy = tmp_path / "farm.png", tmp_path / "farm.geojson"
    assert run(capsys, "farm", "draw", "miniberry-30", "--out", str(picture))[0] == 0
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert run(capsys, "farm", "save", "miniberry-30", "--out", str(copy))[0] == 0
    assert run(capsys, "plan", "--farm", str(copy), "--budget", "200m")[0] == 0
