"""Rounds of held-out environments."""

import datetime
import hashlib
import hmac
import json
import stat

import pytest
from bench_packs import SCENARIO, flown
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from msgspec import structs

from wbf_mission.addons.boards.sealed import (
    Secret,
    new_secret,
    opened,
    read_secret,
    require_seeds,
    write_round,
)
from wbf_mission.bench.rows import read_rows
from wbf_mission.cli.app import main
from wbf_mission.results.storage import ResultError
from wbf_mission.scenario import ScenarioError

NOW = datetime.datetime(2026, 1, 2, tzinfo=datetime.UTC)


def test_the_files_of_a_round(tmp_path):
    secret = new_secret(3, [SCENARIO], NOW)
    kept, published = write_round(secret, tmp_path / "round")
    assert (kept.name, published.name) == ("round.secret", "round.seal.json")
    assert stat.S_IMODE(kept.stat().st_mode) == 0o600
    assert read_secret(kept) == opened(published, kept) == secret
    seal = json.loads(published.read_text())
    assert (seal["environments"], seal["scenarios"]) == (3, [SCENARIO])
    assert seal["made"] == "2026-01-02T00:00:00+00:00"
    assert secret.secret not in published.read_text()
    with pytest.raises(ScenarioError, match="already exists"):
        write_round(secret, tmp_path / "round")


def test_seeds_are_derived_one_by_one():
    secret = new_secret(5, [], NOW)
    found = secret.seeds()
    assert len(set(found)) == 5
    assert all(0 <= one < 2**63 for one in found)
    key = bytes.fromhex(secret.secret)
    wanted = hmac.new(key, b"wbf-mission seed 1\n3", hashlib.sha256).digest()
    assert found[3] == int.from_bytes(wanted[:8], "big") // 2
    assert structs.replace(secret, environments=2).seeds() == found[:2]
    assert new_secret(5, [], NOW).seeds() != found


@pytest.mark.parametrize(
    "values",
    [{"environments": 4}, {"scenarios": []}, {"made": "2026-01-03T00:00:00+00:00"}, {"secret": "00" * 32}],
)
def test_a_seal_binds_all_of_the_round(values, tmp_path):
    secret = new_secret(3, [SCENARIO], NOW)
    _, published = write_round(secret, tmp_path / "round")
    other, _ = write_round(structs.replace(secret, **values), tmp_path / "other")
    with pytest.raises(ScenarioError, match="is not the secret of"):
        opened(published, other)


@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.binary(max_size=200) | st.sampled_from([b"", b"[]", b'{"secret": 1}', b"[" * 10_000]))
def test_other_files_are_refused(content, tmp_path):
    (tmp_path / "round.secret").write_bytes(content)
    with pytest.raises(ScenarioError, match=r"round\.secret: "):
        read_secret(tmp_path / "round.secret")


@pytest.mark.parametrize(
    ("values", "why"),
    [
        ({"secret": "00"}, "not 32 bytes"),
        ({"secret": "xy" * 32}, "not 32 bytes"),
        ({"environments": 0}, "with 0 environments"),
        ({"environments": 10**9}, "environments"),
        ({"format": 2}, "is of format 2"),
        ({"more": 1}, "more is unknown"),
    ],
)
def test_values_that_do_not_fit_are_told(values, why, tmp_path):
    kept, _ = write_round(new_secret(3, [], NOW), tmp_path / "round")
    kept.write_text(json.dumps(json.loads(kept.read_text()) | values))
    with pytest.raises(ScenarioError, match=why):
        read_secret(kept)


def test_rows_are_all_of_the_round(tmp_path):
    rows = read_rows(flown(tmp_path / "r", planners=["spiral"], seeds=2))
    secret = Secret(secret="ab" * 32, environments=2, scenarios=[SCENARIO], made="")
    first, second = secret.seeds()
    held = [structs.replace(row, seed=(first, second)[row.seed]) for row in rows]
    require_seeds(secret, held)
    for some in (held[:1], rows, [*held, rows[0]]):
        with pytest.raises(ResultError, match="of the round's 2 environments"):
            require_seeds(secret, some)
    with pytest.raises(ResultError, match="is not in the round"):
        require_seeds(structs.replace(secret, scenarios=["WBF/Miniberry-30-v1"]), held)


def test_a_round_from_its_seal_to_its_board(at_once, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["bench", "seal", "--environments", "2", "--scenarios", SCENARIO, "--out", "round"]) == 0
    run = ["--planners", "spiral,lawnmower", "--estimators", "point", "--out", "held"]
    assert main(["bench", "run", "--sealed", "round.secret", *run, "--quiet"]) == 0
    assert {row.seed for row in read_rows(tmp_path / "held")} == set(
        read_secret(tmp_path / "round.secret").seeds()
    )
    both = ["--seal", "round.seal.json", "--secret", "round.secret"]
    names = ["--name", "Held", "--by", "Me"]
    assert main(["bench", "submit", "held", *names, *both, "--verify", "1", "--quiet"]) == 0
    capsys.readouterr()
    assert main(["bench", "board", "held.zip", *both, "--json"]) == 0
    (table,) = json.loads(capsys.readouterr().out)["tables"]
    assert (table["held_out"], table["environments"]) == (True, 2)
    assert main(["bench", "run", "--sealed", "round.secret", "--seeds", "2", "--out", "x"]) == 2
    assert "leave out --seeds" in capsys.readouterr().err
    other = ["--scenarios", "WBF/Miniberry-30-v1"]
    assert main(["bench", "run", "--sealed", "round.secret", *other, "--out", "x"]) == 2
    assert "is not in the round" in capsys.readouterr().err
    assert main(["bench", "board", "held.zip", *both[:2]]) == 2
    assert "--seal and --secret belong together" in capsys.readouterr().err
    assert not (tmp_path / "x").exists()
