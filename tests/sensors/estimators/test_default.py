import pytest

from geo.farms import get_farm
from sensors.estimators import default_estimator, estimator_names


@pytest.mark.parametrize(
    ("farm", "expected"),
    [
        ("miniberry-10", "epidemic"),
        ("miniberry-30", "epidemic"),
        ("miniberry-100", "epidemic"),
        ("waterberry", "gp"),
    ],
)
def test_the_default_is_epidemic_up_to_128_by_128_cells_and_gp_beyond(farm, expected):
    assert default_estimator(get_farm(farm)) == expected
    assert expected in estimator_names()


def test_fields_that_epidemic_does_not_know_are_estimated_by_gp():
    farm = get_farm("miniberry-30")
    assert default_estimator(farm, ("tylcv", "soil")) == "gp"
    assert default_estimator(farm, ("tylcv", "ccr", "soil", "nitrogen")) == "gp"
