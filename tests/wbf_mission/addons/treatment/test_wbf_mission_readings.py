"""Tables of readings, joined to the log of the flight."""

import numpy as np
import pytest
from flight_logs import UTC_S, write_picture, write_telemetry

from geo import get_farm
from sensors.dynamics.continuous import Measured
from sensors.errors import ObservationError
from sensors.fields import ALL_CROPS, PAPER_FIELDS, Field, FieldSet
from wbf_mission.addons.treatment.logs import LogError, read_track
from wbf_mission.addons.treatment.readings import join, read_readings

FARM = get_farm("miniberry-30")
NAMES = PAPER_FIELDS.names
CELLS = [(3, 4), (10, 20), (29, 0)]


def places(cells=CELLS):
    x, y = FARM.cell_centre(*np.array(cells).T)
    return list(zip(*FARM.frame.to_wgs84(x, y), strict=True))


@pytest.fixture
def table(tmp_path):
    def write(text, name="readings.csv"):
        (tmp_path / name).write_text(text, encoding="utf-8")
        return tmp_path / name

    return write


@pytest.fixture
def track(tmp_path):
    """A vehicle that stands over each cell for a second, and takes a picture there."""
    fixes = [(10.0 + k + part, *place) for k, place in enumerate(places()) for part in (0.0, 0.9)]
    images = [(100 + k, 10.5 + k, *place) for k, place in enumerate(places())]
    return read_track(write_telemetry(tmp_path / "x.tlog", fixes, images))


def test_image_numbers_that_begin_again_after_a_restart_are_refused(table, tmp_path):
    """Each flight has an image 100, at another place; image 101 is reported twice at one place."""
    (first, second, third) = places()
    fixes = [(10.0 + k + part, *place) for k, place in enumerate(places()) for part in (0.0, 0.9)]
    images = [(100, 10.5, *first), (101, 11.5, *second), (101, 11.5, *second), (100, 12.5, *third)]
    track = read_track(write_telemetry(tmp_path / "x.tlog", fixes, images))
    assert track.images.index.tolist() == [100, 101, 100]
    one = read_readings(table("image,tylcv\n101,1\n"), PAPER_FIELDS)
    assert cells_of(join(one, track, FARM, NAMES, 1, 6)[0]) == [CELLS[1]]
    both = read_readings(table("image,tylcv\n101,1\n100,0\n"), PAPER_FIELDS)
    with pytest.raises(ObservationError, match="image 100 is at several places in the telemetry log"):
        join(both, track, FARM, NAMES, 1, 6)


def cells_of(observations):
    return list(zip(observations.x.tolist(), observations.y.tolist(), strict=True))


@pytest.mark.parametrize(
    "keys",
    [
        ("image", ["102", "100", "101"]),
        ("time", ["12.5", "10.5", "11.5"]),
        ("time", [str(UTC_S + 12.5), str(UTC_S + 10.5), str(UTC_S + 11.5)]),
        ("time", ["2026-05-01T02:00:12.5Z", "2026-05-01T04:00:10.5+02:00", "2026-05-01 02:00:11.5"]),
        ("latitude,longitude", [f"{a!r},{b!r}" for a, b in np.array(places())[[2, 0, 1]].tolist()]),
    ],
)
def test_each_key_finds_the_cells(keys, table, track):
    name, values = keys
    rows = "".join(f"{key},{value},x\n" for key, value in zip(values, (0.9, 0.1, 0.5), strict=True))
    seen, notes = join(
        read_readings(table(f"{name},soil,remark\n{rows}"), PAPER_FIELDS), track, FARM, NAMES, 1, 6
    )
    assert notes == ()
    found = dict(zip(cells_of(seen), seen.values[:, 2].tolist(), strict=True))
    assert found == pytest.approx({CELLS[0]: 0.1, CELLS[1]: 0.5, CELLS[2]: 0.9})
    assert np.isnan(seen.values[:, :2]).all()
    if "latitude" not in name:
        assert cells_of(seen) == CELLS  # in the order of time
    assert seen.day.tolist() == [6, 6, 6]
    assert seen.time_s[0] == 0.0


@pytest.mark.parametrize(
    ("header", "swapped"),
    [
        ("lat,lon,soil", False),
        (" Longitude (deg) , Latitude [°] ,soil", True),
        ("GPSLongitude,GPSLatitude,soil", True),
        ("gps lon,gps-lat,soil", True),
        ("\ufefflat,lon,soil", False),
        ("lng,lat,latitude_note,soil", True),
    ],
)
def test_positions_are_found_however_their_columns_are_spelt(header, swapped, table):
    more = "," * (header.count(",") - 2)
    rows = "".join(
        f"{','.join(map(repr, map(float, place[::-1] if swapped else place)))}{more},0.5\n"
        for place in places()
    )
    readings = read_readings(table(f"{header}\n{rows}"), PAPER_FIELDS)
    assert readings.key == ("latitude", "longitude")
    seen, notes = join(readings, None, FARM, NAMES, 1, 6)
    assert (sorted(cells_of(seen)), notes) == (sorted(CELLS), ())


def test_pictures_are_found_by_name(tmp_path, table):
    folder = tmp_path / "pictures"
    folder.mkdir()
    for number, (latitude, longitude) in enumerate(places()):
        write_picture(folder / f"P{number}.JPG", latitude, longitude)
    written = table("name,tylcv,ccr\nDCIM\\p2.jpg,1,\nsub/P0.JPG,0.5,1\nP7.JPG,1,1\n")
    seen, notes = join(read_readings(written, PAPER_FIELDS), read_track(folder), FARM, NAMES, 1, 3)
    assert dict(zip(cells_of(seen), seen.values[:, 0].tolist(), strict=True)) == {
        CELLS[0]: 0.5,
        CELLS[2]: 1.0,
    }
    assert notes == ("1 of 3 readings are not in the log",)


def test_a_footprint_covers_the_cells_about_the_one_below(table):
    latitude, longitude = places([(0, 7)])[0]
    readings = read_readings(table(f"latitude,longitude,ccr\n{latitude},{longitude},0.5\n"), PAPER_FIELDS)
    seen, _ = join(readings, None, FARM, NAMES, 3, 6)
    assert sorted(cells_of(seen)) == [(x, y) for x in (0, 1) for y in (6, 7, 8)]
    assert set(seen.values[:, 1].tolist()) == {0.5}


def test_what_is_left_out_is_counted(table, track):
    (latitude, longitude), *_ = places()
    rows = ["12.5,1", "9,1", "13.5,1", "11.5,", "nonsense"]
    with pytest.raises(ObservationError, match=r"line 6: time: 'nonsense' is not a time"):
        read_readings(table("\n".join(["time,ccr", *rows])), PAPER_FIELDS)
    seen, notes = join(
        read_readings(table("\n".join(["time,ccr", *rows[:4]])), PAPER_FIELDS), track, FARM, NAMES, 1, 6
    )
    assert cells_of(seen) == [CELLS[2]]
    assert notes == ("2 of 4 readings are not in the log", "1 of 4 readings are empty")
    text = f"latitude,longitude,ccr\n{latitude},{longitude},1\n{latitude + 1},{longitude},1\n"
    _, notes = join(read_readings(table(text), PAPER_FIELDS), None, FARM, NAMES, 1, 6)
    assert notes == ("1 of 2 readings lie outside the farm miniberry-30",)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("tylcv\n1\n", "no column gives the place of a reading; give latitude and longitude, name"),
        ("time,nitrogen\n1,1\n", "no column is named after a field; give one or more of tylcv, ccr, soil"),
        ("time,tylcv\n", "holds no readings below its header"),
        (
            "latitude;longitude;tylcv\n1,5;2,5;1\n",
            "; separate the columns by commas, and write decimals with a",
        ),
        ("time,tylcv\n1,1\n2,-0.1\n", "line 3: tylcv is -0.1; values lie in 0..1"),
        ("time,tylcv\n1,inf\n", "line 2: tylcv is inf; values lie in 0..1"),
        ("time,tylcv\n1,sick\n", "line 2: tylcv: 'sick' is not a number; leave the cell empty"),
        ("time,tylcv\ninf,1\n", "line 2: time: inf is not finite"),
        ("image,tylcv\n1.5,1\n", "line 2: image: '1.5' is not a whole number"),
        ("name,tylcv\n,1\n", "line 2: name: is empty"),
        ("latitude,longitude,tylcv\n91,0,1\n", "line 2: latitude and longitude: 91, 0 is not a position"),
        ('time,tylcv\n"1,1\n', "is not a CSV line"),
    ],
)
def test_tables_that_make_no_sense_are_refused(text, told, table):
    path = table(text)
    with pytest.raises(ObservationError) as caught:
        read_readings(path, PAPER_FIELDS)
    assert str(caught.value).startswith(f"{path}: ")
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_key_needs_a_log_that_has_it(table, tmp_path, track):
    by_time = read_readings(table("time,ccr\n1,1\n"), PAPER_FIELDS)
    with pytest.raises(ObservationError, match=r"not its position: add the log \(--log\)"):
        join(by_time, None, FARM, NAMES, 1, 6)
    with pytest.raises(ObservationError, match=r"no reading is left: 1 of 1 readings are not in the log"):
        join(by_time, track, FARM, NAMES, 1, 6)
    named = read_readings(table("name,ccr\na.jpg,1\n"), PAPER_FIELDS)
    with pytest.raises(ObservationError, match="the telemetry log has no names of pictures"):
        join(named, track, FARM, NAMES, 1, 6)
    write_picture(tmp_path / "a.jpg", 1.0, 2.0)
    with pytest.raises(LogError, match="no positions with a time since boot"):
        join(by_time, read_track(tmp_path), FARM, NAMES, 1, 6)


def test_readings_are_in_the_unit_of_their_field(table):
    ph = Field("ph", Measured(), (ALL_CROPS,), default=0.5, unit="pH", range=(4.0, 9.0))
    fields = FieldSet((ph,))
    (place,) = places()[:1]
    head = f"latitude,longitude,ph\n{float(place[0])},{float(place[1])}"
    seen, _ = join(read_readings(table(f"{head},6.5\n"), fields), None, FARM, fields.names, 1, 6)
    assert seen.values[0, 0] == pytest.approx(0.5)
    with pytest.raises(ObservationError, match=r"line 2: ph is 0.5; values lie in 4..9"):
        read_readings(table(f"{head},0.5\n"), fields)
