"""The images that a camera took: numbered, kept for a while, told as often as somebody asks."""

import math

import numpy as np
import pytest

from sensors.fields import PAPER_FIELDS
from sim_vehicle.camera.image_memory import RING_IMAGES, STORAGE_MIB, ImageMemory
from sim_vehicle.camera.trigger import Exposure

HERE = Exposure(
    time_us=7_000_000,
    latitude_e7=280_500_000,
    longitude_e7=-821_500_000,
    altitude_mm=40_000,
    relative_altitude_mm=10_000,
    heading_cdeg=9000,
)
SEEN = np.array([[1.0, 0.5, 0.25]], np.float32)


def filled(number: int) -> ImageMemory:
    memory = ImageMemory(PAPER_FIELDS.names, 1)
    for _ in range(number):
        memory.add(HERE, SEEN)
    return memory


def test_the_last_images_are_kept_and_older_ones_are_not() -> None:
    memory = filled(RING_IMAGES + 3)
    assert memory.count == RING_IMAGES + 3
    assert memory.find(2.0) is None
    assert [image.number for at in (3.0, RING_IMAGES + 2.0) if (image := memory.find(at))] == [
        3,
        RING_IMAGES + 2,
    ]


def test_an_image_is_found_as_it_was_taken() -> None:
    memory = ImageMemory(PAPER_FIELDS.names, 3)
    readings = np.linspace(-0.1, 1.1, 27, dtype=np.float32).reshape(9, 3)
    readings[4, 1] = np.nan
    memory.add(HERE, readings - 1.0)
    taken = memory.add(HERE._replace(time_us=2**40, longitude_e7=-1_800_000_000), readings)
    found = memory.find(1.0)
    assert found is not None
    assert found[:2] == taken[:2]
    assert np.array_equal(found.values, readings, equal_nan=True)
    assert np.array_equal(taken.values, readings, equal_nan=True)


@pytest.mark.parametrize("index", [-1.0, 0.5, 10.0, 2.0**31, math.inf, math.nan])
def test_what_is_no_number_of_an_image_finds_none(index: float) -> None:
    assert filled(10).find(index) is None


def test_an_image_is_told_the_same_again() -> None:
    memory = filled(2)
    image = memory.find(1.0)
    assert image is not None
    first, second = (memory.report(image, None) for _ in range(2))
    assert [m.to_dict() for m in first] == [m.to_dict() for m in second]
    captured, readings = first
    assert (captured.image_index, captured.time_boot_ms, captured.time_utc) == (1, 7000, 0)
    assert list(captured.q) == pytest.approx([0.5, 0.5, -0.5, 0.5])
    assert (readings.array_id, readings.time_usec) == (1, 7_000_000)
    assert len(readings.data) == 58
    assert memory.report(image, 10**15)[0].time_utc == 7_000_000 + 10**15


def test_formatting_forgets_and_may_count_anew() -> None:
    memory = filled(5)
    memory.clear(count_anew=False)
    assert (memory.count, memory.find(4.0)) == (5, None)
    memory.clear(count_anew=True)
    assert (memory.count, memory.used_mib) == (0, 0.0)


def test_the_storage_is_full_at_most() -> None:
    memory = filled(1)
    assert 0.0 < memory.used_mib < 0.01
    memory.count = 10**9
    assert memory.used_mib == STORAGE_MIB
