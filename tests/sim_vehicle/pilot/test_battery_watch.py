"""Levels of the battery: by its charge, and by a voltage that stays low."""

import math
from types import SimpleNamespace

import pytest

from sim_vehicle.pilot.failsafe import BatteryWatch

PARAMETERS = SimpleNamespace(
    low_fraction=0.3,
    critical_fraction=0.2,
    emergency_fraction=0.1,
    low_voltage_v=14.0,
    critical_voltage_v=13.0,
    low_voltage_timer_s=10.0,
    low_voltage_source=0,
)


class Watched:
    """A battery whose charge and voltage are set by hand."""

    def __init__(self, *, by_voltage=True, **parameters):
        self.now_s = 0.0
        self.state = SimpleNamespace(battery=None)
        self.see(1.0, 16.0)
        self.parameters = SimpleNamespace(**{**vars(PARAMETERS), **parameters})
        self.watch = BatteryWatch(self, by_voltage=by_voltage)

    def see(self, fraction, voltage_v, rest_voltage_v=None):
        self.state.battery = SimpleNamespace(
            fraction=fraction,
            voltage_v=voltage_v,
            rest_voltage_v=voltage_v if rest_voltage_v is None else rest_voltage_v,
            depleted=fraction <= 0.0,
        )

    def after(self, seconds):
        self.now_s += seconds
        return self.watch.check()


@pytest.mark.parametrize(
    ("fraction", "level"), [(0.31, 0), (0.29, 1), (0.19, 2), (0.11, 2), (0.09, 3), (0.0, 3)]
)
def test_each_charge_has_its_level(fraction, level):
    watched = Watched(by_voltage=False)
    watched.see(fraction, 16.0)
    assert watched.after(1.0) == watched.watch.reported == watched.watch.level() == level
    assert watched.after(1.0) == 0, "told once"


def test_an_emergency_level_above_the_critical_one_counts_from_there():
    watched = Watched(by_voltage=False, emergency_fraction=0.25)
    watched.see(0.22, 16.0)
    assert watched.after(1.0) == 1
    watched.see(0.19, 16.0)
    assert watched.after(1.0) == 3


@pytest.mark.parametrize(("voltage_v", "level"), [(13.9, 1), (12.9, 2)])
def test_a_voltage_that_stays_low_is_told_after_its_time(voltage_v, level):
    watched = Watched()
    watched.see(0.9, voltage_v)
    assert [watched.after(seconds) for seconds in (1.0, 9.0, 1.0, 0.1)] == [0, 0, 0, level]
    assert f"{voltage_v:.2f} V" in watched.watch.describe(level)


def test_a_voltage_that_recovers_in_between_begins_again():
    watched = Watched()
    watched.see(0.9, 13.5)
    assert [watched.after(4.0), watched.after(4.0)] == [0, 0]
    watched.see(0.9, 15.0)
    assert watched.after(0.5) == 0
    watched.see(0.9, 13.5)
    assert [watched.after(seconds) for seconds in (4.0, 4.0, 4.0)] == [0, 0, 0]
    assert watched.after(4.0) == 1


def test_what_was_told_by_voltage_stays_until_the_next_arming():
    watched = Watched()
    watched.see(0.9, 12.0)
    watched.after(1.0)
    assert watched.after(11.0) == 2
    watched.see(0.9, 16.0)
    assert watched.after(1.0) == 0
    assert watched.watch.level() == 2
    watched.watch.reset()
    assert (watched.watch.level(), watched.watch.reported) == (0, 0)


def test_the_voltage_without_the_load_can_be_the_one_that_counts():
    for source, level in ((0, 1), (1, 0)):
        watched = Watched(low_voltage_source=source)
        watched.see(0.9, 13.5, rest_voltage_v=14.5)
        watched.after(1.0)
        assert watched.after(11.0) == level


def test_voltages_count_only_where_they_are_watched():
    for options in ({"by_voltage": False}, {"low_voltage_timer_s": 0.0}):
        watched = Watched(**options)
        watched.see(0.9, 11.0)
        assert [watched.after(20.0), watched.after(20.0)] == [0, 0]


def test_without_a_battery_or_after_its_end_there_is_nothing_to_tell():
    watched = Watched()
    watched.state.battery = None
    assert (watched.after(1.0), watched.watch.level()) == (0, 0)
    watched.see(0.0, 0.0)
    watched.watch.give_up()
    assert watched.after(math.inf) == 0
