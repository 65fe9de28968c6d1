"""Set-up commands: outputs, compasses, gyroscopes."""

from tests.support.peer import Peer


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
