"""Details of parameters for editors."""

from sim_vehicle.autopilot.parameters import reference_parameters
from wbf_mission.addons.files.extra import parameter_details


def test_all_of_px4s_parameters_have_a_group_and_their_values_fit():
    details = parameter_details("px4", "sim_vehicle.autopilot")
    for parameter in reference_parameters("px4"):
        known = details[parameter.name]
        assert known["group"]
        assert (known["min"], known["max"]) == (parameter.low, parameter.high)
        assert not ("values" in known and "bitmask" in known)
        numbers = [choice["value"] for choice in known.get("values", ())]
        assert numbers == sorted(set(numbers)), parameter.name
        assert not numbers or parameter.value in numbers, parameter.name
        assert all(parameter.low <= number <= parameter.high for number in numbers), parameter.name
    assert sum("values" in known or "bitmask" in known for known in details.values()) == 238
    assert sum(bool(known["rebootRequired"]) for known in details.values()) == 67
