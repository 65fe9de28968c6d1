"""A mission is gone on with where the vehicle behind a link says, over real sockets."""

import time

import pytest
from stand_in import stand_in

from mission.course import Course
from mission.errors import MissionError
from mission.ground.link import upload
from mission.transfer import RemoteTransferError
from wbf_mission.addons.operate.resume import resume_place
from wbf_mission.cli.app import main
from wbf_mission.run.plan import plan
from wbf_mission.scenario import Scenario


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_vehicle_that_flies_is_where_it_is_and_one_that_waits_at_its_item(autopilot):
    rows = Scenario(farm="miniberry-10", planner="lawnmower", budget="200m", autopilot=autopilot)
    mission = plan(rows).mission
    course = Course(mission)
    with stand_in(autopilot, speed=4.0) as (url, made):
        with pytest.raises(MissionError, match=r"does not report its current item|holds another mission"):
            resume_place(url, course)
        upload(mission, url)
        assert main(["command", url, "arm", "-q", "--json"]) == 0
        assert main(["command", url, "mission", "-q", "--json"]) == 0
        for _ in range(60):
            if made.vehicle.pilot.executor.mission.current_seq > course.legs[2].item:
                break
            time.sleep(0.5)
        flown = made.vehicle.pilot.executor.mission
        before, place, after = flown.current_seq, resume_place(url, course), flown.current_seq
        assert before - 1 <= place.item <= after
        assert main(["command", url, "hold", "-q", "--json"]) == 0
        held = resume_place(url, course)
        assert held.fraction == 0.0 and held.item >= place.item


def test_nobody_at_the_other_end_is_told():
    course = Course(plan(Scenario(farm="miniberry-10", planner="lawnmower", budget="200m")).mission)
    with pytest.raises(RemoteTransferError, match=r"no vehicle was heard in 0\.3 s"):
        resume_place("udpin:127.0.0.1:0", course, wait_s=0.3)
