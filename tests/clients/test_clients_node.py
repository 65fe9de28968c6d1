"""node-mavlink, where it is installed (`npm install node-mavlink`, and NODE_PATH to its `node_modules`)."""

import shutil
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).with_name("node_script.cjs")


@pytest.fixture(scope="module")
def node():
    path = shutil.which("node")
    if path is None:
        pytest.skip("node is not installed")
    if subprocess.run([path, "-e", "require('node-mavlink')"], capture_output=True).returncode:
        pytest.skip("node-mavlink is not installed")
    return path


def test_node_mavlink_reads_the_streams_and_sets_a_mode(fly, tools, node):
    flying = fly("ardupilot")
    words = [node, str(SCRIPT), str(tools.port_of(flying.urls[0]))]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "RawImu -1000\n" in done.stdout
    assert "CommandAck 176 0\n" in done.stdout
