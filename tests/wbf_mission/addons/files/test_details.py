"""Details of parameters for editors."""

from sim_vehicle.autopilot.parameters import reference_parameters
from wbf_mission.addons.files.details import parameter_details


def test_all_of_px4s_parameters_have_a_group_and_their_values_fit():
    details = parameter_details("px4", "sim_vehicle.autopilot")
    for parameter in reference_parameters("px4"):
        known = details[parameter.name]
        assert known.group
        assert (known.low, known.high) == (parameter.low, parameter.high)
        assert not (known.values and known.bits)
        numbers = [number for number, _ in known.values]
        assert numbers == sorted(set(numbers)), parameter.name
        assert not numbers or parameter.value in numbers, parameter.name
        assert all(parameter.low <= number <= parameter.high for number in numbers), parameter.name
    assert sum(bool(known.values or known.bits) for known in details.values()) == 238
    assert sum(known.reboot for known in details.values()) == 67
