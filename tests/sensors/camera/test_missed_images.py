"""Images that were taken while nothing was heard: they are missed by the camera's own count."""

import pytest

from geo.farms import get_farm
from mission.link.codec.dialect import mavlink as m
from sensors.camera.layout import LeafLayout
from sensors.camera.wire import ObservationAssembler

FARM = get_farm("miniberry-10")
FIELDS = ("tylcv", "ccr", "soil")


def image(index, boot_ms):
    latitude, longitude = FARM.frame.to_wgs84(1.0, 1.0)
    return m.MAVLink_camera_image_captured_message(
        boot_ms,
        0,
        0,
        round(latitude * 1e7),
        round(longitude * 1e7),
        0,
        0,
        (0.5**0.5, 0.0, -(0.5**0.5), 0.0),
        index,
        1,
        b"",
    )


def send(assembler, index, boot_ms=None):
    boot_ms = 1000 * index if boot_ms is None else boot_ms
    assembler.add(image(index, boot_ms))
    for data in LeafLayout.of(FIELDS).pack(index, 1, [[1.0, 0.5, 0.25]]):
        data += [0.0] * (58 - len(data))
        assembler.add(m.MAVLink_debug_float_array_message(1000 * boot_ms, b"WBF_LEAF", index, data))


@pytest.fixture
def assembler():
    return ObservationAssembler(FARM, day=3, fields=FIELDS)


def test_images_before_the_first_that_is_heard_are_missed_only_after_a_silence(assembler):
    send(assembler, 5)
    assert assembler.missing() == []
    late = ObservationAssembler(FARM, day=3, fields=FIELDS)
    late.expect_from_first()
    send(late, 5)
    assert late.missing() == [0, 1, 2, 3, 4] and late.missing(2) == [0, 1]
    assert late.statistics.lost == 5


@pytest.mark.parametrize(("first", "lost"), [(0, []), (2, [0, 1]), (30, list(range(22, 30)))])
def test_a_few_images_before_the_first_that_arrived_may_be_lost(assembler, first, lost):
    send(assembler, first)
    send(assembler, first + 1)
    assembler.expect_from_first()
    assert assembler.missing() == lost and assembler.statistics.lost == len(lost)
    for index in lost[:1]:
        send(assembler, index)
    assembler.expect_from_first()
    assert assembler.missing() == lost[1:], "not those that have arrived since"


def test_the_cameras_count_tells_what_came_after_the_last_that_was_heard(assembler):
    send(assembler, 0)
    assembler.expect(4)
    assert assembler.missing() == [1, 2, 3]
    for index in (2, 3, 1):
        send(assembler, index)
    assert assembler.missing() == [] and assembler.statistics.lost == 0
    assembler.expect(4)
    assembler.expect(2)
    assembler.expect(1 << 30)
    assert assembler.missing() == [], "a count that is old or cannot be is none"
    assert assembler.take().time_s.tolist() == [0.0, 1.0, 2.0, 3.0]


def test_images_of_an_earlier_flight_are_none_of_this_one(assembler):
    assembler.expect_from_first(since_s=100.0)
    assembler.expect(6)
    assert assembler.missing() == [0, 1, 2, 3, 4, 5]
    send(assembler, 5, 130_000)
    send(assembler, 3, 20_000)
    assert assembler.missing() == [4], "those before an old one are older"
    send(assembler, 4, 101_000)
    assert assembler.take().time_s.tolist() == [101.0, 130.0]
