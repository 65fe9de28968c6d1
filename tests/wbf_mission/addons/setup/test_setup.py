"""Set-up commands: outputs, compasses, gyroscopes."""

from dataclasses import replace

import pytest

from mission.model import MissionItem
from mission.outcome import Outcome
from tests.support.peer import HOME, Peer


def test_servos_relays_and_compasses_of_ardupilot():
    peer = Peer("ardupilot")
    assert [peer.result(183, float(channel), 1500.0) for channel in (0, 4, 5, 16, 17)] == [4, 4, 0, 0, 4]
    assert "ServoRelayEvent: Channel 4 is already in use" in peer.texts()
    assert [peer.result(181, number, 1.0) for number in (0.0, 1.0)] == [0, 4]
    assert [peer.result(number) for number in (42424, 42425, 42426)] == [0, 4, 0]
    assert peer.result(187, 0.5) == 3
    px4 = Peer("px4")
    assert [px4.result(number, 5.0) for number in (181, 183, 42424, 42425, 42426)] == [3] * 5
    assert px4.result(187, 0.5) == 0


def test_px4_reports_the_progress_of_a_gyro_calibration():
    peer = Peer("px4")
    assert peer.result(241, 1.0) == 0
    peer.wait(4.0)
    texts = [text for text in peer.texts() if text.startswith("[cal]")]
    progress = [f"[cal] progress <{share}>" for share in range(0, 100, 10)]
    assert texts == ["[cal] calibration started: 2 gyro", *progress, "[cal] calibration done: gyro"]
    other = Peer("ardupilot")
    assert other.result(241, 1.0) == 0
    other.wait(4.0)
    assert not any("[cal]" in text for text in other.texts())


@pytest.mark.parametrize(
    ("autopilot", "commands"),
    [("ardupilot", (181, 183, 207, 211, 216, 218, 223, 531)), ("px4", (187, 200, 204, 211, 531, 42600))],
)
def test_a_mission_may_switch_outputs(autopilot, commands):
    peer = Peer(autopilot)
    outputs = [MissionItem(command, param1=1.0) for command in commands]
    up = MissionItem(22, 3, x=HOME.latitude_deg, y=HOME.longitude_deg, z=10.0)
    assert (
        peer.upload([up, MissionItem(208), replace(up, command=16)]).type == 3
    )  # A parachute ends the flight
    assert peer.upload([up, *outputs, replace(up, command=16), MissionItem(20)]).type == 0
    assert peer.result(400, 1.0) == 0
    assert peer.result(300) == 0
    peer.wait(60.0)
    assert peer.vehicle.outcome is Outcome.COMPLETED
    assert peer.vehicle.pilot.parameters.fence_enable == 1  # At first 0 on ArduPilot
