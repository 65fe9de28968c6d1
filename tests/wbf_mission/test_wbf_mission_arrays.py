import zipfile

import numpy as np
import pytest
import zarr

from wbf_mission.results.storage import ArrayFileError, read_array, write_array

FIELDS = ("tylcv", "ccr", "soil")


@pytest.mark.parametrize("shape", [(3, 1, 1), (3, 30, 20), (2, 2100, 2100)])
def test_an_array_comes_back_bit_for_bit(tmp_path, shape):
    array = np.random.default_rng(1).random(shape, np.float32)
    array[0, : shape[1] // 2] = 1.0
    array[0, 0, 0] = np.nan
    path = tmp_path / "value.zarr.zip"
    write_array(path, array, FIELDS[: shape[0]])
    np.testing.assert_array_equal(read_array(path, shape).view(np.uint32), array.view(np.uint32))
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


def test_a_smooth_field_takes_a_quarter(tmp_path):
    x, y = np.meshgrid(np.linspace(0.0, 1.0, 1000), np.linspace(0.0, 1.0, 900), indexing="ij")
    smooth = (0.5 + 0.4 * np.sin(3.0 * x + 1.0) * np.cos(4.0 * y)).astype(np.float32)
    write_array(tmp_path / "a.zarr.zip", smooth[None], FIELDS[:1])
    assert (tmp_path / "a.zarr.zip").stat().st_size < 0.25 * smooth.nbytes


def test_other_programs_read_it_with_names(tmp_path):
    write_array(tmp_path / "a.zarr.zip", np.ones((3, 4, 5)), FIELDS)
    stored = zarr.open_array(zarr.storage.ZipStore(tmp_path / "a.zarr.zip"), mode="r")
    assert stored.attrs["fields"] == list(FIELDS)
    assert stored.metadata.dimension_names == ("field", "x", "y")
    assert stored.dtype == np.float32


def test_a_file_that_is_no_array_is_refused_by_name(tmp_path):
    path = tmp_path / "value.zarr.zip"
    with pytest.raises(ArrayFileError, match=r"value\.zarr\.zip"):
        read_array(path, (3, 4, 5))
    path.write_bytes(b"nothing")
    with pytest.raises(ArrayFileError, match="cannot be read"):
        read_array(path, (3, 4, 5))
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("zarr.json", '{"zarr_format": 3, "node_type": "array", "shape": "x"}')
    with pytest.raises(ArrayFileError, match="not an array"):
        read_array(path, (3, 4, 5))
    write_array(path, np.ones((3, 4, 5)), FIELDS)
    with pytest.raises(ArrayFileError, match=r"expected float32\[3, 5, 4\]"):
        read_array(path, (3, 5, 4))


def test_an_older_file_stays_when_writing_fails(tmp_path):
    path = tmp_path / "value.zarr.zip"
    write_array(path, np.ones((3, 4, 5)), FIELDS)
    before = path.read_bytes()
    with pytest.raises(TypeError):
        write_array(path, np.ones((3, 4, 5)), [object()])
    assert path.read_bytes() == before
    assert len(list(tmp_path.iterdir())) == 1
