"""The lists of parameters that the real autopilots have: names, types, defaults, documented ranges."""

import math

import pytest

from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import flight_procedures, with_autopilot
from sim_vehicle.autopilot.parameters import reference_parameters
from sim_vehicle.errors import VehicleError


def test_px4s_defaults_are_in_their_ranges():
    for parameter in reference_parameters("px4"):
        assert parameter.low <= parameter.value <= parameter.high, parameter.name
        assert parameter.low < parameter.high, parameter.name


def test_px4_has_the_ranges_that_its_sources_have():
    table = {parameter.name: parameter for parameter in reference_parameters("px4")}
    assert len(table) == 874
    assert sum(math.isfinite(p.low) or math.isfinite(p.high) for p in table.values()) == 645
    assert (table["RC7_MIN"].low, table["RC7_MIN"].high, table["RC7_MIN"].unit) == (800.0, 1500.0, "us")
    assert (table["CA_ROTOR11_KM"].low, table["CA_ROTOR11_KM"].high) == (-1.0, 1.0)
    assert (table["EKF2_TAU_VEL"].low, table["EKF2_TAU_VEL"].high) == (-math.inf, 1.0)


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.parametrize("vehicle", ["quad", "wing", "rover"])
def test_the_numbers_that_parameters_name_are_those_of_the_motion(autopilot, vehicle):
    spec = with_autopilot(get_vehicle(vehicle), autopilot)
    procedures = flight_procedures(spec)
    dynamics = procedures.motion(spec, None, 0.0).dynamics
    known = set(dynamics.limits.names).union(*(kind.names for _, kind in dynamics.own if kind is not None))
    named = [one.law for one in procedures.parameters.values() if one.law]
    assert len(named) == len(set(named)) > 0
    assert set(named) <= known


def test_a_misspelt_parameter_of_motion_is_answered_with_the_nearest_name():
    quad = get_vehicle("quad")
    with pytest.raises(VehicleError, match=r"no parameter MPC_XY_CRUSE .* \(is MPC_XY_CRUISE meant\?\)$"):
        with_autopilot(quad, "px4", {"MPC_XY_CRUSE": 3.0})
    with pytest.raises(VehicleError, match=r"px4 has no parameter ZZ that moves the vehicle$"):
        with_autopilot(quad, "px4", {"ZZ": 3.0})
