"""A mission is gone on with where the vehicle behind a link says, over real sockets."""

import time

import pytest
from stand_in import stand_in

from mission.course import Course
from mission.errors import MissionError
from mission.ground.link import upload
from mission.link.codec.dialect import mavlink as m
from mission.link.tlog import TlogWriter
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


def test_the_progress_of_another_vehicle_does_not_cut_the_mission(tmp_path):
    course = Course(plan(Scenario(farm="miniberry-10", planner="lawnmower", budget="200m")).mission)
    told = r"vehicles 1, 2 are heard; give the item of the one that you mean: --resume 12\+35m"
    with stand_in(count=2) as (url, _), pytest.raises(MissionError, match=f"{url}: {told}"):
        resume_place(url, course)
    log, ground = tmp_path / "both.tlog", m.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    with TlogWriter(log) as writer:
        writer.write(ground.pack(m.MAVLink(None, 255, 1)), 1.0)
        for number in (1, 2):
            beat = m.MAVLink_heartbeat_message(2, 12, 81, 0, 4, 3)
            writer.write(beat.pack(m.MAVLink(None, number, 1)), 1.0 + number)
    with pytest.raises(MissionError, match=told):
        resume_place(str(log), course)
