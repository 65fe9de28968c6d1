"""Where the vehicle was: how far it has flown while the flight goes on."""

import numpy as np
import pytest

from geo.frame import LocalFrame
from mission.ground.tracks import FlownLength, TrackRecorder
from mission.link.codec.dialect import mavlink as m

FRAME = LocalFrame(28.05, -82.15, rotation_deg=20.0)


def fix(number: int, x_m: float, y_m: float) -> m.MAVLink_global_position_int_message:
    latitude, longitude = FRAME.to_wgs84(x_m, y_m)
    return m.MAVLink_global_position_int_message(
        100 * number, round(1e7 * latitude), round(1e7 * longitude), 0, 5000, 0, 0, 0, 0
    )


@pytest.mark.parametrize("every", [1, 2, 7, 1000])
def test_the_length_grows_with_the_track_however_often_it_is_asked_for(every: int) -> None:
    places = np.cumsum(np.random.default_rng(3).normal(0.0, 2.0, (60, 2)), axis=0)
    tracks = TrackRecorder()
    flown = FlownLength(tracks, FRAME)
    assert flown.measure() == 0.0
    for number, (x_m, y_m) in enumerate(places):
        one = fix(number, x_m, y_m)
        tracks.on_position(one, one.time_boot_ms, is_rover=False)
        if number % every == 0:
            assert flown.measure() == pytest.approx(tracks.track(FRAME).length_m, rel=1e-12)
    assert flown.measure() == flown.measure() == pytest.approx(tracks.track(FRAME).length_m, rel=1e-12)
    assert flown.measure() == pytest.approx(np.hypot(*np.diff(places, axis=0).T).sum(), rel=1e-3)
