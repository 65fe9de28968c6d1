"""A camera of real pictures: what is taken where, what is told of it, and what goes wrong."""

import threading

import numpy as np
import pytest

from mission.link.codec.dialect import mavlink as m
from wbf_mission.addons.companion.pictures import PictureCamera

AUTOPILOT = (1, 1)


def heard(message, source=AUTOPILOT):
    message._header = m.MAVLink_header(message.id, 0, 0, 0, 0, *source)
    return message


def position(time_ms, east_m=0.0):
    longitude = round(-82.15e7 + east_m * 102.0)
    return heard(m.MAVLink_global_position_int_message(time_ms, 280500000, longitude, 0, 10000, 0, 0, 0, 0))


def shot(sequence):
    given = (0.0, 0.0, 1.0, float(sequence), 0.0, 0.0, 0.0)
    return heard(m.MAVLink_command_long_message(1, 100, m.MAV_CMD_IMAGE_START_CAPTURE, 0, *given))


def readings(messages):
    """Image numbers and the first cell's values."""
    arrays = [one for one in messages if one.get_type() == "DEBUG_FLOAT_ARRAY"]
    return [(int(one.data[0]), [round(v, 3) for v in one.data[3:6]]) for one in arrays]


def all_of(camera):
    """What is told until nothing waits."""
    messages = []
    for now_s in np.arange(0.0, 200.0, 0.05):
        messages += camera.poll(float(now_s))
        if not camera.waiting:
            return messages
        threading.Event().wait(0.005)
    raise AssertionError("something still waits")


def taken(camera, count):
    camera.receive(position(100), 0.0)
    messages = []
    for k in range(count):
        messages += camera.receive(shot(k + 1), 0.1)
    return messages + all_of(camera)


def test_pictures_are_taken_at_once_and_told_in_order_however_slow_the_classifier_is():
    release, seen = threading.Event(), []

    def classify(picture):
        release.wait(20.0)
        return {"tylcv": picture / 10.0}

    camera = PictureCamera(lambda exposure: seen.append(exposure) or len(seen), classify)
    camera.receive(position(100), 0.0)
    messages = [one for k in range(3) for one in camera.receive(shot(k + 1), 0.1)]
    assert len(seen) == 3 and camera.waiting == 3 and not readings(messages)
    assert camera.poll(1.0) and camera.next_deadline() <= 1.05  # a heartbeat goes out meanwhile
    release.set()
    told = readings(all_of(camera))
    assert [(number, values[0]) for number, values in told] == [(0, 0.1), (1, 0.2), (2, 0.3)]
    assert np.isnan([values[1:] for _, values in told]).all()
    assert camera.image_count == 3 and camera.next_deadline() >= 2.0


def test_the_last_pictures_are_told_before_the_camera_ends():
    camera = PictureCamera(lambda exposure: 1, lambda picture: {"soil": 0.25})
    camera.receive(position(100), 0.0)
    told = camera.receive(shot(1), 0.1)
    told += camera.goodbye()
    assert [number for number, _ in readings(told)] == [0]
    assert told[-1].get_type() == "HEARTBEAT" and told[-1].system_status == m.MAV_STATE_POWEROFF


def test_a_picture_is_told_again_when_it_is_asked_for():
    camera = PictureCamera(lambda exposure: 1, lambda picture: {"soil": 0.25})
    first = readings(taken(camera, 1))
    given = (float(m.MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    again = camera.receive(
        heard(m.MAVLink_command_long_message(1, 100, m.MAV_CMD_REQUEST_MESSAGE, 0, *given)), 9.0
    )
    assert str(readings(again)) == str(first)


@pytest.mark.parametrize(
    ("take", "classify", "text"),
    [
        (lambda e: 1 / 0, lambda p: {}, "picture 1 was not taken: ZeroDivisionError"),
        (lambda e: 1, lambda p: 1 / 0, "a picture was not understood: ZeroDivisionError"),
        (lambda e: 1, lambda p: {"rust": 0.5}, "field 'rust' is not one of tylcv, ccr, soil"),
        (lambda e: 1, lambda p: {"soil": 0.5, "ccr": 1.5}, "ccr is 1.5, not in 0..1"),
        (lambda e: 1, lambda p: {"soil": [0.5, 0.5]}, "a picture was not understood: ValueError"),
        (lambda e: 1, lambda p: {"soil": "wet"}, "a picture was not understood: ValueError"),
        (lambda e: 1, lambda p: None, "a picture was not understood: AttributeError"),
    ],
)
def test_what_fails_is_said_and_an_image_without_readings(take, classify, text):
    notes = []
    camera = PictureCamera(take, classify, note=notes.append)
    ((number, values),) = readings(taken(camera, 1))
    assert number == 0 and np.isnan(values).all()
    (note,) = notes
    assert text in note and "\n" not in note


def test_a_footprint_of_cells_has_a_value_each():
    shown = {"soil": [0.1, 0.2, 0.3, 0.4], "ccr": 1.0}
    camera = PictureCamera(lambda exposure: 1, lambda picture: shown, footprint_cells=2)
    (array,) = [one for one in taken(camera, 1) if one.get_type() == "DEBUG_FLOAT_ARRAY"]
    values = np.array(array.data[3:15]).reshape(4, 3)
    assert array.data[1] == 2.0
    assert values[:, 2] == pytest.approx([0.1, 0.2, 0.3, 0.4]) and (values[:, 1] == 1.0).all()
    assert np.isnan(values[:, 0]).all()
