"""What is told when a vehicle refuses a plan, and what comes back of one that it keeps."""

from __future__ import annotations

from dataclasses import replace

import pytest
from transfer_network import Network

from mission.autopilots import ARDUPILOT, GENERIC, PX4
from mission.link.codec.dialect import mavlink
from mission.link.faults import Faults
from mission.model import GeoPoint, MissionItem, MissionType
from mission.transfer import (
    FailureReason,
    MissionServer,
    PlanState,
    StatusText,
    TransferFailed,
    UploadVerified,
    VerifiedUpload,
    compare_plans,
)
from mission.transfer.storage import as_read_back, as_stored

MISSION, FENCE, RALLY = MissionType
HOME = GeoPoint(28.05, -82.15, 30.0)
PLAN = tuple(MissionItem.waypoint(28.0 + k / 1000, -82.0, 10.0) for k in range(8))
OLD = tuple(MissionItem.waypoint(27.0 + k / 1000, -82.0, 20.0) for k in range(12))


def carry(upload, server):
    """Return the last event of an upload over a good link, and the vehicle's texts."""
    network = Network(server, Faults(), Faults())
    end = network.run(upload)
    return end, [event for event in network.server_events if isinstance(event, StatusText)]


def refusing(profile, refused, result, *, capacity=None):
    server = MissionServer(
        1,
        profile=profile,
        home=HOME,
        capacity=capacity,
        validator=lambda item: result if item.x == refused.x else 0,
    )
    server.set_plan(MISSION, OLD)
    return server


@pytest.mark.parametrize("profile", [PX4, ARDUPILOT, GENERIC])
@pytest.mark.parametrize("number", [1, 4, 8])
def test_a_refusal_names_the_item_as_the_user_counts(profile, number):
    result = mavlink.MAV_MISSION_UNSUPPORTED
    server = refusing(profile, PLAN[number - 1], result)
    failed, _ = carry(VerifiedUpload(PLAN, home=HOME, profile=profile), server)
    assert isinstance(failed, TransferFailed)
    assert failed.reason is FailureReason.REFUSED
    assert (failed.result, failed.item) == (result, number - 1)
    assert f"was refused at item {number} (NAV_WAYPOINT): " in failed.text
    assert mavlink.enums["MAV_MISSION_RESULT"][result].name in failed.text
    if profile is ARDUPILOT:
        held = server.plan(MISSION).items
        new = "none" if number == 1 else f"the first {number - 1}"
        new = "all" if number - 1 == len(held) and number > 1 else new
        assert failed.vehicle_plan is PlanState.UNKNOWN
        assert f"the vehicle now holds {len(held)} items, {new} as sent" in failed.text
        assert held[: number - 1] == tuple(as_stored(item, profile) for item in PLAN[: number - 1])
    else:
        assert failed.vehicle_plan is PlanState.OLD
        assert server.plan(MISSION).items == OLD


def test_a_plan_that_is_too_long_is_refused_before_any_item():
    server = refusing(ARDUPILOT, OLD[0], 0, capacity={MISSION: 5})
    failed, texts = carry(VerifiedUpload(PLAN, home=HOME, profile=ARDUPILOT), server)
    assert failed.result == mavlink.MAV_MISSION_NO_SPACE
    assert failed.item is None
    assert failed.text == (
        "upload of the mission was refused: no space for 9 items (MAV_MISSION_NO_SPACE):"
        " set BRD_SD_MISSION to 1 and restart the vehicle, or fly the mission in parts"
    )
    assert [text.text for text in texts] == ["Only 6 items are supported"]


# What was sent, and what a real one gave back.
LOITER = MissionItem(19, 3, 4.0, 0.0, 0.0, None, 28.0, -82.0, 10.0)
CORNER = MissionItem(5001, 3, 3.0, x=28.0, y=-82.0, z=40.0)
RALLY_POINT = MissionItem(5100, 3, x=28.0, y=-82.0, z=20.7)
READ_BACK = [
    (PX4, LOITER, replace(LOITER, param4=0.0), []),
    (PX4, LOITER, replace(LOITER, param4=0.0, param3=5.0), ["param3"]),
    (PX4, replace(LOITER, param2=2.0, param4=30.0), replace(LOITER, param2=1.0, param4=1.0), []),
    (PX4, CORNER, replace(CORNER, autocontinue=False), []),
    (PX4, CORNER, replace(CORNER, z=0.0), ["z"]),
    (PX4, RALLY_POINT, replace(RALLY_POINT, autocontinue=False), []),
    (PX4, PLAN[0], replace(PLAN[0], autocontinue=False), ["autocontinue"]),
    (PX4, MissionItem(31, 3, 5.0, 60.0, x=28.0), MissionItem(31, 3, 1.0, 60.0, x=28.0), []),
    (ARDUPILOT, replace(LOITER, param4=0.0), replace(LOITER, param3=1.0, param4=0.0), []),
    (ARDUPILOT, replace(LOITER, param3=-40.0), replace(LOITER, param3=-1.0, param4=0.0), []),
    (ARDUPILOT, replace(LOITER, param3=-40.0), replace(LOITER, param3=1.0, param4=0.0), ["param3"]),
    (ARDUPILOT, replace(LOITER, param1=4.7, param4=0.0), replace(LOITER, param3=1.0, param4=0.0), []),
    (ARDUPILOT, MissionItem(18, 3, 2.0, x=28.0), MissionItem(18, 3, 3.0, x=28.0), ["param1"]),
    (ARDUPILOT, MissionItem(20), MissionItem(20, 0), []),
    (ARDUPILOT, CORNER, replace(CORNER, frame=0, z=0.0, autocontinue=False), []),
    (ARDUPILOT, CORNER, replace(CORNER, param1=4.0), ["param1"]),
    (ARDUPILOT, RALLY_POINT, replace(RALLY_POINT, z=20.0, autocontinue=False), []),
    (ARDUPILOT, RALLY_POINT, replace(RALLY_POINT, z=19.0, autocontinue=False), ["z"]),
    (ARDUPILOT, replace(PLAN[0], autocontinue=False), PLAN[0], []),
    (GENERIC, CORNER, replace(CORNER, autocontinue=False), ["autocontinue"]),
]


@pytest.mark.parametrize(("profile", "sent", "back", "found"), READ_BACK)
def test_what_an_autopilot_does_not_store_is_no_difference(profile, sent, back, found):
    assert [difference.field for difference in compare_plans((sent,), (back,), profile)] == found


@pytest.mark.parametrize("profile", [PX4, ARDUPILOT])
@pytest.mark.parametrize("item", [case[1] for case in READ_BACK if case[0] is not GENERIC])
def test_our_own_vehicles_give_back_what_real_ones_do_and_are_verified(profile, item):
    kind = FENCE if item.command == 5001 else RALLY if item.command == 5100 else MISSION
    # ArduPilot refuses NaN in the parameters of a loiter; rendering gives a 0.
    item = replace(item, param4=0.0) if item.param4 is None and item.command == 19 else item
    plan = (item,) * 3
    server = MissionServer(1, profile=profile, home=HOME)
    if profile is PX4 and item.command == 18:
        return
    end, _ = carry(VerifiedUpload(plan, kind, home=HOME, profile=profile), server)
    assert isinstance(end, UploadVerified), end
    back = as_read_back(server.plan(kind).items[0], profile)
    assert compare_plans((item,), (back,), profile) == ()
    assert back.autocontinue is (kind is MISSION and (item.autocontinue or profile is ARDUPILOT))
