"""Cameras by sensor and lens: published numbers, the geometry that follows, and files."""

import math
from dataclasses import replace

import pytest
from bad_files import complaint
from hypothesis import given
from hypothesis import strategies as st

from sensors.camera.optics import CameraModel, Imaging, camera_names, get_camera, read_camera
from sensors.errors import CameraError

P1 = get_camera("DJI-P1-35")


def test_published_ground_sampling_distances():
    assert 100.0 * P1.gsd_m(80.0) == pytest.approx(80.0 / 80.0, rel=0.01)  # DJI: metres over 80, in cm
    assert 100.0 * get_camera("micasense-rededge-p").gsd_m(120.0) == pytest.approx(7.7, rel=0.03)


@given(st.sampled_from(camera_names()), st.floats(2.0, 500.0), st.floats(0.0, 0.95), st.floats(0.0, 0.95))
def test_height_and_gsd_are_each_others_inverse_and_overlaps_hold(name, height, front, side):
    camera = get_camera(name)
    assert camera.source
    pitch = camera.sensor_width_mm / camera.image_width_px
    assert pitch == pytest.approx(camera.sensor_height_mm / camera.image_height_px, rel=0.015)
    assert camera.height_m(camera.gsd_m(height)) == pytest.approx(height)
    over = Imaging(camera, height, front, side)
    assert 1.0 - over.row_spacing_m / over.across_m == pytest.approx(side, abs=1e-9)
    assert 1.0 - over.image_distance_m / over.along_m == pytest.approx(front, abs=1e-9)
    upright = replace(over, portrait=True)
    assert (upright.across_m, upright.along_m) == (over.along_m, over.across_m)


def test_speed_is_limited_by_the_interval_and_by_blur():
    over = Imaging(P1, 80.0, 0.8, 0.7)
    assert over.interval_speed_m_s == pytest.approx(over.image_distance_m / 0.7)
    assert over.blur_speed_m_s == pytest.approx(over.gsd_m / 0.001)
    assert over.top_speed_m_s == min(over.interval_speed_m_s, over.blur_speed_m_s)
    fast = replace(over, camera=replace(P1, min_interval_s=0.0))
    assert fast.interval_speed_m_s == math.inf


FILE = """
sensor_width_mm = 10
sensor_height_mm = 7.5
focal_length_mm = 8.0
image_width_px = 4000
image_height_px = 3000
"""


def test_a_camera_of_ones_own(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(FILE)
    assert get_camera(str(path)) == CameraModel("mine", 10.0, 7.5, 8.0, 4000, 3000)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ("zoom = 3", "unknown key 'zoom'"),
        ("min_interval_s = -1.0", "min_interval_s -1 must be a finite number not below zero"),
        ("shutter_s = nan", "shutter_s nan must be a finite number above zero"),
        ("[", "it is not TOML"),
    ],
)
def test_files_that_are_no_cameras_are_refused_in_one_line(tmp_path, change, told):
    said = complaint(read_camera, tmp_path, FILE + change, CameraError)
    assert said.startswith("camera file ") and told in said


def test_unknown_names_and_impossible_overlaps_are_refused(tmp_path):
    with pytest.raises(CameraError, match="unknown camera 'p2': choose dji-mavic-3m-ms, "):
        get_camera("p2")
    with pytest.raises(CameraError, match="no such file"):
        get_camera(str(tmp_path / "none.toml"))
    with pytest.raises(CameraError, match=r"side_overlap 0\.99 is out of range"):
        Imaging(P1, 80.0, 0.8, 0.99)
    with pytest.raises(CameraError, match="image_width_px inf must be a finite number above zero"):
        replace(P1, image_width_px=10**400)
