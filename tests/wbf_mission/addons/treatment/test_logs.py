"""Logs of autopilots and folders of pictures: where the camera was."""

import math

import numpy as np
import pytest
from flight_logs import UTC_S, write_dataflash, write_picture, write_telemetry, write_ulog
from hypothesis import given
from hypothesis import strategies as st

from wbf_mission.addons.treatment import logs
from wbf_mission.addons.treatment.logs import LogError, read_track
from wbf_mission.addons.treatment.logs.track import LONGEST_GAP_S

NAN = math.nan
FIXES = [(10.0 + k, -28.05 + 1e-5 * k, 151.5 + 2e-5 * k) for k in range(21)]
IMAGES = [(7, 12.5, -28.0500001, 151.5000002), (8, 14.0, -28.0499, 151.5002)]
TRIGGERS = [(7, 12.5, NAN, NAN), (8, 14.0, NAN, NAN)]
WRITERS = {"bin": write_dataflash, "ulg": write_ulog, "tlog": write_telemetry}


@pytest.fixture(params=WRITERS)
def write(request, tmp_path):
    # Told by content: the name says nothing.
    return lambda *args, **how: WRITERS[request.param](tmp_path / "flight.log", *args, **how)


def has_the_fixes(track):
    time_s, latitude_deg, longitude_deg = np.transpose(FIXES)
    return (
        np.allclose(track.boot_s, time_s)
        and np.allclose(track.utc_s, UTC_S + time_s, atol=2e-3)
        and np.allclose(track.latitude_deg, latitude_deg, atol=1e-7)
        and np.allclose(track.longitude_deg, longitude_deg, atol=1e-7)
    )


def test_every_log_tells_positions_on_both_clocks(write):
    track = read_track(write(FIXES, IMAGES))
    assert has_the_fixes(track)
    for time_s in (12.5, UTC_S + 12.5):
        latitude, longitude = track.at(np.array([time_s]))
        assert np.allclose([latitude[0], longitude[0]], [-28.05 + 2.5e-5, 151.5 + 5e-5], atol=5e-8)
    assert track.images.index.tolist() == [7, 8]
    assert np.allclose(track.of_images(), np.transpose(IMAGES)[2:], atol=1e-7)


@pytest.mark.parametrize("kind", ["ulg", "tlog"])
def test_a_bare_trigger_is_placed_by_its_time(kind, tmp_path):
    latitude, longitude = read_track(WRITERS[kind](tmp_path / "x", FIXES, TRIGGERS)).of_images()
    assert np.allclose(latitude, [-28.05 + 2.5e-5, -28.05 + 4e-5], atol=2e-7)
    assert np.allclose(longitude, [151.5 + 5e-5, 151.5 + 8e-5], atol=2e-7)


@pytest.mark.parametrize("kind", ["ulg", "tlog"])
def test_images_that_failed_are_none(kind, tmp_path):
    images = [*((*one, 1) for one in IMAGES), (9, 15.0, -28.0, 151.5, 0)]
    track = read_track(WRITERS[kind](tmp_path / "x", FIXES, images))
    assert track.images.index.tolist() == [7, 8]
    assert np.allclose(track.images.latitude_deg, [row[2] for row in IMAGES], atol=1e-7)


def test_a_receiver_without_a_3d_fix_is_not_believed(tmp_path):
    bad = (9.5, -27.0, 150.0, 2)
    track = read_track(write_dataflash(tmp_path / "x.bin", [bad, *FIXES], with_pos=False))
    assert len(track.boot_s) == len(FIXES)
    assert "from the satellite receiver" in track.notes[0]


def test_outside_the_log_and_in_gaps_nothing_is_told(write):
    late = FIXES[-1][0] + LONGEST_GAP_S + 1.0
    track = read_track(write([*FIXES, (late, -28.0, 151.0)]))
    asked = np.array([9.9, FIXES[0][0], FIXES[-1][0], FIXES[-1][0] + 1.0, late, late + 0.1])
    assert np.isfinite(track.at(asked)[0]).tolist() == [False, True, True, False, True, False]


def test_positions_between_fixes_do_not_leave_the_date_line(write):
    fixes = [(10.0 + k, -17.0, y) for k, y in enumerate((179.9997, 179.9999, -179.9999, -179.9997, 179.9999))]
    longitude = read_track(write(fixes)).at(np.array([10.5, 11.0, 11.25, 11.75, 12.5, 13.75]))[1]
    expected = [179.9998, 179.9999, 179.99995, -179.99995, -179.9998, 179.9998]
    assert np.allclose(longitude, expected, atol=1e-7)


def test_a_clock_that_goes_back_or_is_missing_is_an_error(tmp_path):
    again = [*FIXES, *((one[0] - 9.0, *one[1:]) for one in FIXES)]
    first = write_telemetry(tmp_path / "a.tlog", FIXES).read_bytes()
    second = write_telemetry(tmp_path / "b.tlog", [(one[0] - 9, *one[1:]) for one in FIXES]).read_bytes()
    (tmp_path / "c.tlog").write_bytes(first + second)
    track = read_track(tmp_path / "c.tlog")
    assert len(track.boot_s) == len(again)
    with pytest.raises(LogError, match="since boot goes back in the telemetry log; give times on another"):
        track.at(np.array([12.0]))
    write_picture(tmp_path / "a.jpg", 1.0, 2.0, utc=((1, 2, 3), "2026:05:01"))
    with pytest.raises(
        LogError, match="folder of pictures has no positions with a time since boot; give times in UTC"
    ):
        read_track(tmp_path).at(np.array([12.0]))


def test_positions_of_a_receiver_without_a_fix_are_left_out(write):
    assert len(read_track(write([(9.0, 0.0, 0.0), *FIXES])).boot_s) == len(FIXES)


def test_the_track_is_one_vehicles(tmp_path):
    one = write_telemetry(tmp_path / "1", FIXES, IMAGES).read_bytes()
    two = write_telemetry(tmp_path / "2", [(1.0, 5.0, 5.0)], [(9, 1.0, 5.0, 5.0)], system=2).read_bytes()
    (tmp_path / "both.tlog").write_bytes(one + two)
    track = read_track(tmp_path / "both.tlog")
    assert len(track.boot_s) == len(FIXES)
    assert track.images.index.tolist() == [7, 8]
    assert track.notes == ("positions and images are read for vehicle 1 only; other vehicles in the log: 2",)


@pytest.mark.parametrize("receiver", ["1.13", "1.14"])
def test_without_a_global_position_px4s_receiver_is_taken(receiver, tmp_path):
    bad = [(9.0, -27.0, 150.0, 2), (9.5, 0.0, 0.0, 3)]
    path = write_ulog(tmp_path / "x", [*bad, *FIXES], TRIGGERS, receiver=receiver, with_position=False)
    track = read_track(path)
    assert has_the_fixes(track)
    assert track.notes == (
        "the log has no vehicle_global_position: the positions come from the satellite receiver (GPS)",
    )
    latitude, _ = track.of_images()
    assert np.allclose(latitude, [-28.05 + 2.5e-5, -28.05 + 4e-5], atol=2e-7)


def test_a_log_that_breaks_off_is_read_up_to_the_break(write, tmp_path):
    path = write(FIXES, IMAGES)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(0.8 * len(whole))])
    track = read_track(path)
    assert 3 < len(track.boot_s) <= len(FIXES)
    assert np.allclose(track.boot_s, [row[0] for row in FIXES[: len(track.boot_s)]])


def dji(form, latitude, longitude, name="GpsLongitude"):
    """XMP as DJI's drones write it: attributes, or elements after a program has changed it."""
    values = {"AbsoluteAltitude": "+52.30", "GpsLatitude": f"{latitude:+.9f}", name: f"{longitude:+.9f}"}
    texts = [form.format(name=f"drone-dji:{name}", value=value) for name, value in values.items()]
    space = b'xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/"'
    head = b'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:Description ' + space + b" "
    return head + " ".join(texts).encode() + b"/></x:xmpmeta>"


FORMS = ['{name}="{value}"', "{name} = '{value}'", "<{name}>{value}</{name}>", "<{name}> {value} </{name}>"]


@given(
    st.sampled_from(FORMS),
    st.floats(-89.0, 89.0).filter(lambda value: abs(value) > 1e-3),
    st.floats(-179.0, 179.0).filter(lambda value: abs(value) > 1e-3),
    st.sampled_from(["GpsLongitude", "GpsLongtitude", "GPSLongitude"]),
    st.sampled_from(["JPEG", "TIFF"]),
)
def test_pictures_of_dji_have_their_places_in_xmp(tmp_path_factory, form, latitude, longitude, name, kind):
    folder = tmp_path_factory.mktemp("pictures")
    suffix = {"JPEG": "jpg", "TIFF": "tif"}[kind]
    write_picture(folder / f"DJI_0001.{suffix}", kind=kind, xmp=dji(form, latitude, longitude, name))
    track = read_track(folder)
    assert track.notes == ()
    assert track.images.latitude_deg[0] == pytest.approx(latitude, abs=1e-8)
    assert track.images.longitude_deg[0] == pytest.approx(longitude, abs=1e-8)


def test_exif_goes_before_xmp_and_what_is_no_place_is_named(tmp_path):
    write_picture(tmp_path / "a.jpg", 1.0, 2.0, xmp=dji(FORMS[0], 3.0, 4.0))
    write_picture(tmp_path / "b.jpg", 0.0, 0.0, xmp=dji(FORMS[0], 3.0, 4.0))
    for k, (latitude, longitude) in enumerate([(0.0, 0.0), (91.0, 4.0), (3.0, 181.0)]):
        write_picture(tmp_path / f"c{k}.jpg", xmp=dji(FORMS[0], latitude, longitude))
    for k, xmp in enumerate([b"", b"\0" * 99, b'drone-dji:GpsLatitude="', b'drone-dji:GpsLatitude="+1.5" ']):
        write_picture(tmp_path / f"d{k}.jpg", xmp=xmp)
    track = read_track(tmp_path)
    assert track.images.latitude_deg[:2].tolist() == [1.0, 3.0]
    assert np.isnan(track.images.latitude_deg[2:]).all()
    assert track.notes == ("7 of 9 pictures have no position: c0.jpg, c1.jpg, c2.jpg, d0.jpg, d1.jpg, ...",)
    for one in ("a.jpg", "b.jpg"):
        (tmp_path / one).unlink()
    with pytest.raises(LogError, match=r"7 of 7 pictures have no position: c0\.jpg, .*; give pictures with"):
        read_track(tmp_path)


def test_pictures_tell_places_and_utc(tmp_path):
    write_picture(tmp_path / "B.JPG", -28.05, 151.5, utc=((2, 0, 30.5), "2026:05:01"))
    write_picture(tmp_path / "a.tif", 28.05, -82.15, taken=("2026:05:01 04:00:00", "+02:00"), kind="TIFF")
    write_picture(tmp_path / "c.jpeg")
    (tmp_path / "d.jpg").write_bytes(b"\xff\xd8 no picture")
    (tmp_path / "notes.txt").write_text("not a picture")
    track = read_track(tmp_path)
    assert track.images.names == ("B.JPG", "a.tif", "c.jpeg")
    assert np.allclose(track.images.latitude_deg[:2], [-28.05, 28.05], atol=1e-8)
    assert np.allclose(track.images.longitude_deg[:2], [151.5, -82.15], atol=1e-8)
    assert track.images.utc_s[:2].tolist() == [UTC_S + 30.5, UTC_S]
    assert np.isnan(track.of_images()[0]).tolist() == [False, False, True]
    assert track.notes[0].startswith("1 of 4 pictures cannot be read, the first d.jpg: ")
    assert track.notes[1:] == ("1 of 4 pictures have no position: c.jpeg",)


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda p: p.write_bytes(b"hello, this is text"), "is not a known kind of log; give a .tlog"),
        (lambda p: None, "cannot be read: no such file"),
        (lambda p: p.mkdir(), "holds no pictures"),
        (lambda p: p.write_bytes(b"ULog\x01\x12\x35\x01"), "is no PX4 log that can be read"),
        (lambda p: p.write_bytes(b"ULog\x01\x12\x35\x01" + bytes(90)), "the PX4 log has no position"),
        (lambda p: write_dataflash(p, []), "the ArduPilot log has no position"),
        (lambda p: p.write_bytes(bytes(8) + b"\xfd" + bytes(50)), "holds no MAVLink message"),
    ],
)
def test_what_is_no_log_is_told_in_a_line(make, told, tmp_path, capfd):
    path = tmp_path / "flight"
    make(path)
    with pytest.raises(LogError, match=told) as caught:
        read_track(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("length", [0, 2, 3, 9])
@pytest.mark.parametrize("fast", ["0", "1"])
def test_a_format_without_a_length_does_not_stop_the_reader(length, fast, tmp_path, monkeypatch, capfd):
    monkeypatch.setenv("PYMAVLINK_FAST_INDEX", fast)
    path = write_dataflash(tmp_path / "x.bin", FIXES)
    data = bytearray(path.read_bytes())
    pos = data.index(b"\xa3\x95\x80\x02")
    data[pos + 4] = length
    path.write_bytes(bytes(data) + b"\xa3\x95\x02" * 50)
    with pytest.raises(LogError, match=r"x\.bin"):
        read_track(path)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("formats", "told"),
    [
        ([b"a:b[60000] x;", b"b:float[60000] y;"], "more than 4096 numbers"),
        ([b"a:b x;", b"b:a y;"], "nested too deeply"),
    ],
)
def test_types_of_px4_that_hold_each_other_without_end_are_refused(formats, told, tmp_path):
    with pytest.raises(LogError, match=told):
        read_track(write_ulog(tmp_path / "x.ulg", FIXES, formats=formats))


@given(
    st.sampled_from(["ulg", "bin", "tlog", "jpg"]),
    st.lists(st.tuples(st.floats(0.0, 1.0), st.binary(min_size=1, max_size=4)), max_size=6),
    st.floats(0.1, 1.0),
)
def test_a_damaged_log_is_read_or_refused_in_a_line(tmp_path_factory, kind, changes, part):
    folder = tmp_path_factory.mktemp("damaged")
    path = folder / f"x.{kind}"
    if kind == "jpg":
        write_picture(path, xmp=dji(FORMS[0], 3.0, 4.0))
    elif kind == "ulg":
        write_ulog(path, FIXES, IMAGES, receiver="1.14", with_position=False)
    else:
        WRITERS[kind](path, FIXES, IMAGES)
    data = bytearray(path.read_bytes())
    for at, new in changes:
        start = int(at * len(data))
        data[start : start + len(new)] = new
    path.write_bytes(data[: int(part * len(data))])
    try:
        read_track(folder if kind == "jpg" else path)
    except LogError as error:
        assert str(error).startswith(str(folder)) and "\n" not in str(error) and len(str(error)) < 600


def test_pictures_are_not_decoded(tmp_path):
    # A header that claims two billion pixels; nothing of them is there.
    write_picture(tmp_path / "a.jpg", 1.0, 2.0)
    data = bytearray((tmp_path / "a.jpg").read_bytes())
    frame = data.index(b"\xff\xc0")
    data[frame + 5 : frame + 9] = b"\xb0\x00\xb0\x00"
    (tmp_path / "a.jpg").write_bytes(bytes(data))
    with pytest.raises(LogError, match=r"1 of 1 pictures cannot be read, the first a\.jpg: .*pixels"):
        read_track(tmp_path)


def test_a_log_beyond_the_limit_is_refused_before_it_is_read(write, monkeypatch):
    assert logs.MAX_LOG_BYTES == 2**30
    path = write(FIXES)
    size = path.stat().st_size
    monkeypatch.setattr(logs, "MAX_LOG_BYTES", size)
    assert len(read_track(path).latitude_deg) == len(FIXES)
    monkeypatch.setattr(logs, "MAX_LOG_BYTES", size - 1)
    with pytest.raises(LogError, match=r"flight\.log: cannot be read: it is larger than [0-9.e-]+ MiB"):
        read_track(path)
