"""Images over MAVLink: what was read arrives, whatever happens to the messages; what is missed is named."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sweeps import sweep

from geo import get_farm
from mission.link.codec.dialect import mavlink
from sensors.camera.layout import ARRAY_FLOATS, FIELDS_NAME, LEAF_NAME, Announcement, LeafLayout
from sensors.camera.wire import ObservationAssembler
from sensors.fields import PAPER_FIELDS

FARM = get_farm("miniberry-100")
LAYOUT = LeafLayout.of(PAPER_FIELDS.names)
FLOAT32 = st.floats(width=32, allow_infinity=False)
NAN, INF = float("nan"), float("inf")
names = st.lists(
    st.from_regex(r"[a-z][a-z0-9_]{0,23}", fullmatch=True), min_size=1, max_size=16, unique=True
).map(tuple)


def wire(message, system_id=1, component_id=100):
    sender, receiver = mavlink.MAVLink(None, system_id, component_id), mavlink.MAVLink(None)
    return receiver.parse_buffer(message.pack(sender))[0]


def image(index, lat_e7, lon_e7, time_us, result=1, **source):
    when_and_where = time_us // 1000, 0, 0, lat_e7, lon_e7, 40000, 10000
    down = (0.5**0.5, 0.0, -(0.5**0.5), 0.0)
    message = mavlink.MAVLink_camera_image_captured_message(*when_and_where, down, index, result, b"")
    return wire(message, **source)


def array(index, time_us, data, name=LEAF_NAME, **source):
    padded = data + [0.0] * (ARRAY_FLOATS - len(data))
    message = mavlink.MAVLink_debug_float_array_message(time_us, name.encode(), index & 0xFFFF, padded)
    return wire(message, **source)


def place(ix, iy):
    latitude_deg, longitude_deg = FARM.frame.to_wgs84(*FARM.cell_centre(ix, iy))
    return round(latitude_deg * 1e7), round(longitude_deg * 1e7)


def picture(index, ix, iy, time_us, values, side=1, layout=LAYOUT, **source):
    arrays = [array(index, time_us, data, layout.name, **source) for data in layout.pack(index, side, values)]
    return [image(index, *place(ix, iy), time_us, **source), *arrays]


def add(assembler, *messages):
    for message in messages:
        assembler.add(message)
    return assembler


def send(assembler, index, time_ms=None):
    time_us = 1_000_000 * index if time_ms is None else 1000 * time_ms
    add(assembler, *picture(index, 3, 3, time_us, [[1.0, 0.5, 0.25]]))


@pytest.fixture
def assembler():
    return ObservationAssembler(FARM, day=0)


shots = st.tuples(st.integers(0, 99), st.integers(0, 99), st.lists(FLOAT32, min_size=3, max_size=3))


@given(st.lists(shots, max_size=20), st.integers(0, 2**31 - 100), st.integers(0, 2**40), st.randoms())
@settings(max_examples=60, deadline=None)
def test_what_was_read_arrives_bit_for_bit_in_any_order(shots, first, start_us, chance):
    messages = []
    for k, (ix, iy, values) in enumerate(shots):
        messages += picture(first + k, ix, iy, start_us + k * 38_100, [values])
    chance.shuffle(messages)
    assembler = add(ObservationAssembler(FARM, day=6, start_s=start_us / 1e6), *messages)
    seen = assembler.take()
    kept = [(k, shot) for k, shot in enumerate(shots) if not all(map(math.isnan, shot[2]))]
    assert seen.x.tolist() == [ix for _, (ix, _, _) in kept]
    assert seen.y.tolist() == [iy for _, (_, iy, _) in kept]
    assert seen.time_s == pytest.approx([k * 0.0381 for k, _ in kept], abs=1e-3)
    assert (seen.day == 6).all()
    expected = np.array([values for _, (_, _, values) in kept], np.float32).reshape(-1, 3)
    np.testing.assert_array_equal(seen.values, expected)
    assert assembler.statistics.images == len(shots)
    assert assembler.missing() == []
    assert len(assembler.take()) == 0


@given(st.integers(1, 60), st.data())
@sweep(few=25, many=120)
def test_loss_and_duplication(count, data):
    assembler = ObservationAssembler(FARM, day=0)
    whole, duplicates = [], 0
    for k in range(count):
        halves = picture(k, k % 100, 7, 1_000_000 + k * 50_000, [[k, 0.5, 1.0]])
        copies = [data.draw(st.integers(0, 3)) for _ in halves]
        for half, times in zip(halves, copies, strict=True):
            add(assembler, *[half] * times)
            duplicates += max(times - 1, 0)
        whole += [k] * all(copies)
    seen = assembler.take()
    assert seen.values[:, 0].tolist() == whole
    assert seen.x.tolist() == [k % 100 for k in whole]
    statistics = assembler.statistics
    assert statistics.images == statistics.observations == len(whole)
    assert statistics.duplicates == duplicates
    if whole:
        inner = set(range(whole[0], whole[-1])) - set(whole)
        assert inner <= set(assembler.missing())
        assert statistics.lost == len(inner)


def test_cells_off_the_farm_and_blind_cells_are_no_observations(assembler):
    add(assembler, *picture(0, 0, 0, 0, [[NAN] * 3] * 3 + [[1.0, NAN, NAN]], 2))
    add(assembler, *picture(1, -1, 5, 10_000, [[0.5, 0.5, 0.5]]))
    seen = assembler.take()
    assert (seen.x.tolist(), seen.y.tolist()) == ([1], [1])
    assert assembler.statistics.off_farm == 4


def test_a_camera_that_starts_anew_is_heard(assembler):
    for index, time_ms in ((10, 0), (11, 50), (0, 9000), (1, 9050), (10, 9500)):
        send(assembler, index, time_ms)
    assert len(assembler.take()) == 5
    assert assembler.statistics.duplicates == 0


def test_only_the_readings_of_the_chosen_camera_count():
    assembler = ObservationAssembler(FARM, day=0, system_id=2, component_id=100)
    for source in ({"system_id": 1}, {"system_id": 2, "component_id": 101}, {"system_id": 2}):
        add(assembler, *picture(0, 4, 4, 0, [[1.0, 1.0, 1.0]], **source))
    add(assembler, array(0, 0, [1.0, 1.0, 0.0], "OTHER", system_id=2))
    assert len(assembler.take()) == 1
    assert (assembler.statistics.duplicates, assembler.statistics.malformed) == (0, 0)


@pytest.mark.parametrize(
    "data",
    [
        [0.0, NAN, 0.0],
        [0.0, 1.5, 0.0],
        [0.0, 1.0, -1.0],
        [0.0, 1.0, 1.0],
        [0.0, 5.0, 7.0],
        [0.0, 1.0, 0.0, INF, 0.0, 0.0],
    ],
)
def test_nonsense_is_counted(assembler, data):
    add(assembler, image(0, *place(1, 1), 0), array(0, 0, data))
    assert assembler.statistics.malformed == 1
    assert len(assembler.take()) == 0


def test_impossible_and_failed_pictures(assembler):
    add(assembler, image(0, 950_000_000, 0, 0), image(1, 0, -2_000_000_000, 0))
    add(assembler, image(2, *place(1, 1), 0, result=0), image(3, *place(1, 1), 0, result=-1))
    assert (assembler.statistics.malformed, assembler.statistics.failed) == (2, 2)


def test_disagreeing_parts(assembler):
    add(assembler, array(0, 0, LAYOUT.pack(0, 5, [[1.0, 1.0, 1.0]] * 25)[0]), array(0, 0, [0.0, 6.0, 18.0]))
    assert assembler.statistics.malformed == 1


def test_memory_is_bounded(assembler):
    template = image(0, *place(1, 1), 0)
    for k in range(5000):
        template.image_index, template.time_boot_ms = k * 7, k * 40
        assembler.add(template)
    assert len(assembler.missing()) <= 65_536 + 1024
    assert assembler.statistics.unpaired == 5000 - 1024
    template.image_index = 2**31 - 1
    template.time_boot_ms += 1
    assembler.add(template)
    assert len(assembler.missing()) <= 65_536 + 1024


whole = st.integers(-(2**31), 2**31 - 1)
numbers = st.lists(st.floats(width=32), min_size=6, max_size=6)


@given(
    st.lists(
        st.tuples(st.booleans(), whole, whole, st.integers(0, 3), st.integers(0, 3000), numbers), max_size=30
    )
)
@settings(max_examples=80, deadline=None)
def test_anything_may_arrive(messages):
    assembler = ObservationAssembler(FARM, day=0)
    for is_image, lat_e7, lon_e7, index, time_us, data in messages:
        if is_image:
            assembler.add(image(index, lat_e7, lon_e7, time_us))
        else:
            assembler.add(array(index, time_us, [index, 1.0, 0.0, *data]))
    seen = assembler.take()
    assert ((seen.x >= 0) & (seen.x < 100) & (seen.y >= 0) & (seen.y < 100)).all()


# Readings of any fields, whose names the camera tells


@sweep(few=30, many=200)
@given(names, st.integers(1, 4), st.randoms(use_true_random=False))
def test_readings_of_any_fields_arrive_bit_for_bit(fields, side, luck):
    values = np.array([[luck.random() for _ in fields] for _ in range(side * side)], np.float32)
    messages = picture(3, 4, 5, 5000, values.tolist(), side, LeafLayout.of(fields))
    luck.shuffle(messages)
    assembler = add(ObservationAssembler(FARM, day=6, fields=fields), *messages)
    seen = assembler.take()
    assert seen.fields == fields
    np.testing.assert_array_equal(seen.values, values)
    cells = np.argwhere(np.ones((side, side))) + np.array([4, 5]) - (side - 1) // 2
    np.testing.assert_array_equal(np.column_stack([seen.x, seen.y]), cells)
    assert assembler.mismatch() is None


@sweep(few=40, many=200)
@given(names, st.randoms(use_true_random=False))
def test_names_are_told_in_parts_in_any_order(fields, luck):
    heard = Announcement()
    parts = list(enumerate(LeafLayout.of(fields).announcement()))
    luck.shuffle(parts)
    assert all(heard.add(*part) for part in parts)
    assert heard.fields == (None if fields == PAPER_FIELDS.names else fields)


def test_the_benchmarks_fields_travel_as_they_always_did():
    assert (LAYOUT.name, LAYOUT.cells_per_array, LAYOUT.announcement()) == ("WBF_LEAF", 18, [])
    assert LAYOUT.pack(7, 1, [[1.0, 0.5, 0.25]]) == [[7.0, 1.0, 0.0, 1.0, 0.5, 0.25]]


def test_readings_of_other_fields_are_no_observations_and_said():
    four, other = ("tylcv", "ccr", "soil", "nitrogen"), ("tylcv", "ccr", "soil", "rust")
    for expected, found in ((PAPER_FIELDS.names, four), (four, PAPER_FIELDS.names), (four, other)):
        messages = picture(3, 4, 5, 5000, [[0.5] * len(found)], layout=LeafLayout.of(found))
        assembler = add(ObservationAssembler(FARM, day=6, fields=expected), *messages)
        assert len(assembler.take()) == 0
        assert assembler.statistics.other_fields == 1
        assert f"other fields than {', '.join(expected)}; give" in str(assembler.mismatch())
    for number, data in enumerate(LeafLayout.of(other).announcement()):
        assembler.add(array(number, 5000, data, FIELDS_NAME))
    assert "the camera senses tylcv, ccr, soil, rust instead of tylcv" in str(assembler.mismatch())


@sweep(few=30, many=200)
@given(st.integers(0, 65535), st.lists(st.floats(width=32), min_size=58, max_size=58))
def test_an_announcement_may_be_anything(number, data):
    heard = Announcement()
    heard.add(number, data)
    heard.add(0, [2.0, data[0], 3.0, 97.0, 44.0, 98.0, *data[6:]])
    assert heard.fields in (None, ("a", "b"))


# Images that were taken while nothing was heard: they are missed by the camera's own count


def test_images_before_the_first_that_is_heard_are_missed_only_after_a_silence(assembler):
    send(assembler, 5)
    assert assembler.missing() == []
    late = ObservationAssembler(FARM, day=3)
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
