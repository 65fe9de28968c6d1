"""A companion computer's camera: takes pictures at the mission's points, and sends the health of the leaves.

Run it beside the autopilot, with its link and a command that writes a picture to its standard output:
    python companion_camera.py udpin:0.0.0.0:14540 "rpicam-jpeg -n -t 1 -o -"
"""

import io
import shlex
import subprocess
import sys

import numpy as np
from PIL import Image

from sim_vehicle.host.server import Server
from wbf_mission.addons.companion.pictures import PictureCamera


def shoot(command, exposure):
    """Return a JPEG or PNG picture; {latitude} and {longitude} in the command are filled in."""
    place = {"latitude": exposure.latitude_e7 / 1e7, "longitude": exposure.longitude_e7 / 1e7}
    words = [word.format(**place) for word in shlex.split(command)]
    return subprocess.run(words, capture_output=True, check=True, timeout=10.0).stdout  # noqa: S603


def classify(picture):
    """Classify a picture by its colours: green is healthy, yellow sick, brown lost. Put your network here."""
    red, green, blue = np.moveaxis(np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"), float), 2, 0)
    leaf = np.maximum(red, green) > 1.3 * blue  # neither sky nor a sheet of plastic
    if leaf.mean() < 0.05:
        return {}
    yellow = leaf & (red > 0.8 * green) & (green > 100.0)
    brown = leaf & (red > green) & (green <= 100.0)
    return {"tylcv": 0.0 if brown.sum() > leaf.sum() / 2 else 0.5 if yellow.sum() > leaf.sum() / 2 else 1.0}


if __name__ == "__main__":
    link, command = sys.argv[1:]
    camera = PictureCamera(lambda exposure: shoot(command, exposure), classify, note=print)
    with Server([camera], [link]) as server:
        server.run()  # until Ctrl-C
