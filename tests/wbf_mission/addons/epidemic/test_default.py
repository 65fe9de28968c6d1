"""Where epidemic is the default, and where it does not know the fields."""

from types import SimpleNamespace

import pytest

from geo.farms import get_farm
from sensors.estimators import default_estimator
from sensors.field_files import load_field_set
from wbf_mission.cli.app import main
from wbf_mission.scenario import families, load_scenario


def test_it_is_the_default_for_the_papers_fields_on_farms_up_to_128_by_128_cells():
    names = "miniberry-10", "miniberry-100", "waterberry"
    assert [default_estimator(get_farm(name)) for name in names] == ["epidemic", "epidemic", "gp"]
    square = SimpleNamespace(width_cells=128, height_cells=128)
    assert default_estimator(square, ["tylcv", "ccr", "soil"]) == "epidemic"


def test_it_is_in_the_families_whose_fields_it_knows():
    for family in families():
        fields = {load_field_set(load_scenario(name).farm.fields).names for name in family.scenarios}
        assert ("epidemic" in family.estimators) == (fields == {("tylcv", "ccr", "soil")})


@pytest.mark.parametrize(
    "options",
    ["--scenario WBF/Miniberry-30-Smooth-v1", "--farm miniberry-10 --vehicle ideal --fields tylcv,soil"],
)
def test_other_fields_are_refused_in_one_line(options, capsys):
    assert main(["fly", *options.split(), "--estimator", "epidemic"]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "estimator 'epidemic' needs exactly the fields tylcv, ccr, soil; this run has" in line
