"""The companion computer's camera of the examples: the whole loop, with pictures made for the test."""

import importlib.util
import io
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from stand_in import LONG_S, Nobody, scenario, stand_in

from geo import get_farm
from mission.outcome import Outcome
from sim_vehicle.host.server import Server
from wbf_mission import LiveLink
from wbf_mission.addons.companion.pictures import PictureCamera
from wbf_mission.flight import fly
from wbf_mission.run.resolve import make_environment

FILE = Path(__file__).parents[2] / "docs" / "examples" / "companion_camera.py"
LEAVES = {1.0: (60, 150, 50), 0.5: (200, 190, 40), 0.0: (95, 60, 30)}  # healthy, sick, lost
SOIL = (120, 115, 110)


@pytest.fixture(scope="module")
def example():
    spec = importlib.util.spec_from_file_location("companion_camera", FILE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def picture_of(health, rng, share=0.6):
    """A leaf of one colour, with noise, on grey soil: a JPEG file."""
    pixels = np.empty((48, 64, 3))
    pixels[:] = SOIL
    pixels[:, : round(64 * share)] = LEAVES[health]
    noisy = np.clip(pixels + rng.normal(0.0, 8.0, pixels.shape), 0, 255).astype(np.uint8)
    file = io.BytesIO()
    Image.fromarray(noisy).save(file, "JPEG", quality=85)
    return file.getvalue()


@pytest.mark.parametrize("share", [0.15, 1.0])
@pytest.mark.parametrize("health", LEAVES)
def test_colours_tell_the_health_of_a_leaf(example, health, share):
    assert example.classify(picture_of(health, np.random.default_rng(3), share)) == {"tylcv": health}
    assert example.classify(picture_of(health, np.random.default_rng(3), 0.02)) == {}


def test_a_command_takes_the_picture_and_may_know_the_place(example):
    here = SimpleNamespace(latitude_e7=280500000, longitude_e7=-821500000)
    words = f'{sys.executable} -c \'print("{{latitude}} {{longitude}}", end="")\''
    assert example.shoot(words, here) == b"28.05 -82.15"


def test_the_whole_loop_with_pictures(example):
    """Pictures of what grows where the camera fires come out as the environment's own values."""
    chosen = scenario(autopilot="px4")
    farm = get_farm(chosen.farm.name)
    truth, rng = make_environment(chosen, farm), np.random.default_rng(7)

    def take(exposure):
        x, y = farm.cell_of(*farm.frame.from_wgs84(exposure.latitude_e7 / 1e7, exposure.longitude_e7 / 1e7))
        inside = 0 <= x < farm.width_cells and 0 <= y < farm.height_cells
        health = float(truth.sample(chosen.farm.day, np.array([x]), np.array([y]))[0, 0]) if inside else 1.0
        return picture_of(health, rng)

    notes = []
    with stand_in(autopilot="px4") as (url, _):
        camera = PictureCamera(take, example.classify, note=notes.append)
        with Server([camera], [url]) as server:
            thread = threading.Thread(target=server.run, daemon=True)
            thread.start()
            try:
                result = fly(chosen, by=LiveLink(url, Nobody(), agreed=True))
            finally:
                server.stop()
                thread.join(LONG_S)
    seen = result.observations
    assert result.outcome is Outcome.COMPLETED and not notes
    assert camera.image_count > 20 and len(seen) >= 0.9 * camera.image_count
    tylcv = truth.sample(chosen.farm.day, seen.x.astype(np.int64), seen.y.astype(np.int64))[:, 0]
    assert np.array_equal(seen.values[:, 0], tylcv) and len(np.unique(tylcv)) > 1
    assert np.isnan(seen.values[:, 1:]).all()
