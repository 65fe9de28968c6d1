"""Pictures over MAVLink: what was read arrives, whatever happens to the messages."""

from __future__ import annotations

import math
import random
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sweeps import sweep

from geo import get_farm
from mission.link.codec.dialect import mavlink
from sensors.camera.layout import LEAF_NAME, LeafLayout
from sensors.camera.wire import ObservationAssembler
from sensors.fields import PAPER_FIELDS

FARM = get_farm("miniberry-100")
LAYOUT = LeafLayout.of(PAPER_FIELDS.names)
FLOAT32 = st.floats(width=32, allow_infinity=False)


def wire(message: Any, system_id: int = 1, component_id: int = 100) -> Any:
    sender, receiver = mavlink.MAVLink(None, system_id, component_id), mavlink.MAVLink(None)
    return receiver.parse_buffer(message.pack(sender))[0]


def image(index: int, lat_e7: int, lon_e7: int, time_us: int, result: int = 1, **source: int) -> Any:
    message = mavlink.MAVLink_camera_image_captured_message(
        time_us // 1000,
        0,
        0,
        lat_e7,
        lon_e7,
        40000,
        10000,
        (0.5**0.5, 0.0, -(0.5**0.5), 0.0),
        index,
        result,
        b"",
    )
    return wire(message, **source)


def readings(
    index: int, time_us: int, data: list[float], name: bytes = LEAF_NAME.encode(), **source: int
) -> Any:
    padded = data + [0.0] * (58 - len(data))
    return wire(mavlink.MAVLink_debug_float_array_message(time_us, name, index & 0xFFFF, padded), **source)


def place(ix: int, iy: int) -> tuple[int, int]:
    latitude_deg, longitude_deg = FARM.frame.to_wgs84(*FARM.cell_centre(ix, iy))
    return round(latitude_deg * 1e7), round(longitude_deg * 1e7)


def picture(
    index: int, ix: int, iy: int, time_us: int, values: list[list[float]], side: int = 1, **source: int
) -> list[Any]:
    parts = [readings(index, time_us, data, **source) for data in LAYOUT.pack(index, side, values)]
    return [image(index, *place(ix, iy), time_us, **source), *parts]


@given(
    st.lists(
        st.tuples(st.integers(0, 99), st.integers(0, 99), st.lists(FLOAT32, min_size=3, max_size=3)),
        max_size=20,
    ),
    st.integers(0, 2**31 - 100),
    st.integers(0, 2**40),
    st.randoms(),
)
@settings(max_examples=60, deadline=None)
def test_what_was_read_arrives_bit_for_bit_in_any_order(
    shots: list[Any], first: int, start_us: int, chance: random.Random
) -> None:
    messages = []
    for k, (ix, iy, values) in enumerate(shots):
        messages += picture(first + k, ix, iy, start_us + k * 38_100, [values])
    chance.shuffle(messages)
    assembler = ObservationAssembler(FARM, day=6, start_s=start_us / 1e6)
    for message in messages:
        assembler.add(message)
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
def test_loss_and_duplication(count: int, data: st.DataObject) -> None:
    assembler = ObservationAssembler(FARM, day=0)
    whole, seen_any = set(), []
    for k in range(count):
        halves = picture(k, k % 100, 7, 1_000_000 + k * 50_000, [[k, 0.5, 1.0]])
        copies = [data.draw(st.integers(0, 3)) for _ in halves]
        for half, times in zip(halves, copies, strict=True):
            for _ in range(times):
                assembler.add(half)
        if all(copies):
            whole.add(k)
        seen_any.append(copies)
    seen = assembler.take()
    assert seen.values[:, 0].tolist() == sorted(whole)
    assert seen.x.tolist() == [k % 100 for k in sorted(whole)]
    statistics = assembler.statistics
    assert statistics.images == statistics.observations == len(whole)
    assert statistics.duplicates == sum(max(times - 1, 0) for copies in seen_any for times in copies)
    if whole:
        inner = {k for k in range(min(whole), max(whole)) if k not in whole}
        assert inner <= set(assembler.missing())
        assert statistics.lost == len(inner)


def test_missing_pictures_are_named_and_heal() -> None:
    assembler = ObservationAssembler(FARM, day=0)
    sent = [picture(k, 3, 3, k * 100_000, [[1.0, 1.0, 0.5]]) for k in range(6)]
    for k in (0, 1, 4):
        for message in sent[k]:
            assembler.add(message)
    assembler.add(sent[5][0])
    assert assembler.missing() == [2, 3, 5]
    assert assembler.statistics.lost == 2
    for k in (2, 3, 5):
        for message in sent[k]:
            assembler.add(message)
    assert assembler.missing() == []
    assert assembler.statistics.lost == 0
    assert assembler.take().time_s.tolist() == pytest.approx([0, 0.1, 0.2, 0.3, 0.4, 0.5])


@pytest.mark.parametrize("side", [2, 3, 4, 5, 9])
def test_wide_footprints(side: int) -> None:
    values = [[float(k), float("nan"), 0.25] for k in range(side * side)]
    messages = picture(0, 50, 60, 5_000_000, values, side)
    assert len(messages) == 1 + math.ceil(side * side / LAYOUT.cells_per_array)
    assembler = ObservationAssembler(FARM, day=2)
    for message in reversed(messages):
        assert len(assembler.take()) == 0
        assembler.add(message)
    seen = assembler.take()
    assert seen.values[:, 0].tolist() == list(range(side * side))
    assert np.isnan(seen.values[:, 1]).all()
    lowest = 50 - (side - 1) // 2
    assert seen.x.tolist() == [lowest + k // side for k in range(side * side)]
    assert seen.y.tolist() == [lowest + 10 + k % side for k in range(side * side)]
    assert (seen.time_s == 5.0).all()


def test_cells_off_the_farm_and_blind_cells_are_no_observations() -> None:
    assembler = ObservationAssembler(FARM, day=0)
    nan = float("nan")
    for message in picture(0, 0, 0, 0, [[nan] * 3] * 2 + [[nan, nan, nan], [1.0, nan, nan]], 2):
        assembler.add(message)
    for message in picture(1, -1, 5, 10_000, [[0.5, 0.5, 0.5]]):
        assembler.add(message)
    seen = assembler.take()
    assert (seen.x.tolist(), seen.y.tolist()) == ([1], [1])
    assert assembler.statistics.off_farm == 4


def test_an_index_beyond_float32_pairs_still() -> None:
    index = 2**24 + 1
    assembler = ObservationAssembler(FARM, day=0)
    for message in picture(index, 1, 2, 77_000_123, [[0.1, 0.2, 0.3]]):
        assembler.add(message)
    seen = assembler.take()
    assert seen.values.tolist() == np.array([[0.1, 0.2, 0.3]], np.float32).tolist()
    assert seen.time_s.tolist() == [77.000123]


def test_a_camera_that_starts_anew_is_heard() -> None:
    assembler = ObservationAssembler(FARM, day=0)
    for k, time_us in ((10, 0), (11, 50_000), (0, 9_000_000), (1, 9_050_000), (10, 9_500_000)):
        for message in picture(k, 4, 4, time_us, [[1.0, 1.0, 1.0]]):
            assembler.add(message)
    assert len(assembler.take()) == 5
    assert assembler.statistics.duplicates == 0


def test_only_the_chosen_camera() -> None:
    assembler = ObservationAssembler(FARM, day=0, system_id=2, component_id=100)
    for source in ({"system_id": 1}, {"system_id": 2, "component_id": 101}, {"system_id": 2}):
        for message in picture(0, 4, 4, 0, [[1.0, 1.0, 1.0]], **source):
            assembler.add(message)
    assert len(assembler.take()) == 1
    assert assembler.statistics.duplicates == 0


def test_other_messages_are_ignored() -> None:
    assembler = ObservationAssembler(FARM, day=0)
    assembler.add(wire(mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 0, 3)))
    assembler.add(readings(0, 0, [1.0, 1.0, 0.0], name=b"OTHER"))
    assert assembler.statistics == type(assembler.statistics)()


NAN, INF = float("nan"), float("inf")


@pytest.mark.parametrize(
    "data",
    [
        [0.0, 0.0, 0.0],
        [0.0, NAN, 0.0],
        [0.0, INF, 0.0],
        [0.0, 1.5, 0.0],
        [0.0, 1e30, 0.0],
        [0.0, 1.0, -1.0],
        [0.0, 1.0, 1.0],
        [0.0, 1.0, NAN],
        [0.0, 5.0, 7.0],
        [0.0, 1.0, 0.0, INF, 0.0, 0.0],
        [0.0, 1.0, 0.0, 0.0, 0.0, -INF],
    ],
)
def test_nonsense_is_counted(data: list[float]) -> None:
    assembler = ObservationAssembler(FARM, day=0)
    assembler.add(image(0, *place(1, 1), 0))
    assembler.add(readings(0, 0, data))
    assert assembler.statistics.malformed == 1
    assert len(assembler.take()) == 0


def test_impossible_and_failed_pictures() -> None:
    assembler = ObservationAssembler(FARM, day=0)
    assembler.add(image(0, 950_000_000, 0, 0))
    assembler.add(image(1, 0, -2_000_000_000, 0))
    assembler.add(image(2, *place(1, 1), 0, result=0))
    assembler.add(image(3, *place(1, 1), 0, result=-1))
    statistics = assembler.statistics
    assert (statistics.malformed, statistics.failed) == (2, 2)


def test_disagreeing_parts() -> None:
    assembler = ObservationAssembler(FARM, day=0)
    parts = LAYOUT.pack(0, 5, [[1.0, 1.0, 1.0]] * 25)
    assembler.add(readings(0, 0, parts[0]))
    assembler.add(readings(0, 0, [0.0, 6.0, 18.0]))
    assert assembler.statistics.malformed == 1


def test_memory_is_bounded() -> None:
    assembler = ObservationAssembler(FARM, day=0)
    lat_e7, lon_e7 = place(1, 1)
    template = image(0, lat_e7, lon_e7, 0)
    for k in range(5000):
        template.image_index, template.time_boot_ms = k * 7, k * 40
        assembler.add(template)
    assert len(assembler.missing()) <= 65_536 + 1024
    assert assembler.statistics.unpaired == 5000 - 1024
    template.image_index = 2**31 - 1
    template.time_boot_ms += 1
    assembler.add(template)
    assert len(assembler.missing()) <= 65_536 + 1024


@given(
    st.lists(
        st.tuples(
            st.booleans(),
            st.integers(-(2**31), 2**31 - 1),
            st.integers(-(2**31), 2**31 - 1),
            st.integers(0, 3),
            st.integers(0, 3000),
            st.lists(st.floats(width=32), min_size=6, max_size=6),
        ),
        max_size=30,
    )
)
@settings(max_examples=80, deadline=None)
def test_anything_may_arrive(messages: list[Any]) -> None:
    assembler = ObservationAssembler(FARM, day=0)
    for is_image, lat_e7, lon_e7, index, time_us, data in messages:
        assembler.add(
            image(index, lat_e7, lon_e7, time_us)
            if is_image
            else readings(index, time_us, [index, 1.0, 0.0, *data])
        )
    seen = assembler.take()
    assert ((seen.x >= 0) & (seen.x < 100) & (seen.y >= 0) & (seen.y < 100)).all()
