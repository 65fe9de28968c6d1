"""Telemetry that ground stations show."""

import pytest

from mission.link.codec.dialect import mavlink as m
from tests.support.peer import Peer
from wbf_mission.addons.telemetry.extra import TelemetryExtra

TOLD_IN_FLIGHT = m.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_every_message_can_be_requested_and_survives_the_wire(autopilot):
    peer = Peer(autopilot)
    (extra,) = (extra for extra in peer.vehicle.extras if isinstance(extra, TelemetryExtra))
    assert len(extra.builders) == 20
    for message_id in extra.builders:
        found = peer.asked(message_id)
        assert (found is None) == (message_id == TOLD_IN_FLIGHT)
    assert peer.result(512, TOLD_IN_FLIGHT) == m.MAV_RESULT_ACCEPTED
