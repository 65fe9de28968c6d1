"""The local frame against independent geodesy."""

import math
import pickle

import numpy as np
import pyproj
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from geo import FarmError, LocalFrame

ORIGIN = (28.05, -82.15)
_NEAR_M = 2e-4
_SNAPPED_M = 9.1e-4  # PROJ returns the origin itself for positions within 1e-10 earth radii along each axis
METRES = st.floats(-3000.0, 3000.0)
FRAMES = st.builds(
    LocalFrame,
    st.floats(-70.0, 70.0),
    st.floats(-180.0, 180.0),
    st.floats(-100.0, 4000.0),
    st.floats(-360.0, 360.0),
)


@given(FRAMES, METRES, METRES)
def test_round_trip_is_far_below_a_millimetre(frame, x_m, y_m):
    back = frame.from_wgs84(*frame.to_wgs84(x_m, y_m))
    # PROJ maps what is within 1e-10 radians of the origin to the origin.
    assert back == pytest.approx((x_m, y_m), abs=1e-6 if math.hypot(x_m, y_m) > 2e-3 else 9e-4)


@given(FRAMES, METRES, METRES)
def test_distance_and_azimuth_are_the_geodesics(frame, x_m, y_m):
    latitude_deg, longitude_deg = frame.to_wgs84(x_m, y_m)
    azimuth_deg, _, distance_m = pyproj.Geod(ellps="WGS84").inv(
        frame.longitude_deg, frame.latitude_deg, longitude_deg, latitude_deg
    )
    angle = math.radians(90.0 - azimuth_deg - frame.rotation_deg)
    if math.hypot(x_m, y_m) < 2e-3:
        assert distance_m < 3e-3
        return
    assert distance_m == pytest.approx(math.hypot(x_m, y_m), abs=1e-6)
    assert distance_m * math.cos(angle) == pytest.approx(x_m, abs=1e-6)
    assert distance_m * math.sin(angle) == pytest.approx(y_m, abs=1e-6)


def test_axes():
    north = LocalFrame(*ORIGIN).to_wgs84(0.0, 100.0)
    assert north[0] > ORIGIN[0]
    assert north[1] == pytest.approx(ORIGIN[1], abs=1e-12)
    turned = LocalFrame(*ORIGIN, rotation_deg=90.0).to_wgs84(100.0, 0.0)
    assert turned == pytest.approx(north, abs=1e-12)
    scalar = LocalFrame(*ORIGIN).from_wgs84(28.06, -82.14)
    assert all(type(value) is float for value in scalar)


def test_the_date_line_is_no_border():
    frame = LocalFrame(-17.0, 179.9999)
    x_m, y_m = frame.from_wgs84(-17.0, -179.9999)
    assert x_m == pytest.approx(21.3, abs=0.1)
    assert abs(y_m) < 1e-3


def test_places_that_do_not_exist_are_not_finite():
    for frame in (LocalFrame(*ORIGIN), LocalFrame(*ORIGIN, rotation_deg=30.0)):
        assert not all(map(math.isfinite, frame.from_wgs84(214.0, 0.0)))
        x_m, _ = frame.from_wgs84(np.array([95.0, 28.0, np.nan]), np.array([0.0, -82.0, 0.0]))
        assert np.isfinite(x_m).tolist() == [False, True, False]


@pytest.mark.parametrize(
    "arguments",
    [(91.0, 0.0), (0.0, 181.0), (math.nan, 0.0), (0.0, math.inf), (0.0, 0.0, 1e6), (0, 0, 0, 400)],
)
def test_bad_origins_are_refused(arguments):
    with pytest.raises(FarmError, match="is outside"):
        LocalFrame(*arguments)


def test_equal_frames_are_equal_and_pickle():
    frame = LocalFrame(28, -82, 30, 10)
    assert frame == LocalFrame(28.0, -82.0, 30.0, 10.0)
    assert pickle.loads(pickle.dumps(frame)).to_wgs84(1.0, 2.0) == frame.to_wgs84(1.0, 2.0)


@example(0.0, 0.0, 6.103515625e-05)
@example(0.0, 0.00054, 0.00054)
@given(st.floats(-360.0, 360.0), st.floats(-500.0, 500.0), st.floats(-500.0, 500.0))
def test_directions_turn_with_the_axes(rotation_deg, east, north):
    assume(not _NEAR_M < math.hypot(east, north) < _SNAPPED_M)
    turned = LocalFrame(*ORIGIN, rotation_deg=rotation_deg)
    there = turned.from_wgs84(*LocalFrame(*ORIGIN).to_wgs84(east, north))
    assert turned.from_east_north(east, north) == pytest.approx(there, abs=_NEAR_M)
    x, y = turned.from_east_north(np.array([east, 0.0]), np.array([north, 1.0]))
    assert (x[0], y[0]) == pytest.approx(there, abs=_NEAR_M)
    assert math.hypot(x[1], y[1]) == pytest.approx(1.0)
