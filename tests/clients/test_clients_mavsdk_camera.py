"""MAVSDK's camera plugin works the leaf camera, on the ground and in a mission."""

from itertools import pairwise

import pytest

CAMERA = 100


@pytest.fixture
def shooting(connected, tools):
    """A vehicle with its camera, MAVSDK's plugin on it, and the captures it is told of."""
    from mavsdk.plugins.camera import Camera

    def start(autopilot, speed=10.0):
        flying, system = connected(autopilot, camera=True, speed=speed)
        camera = Camera(system)
        tools.wait_until(lambda: camera.camera_list().cameras, what="the camera")
        captures = []
        camera.subscribe_capture_info(lambda info, _: captures.append(info))
        return flying, system, camera, captures

    return start


def listed_and_stored(camera, number, storage, tools):
    """What MAVSDK knows after it has asked for the camera's status, each five seconds."""
    from mavsdk.plugins.camera import CameraError, PhotosRange, Storage

    def photos():
        try:
            return camera.list_photos(CAMERA, PhotosRange.ALL)
        except CameraError:
            return ()

    tools.wait_until(lambda: len(photos()) == number, what="the list of photos")
    tools.wait_until(lambda: storage, what="storage information")
    assert storage[-1].storage_status == Storage.StorageStatus.FORMATTED
    assert storage[-1].total_storage_mib == 1024.0


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_pictures_one_by_one_and_in_series(autopilot, shooting, tools):
    from mavsdk.plugins.camera import CameraError, Mode

    flying, _, camera, captures = shooting(autopilot)
    storage = []
    camera.subscribe_storage(lambda update, _: storage.append(update.storage))
    (found,) = camera.camera_list().cameras
    assert (found.component_id, found.vendor_name, found.model_name) == (CAMERA, "wbf-mission", "leaf camera")
    assert found.horizontal_resolution_px == found.vertical_resolution_px == 1
    camera.set_mode(CAMERA, Mode.PHOTO)
    tools.wait_until(lambda: camera.get_mode(CAMERA) == Mode.PHOTO, what="photo mode")
    first_fix = tools.wait_until(lambda: flying.camera.trigger.position, what="the camera's first position")

    def knows_the_time():
        return flying.camera.trigger.position.time_ms > first_fix.time_ms + 2000

    tools.wait_until(knows_the_time, what="two seconds of telemetry")
    camera.take_photo(CAMERA)
    tools.wait_until(lambda: len(captures) == 1, what="the picture")
    first = captures[0]
    assert (first.index, first.is_success, first.component_id) == (0, True, CAMERA)
    assert first.position.latitude_deg == pytest.approx(flying.home.latitude_deg, abs=1e-6)
    assert first.attitude_euler_angle.pitch_deg == pytest.approx(-90.0, abs=0.1)
    assert first.time_utc_us > 1_700_000_000_000_000
    camera.start_photo_interval(CAMERA, 0.5)
    tools.wait_until(lambda: len(captures) >= 5, what="pictures of the series")
    camera.stop_photo_interval(CAMERA)
    tools.wait_until(lambda: not flying.camera.trigger.active, what="the end of the series")
    number = flying.camera.image_count
    tools.wait_until(lambda: len(captures) >= number, what="the last picture")
    assert [info.index for info in captures] == list(range(number))
    times = [info.time_utc_us for info in captures[1:]]
    assert all(later - sooner == 500_000 for sooner, later in pairwise(times))

    if not flying.is_ardupilot:
        listed_and_stored(camera, number, storage, tools)
    camera.format_storage(CAMERA, 0)
    camera.reset_settings(CAMERA)
    with pytest.raises(CameraError):
        camera.set_mode(CAMERA, Mode.VIDEO)
    with pytest.raises(CameraError):
        camera.start_video(CAMERA)


def test_a_mission_by_items_of_the_mission_plugin_takes_pictures(shooting, tools):
    """The mission plugin (not mission_raw), which has no take-off item and films too, on PX4."""
    from mavsdk.plugins.action import Action
    from mavsdk.plugins.mission import Mission, MissionItem, MissionPlan
    from mavsdk.plugins.telemetry import FlightMode, Telemetry

    flying, system, _, captures = shooting("px4", speed=10.0)
    telemetry, action, mission = Telemetry(system), Action(system), Mission(system)
    wait = tools.wait_until
    wait(telemetry.health_all_ok, what="health all ok")
    action_of = MissionItem.CameraAction
    plan = []
    for (x, y), camera_action in (
        ((10, 0), action_of.TAKE_PHOTO),
        ((10, 10), action_of.START_VIDEO),
        ((0, 10), action_of.STOP_VIDEO),
        ((-10, 10), action_of.START_PHOTO_INTERVAL),
        ((-10, -5), action_of.STOP_PHOTO_INTERVAL),
    ):
        latitude, longitude = flying.place(x, y)
        plan.append(
            MissionItem(
                latitude, longitude, 8.0, 5.0, True, 0.0, 0.0, camera_action,
                0.0, 1.0, 1.0, 0.0, 0.0, MissionItem.VehicleAction.NONE,
            )
        )  # fmt: skip
    mission.upload_mission(MissionPlan(plan))
    back = mission.download_mission().mission_items
    assert [round(item.latitude_deg, 7) for item in back] == [round(i.latitude_deg, 7) for i in plan]
    assert [item.camera_action for item in back] == [item.camera_action for item in plan]
    progress = []
    mission.subscribe_mission_progress(lambda p, _: progress.append((p.current, p.total)))
    action.arm()
    mission.start_mission()
    wait(telemetry.in_air, what="in air")
    wait(lambda: mission.mission_progress().current >= 2, what="the second item")
    mission.pause_mission()
    wait(lambda: telemetry.flight_mode() == FlightMode.HOLD, what="the pause")
    mission.set_current_mission_item(2)
    mission.start_mission()
    wait(mission.is_mission_finished, what="the end of the mission")
    wait(lambda: progress[-1] == (len(plan), len(plan)), what="the last progress")
    assert [current for current, _ in progress] == sorted(current for current, _ in progress)
    # One picture at the first place, then one each second over 15 m at up to 5 m/s.
    assert 3 <= len(captures) <= 12
    assert all(info.position.relative_altitude_m > 6.0 for info in captures)
    action.return_to_launch()
    wait(lambda: not telemetry.armed(), what="disarming at home")
