"""Files of the vehicle as real clients read and write them: MAVSDK, pymavlink's mavftp."""

import json
import queue

import pytest
from sweeps import autopilots

from mission.link import read_tlog


def finished(start, limit_s=60.0):
    """Run a transfer of MAVSDK and return its last result."""
    results = queue.Queue()
    start(lambda result, progress, *_: results.put((result.name, progress)))
    while True:
        name, _ = results.get(timeout=limit_s)
        if name != "NEXT":
            return name


@pytest.mark.parametrize(("autopilot", "burst"), [("px4", True), ("ardupilot", False)])
def test_mavsdk_puts_lists_compares_gets_and_removes_a_file(autopilot, burst, connected, tmp_path):
    from mavsdk.plugins.ftp import Ftp, FtpError

    _, system = connected(autopilot)
    ftp = Ftp(system)
    sent = tmp_path / "plan.bin"
    sent.write_bytes(bytes(range(256)) * 60)
    ftp.create_directory("/data")
    assert finished(lambda done: ftp.upload_async(str(sent), "/data", done)) == "SUCCESS"
    listed = ftp.list_directory("/data")
    assert [(entry.name, entry.size_bytes) for entry in listed.entries] == [("plan.bin", 15360)]
    assert ftp.are_files_identical(str(sent), "/data/plan.bin")
    back = tmp_path / "back"
    back.mkdir()
    assert finished(lambda done: ftp.download_async("/data/plan.bin", str(back), burst, done)) == "SUCCESS"
    assert (back / "plan.bin").read_bytes() == sent.read_bytes()
    ftp.rename("/data/plan.bin", "/data/old.bin")
    ftp.remove_file("/data/old.bin")
    with pytest.raises(FtpError):
        ftp.remove_file("/data/old.bin")
    ftp.remove_directory("/data")


@autopilots()
def test_mavsdk_asks_for_logs_and_for_metadata(autopilot, connected, tools):
    from mavsdk.plugins.component_metadata import ComponentMetadata, MetadataType
    from mavsdk.plugins.log_files import LogFiles, LogFilesError

    flying, system = connected(autopilot)
    with pytest.raises(LogFilesError) as error:
        LogFiles(system).get_entries()
    assert error.value.result.name == "NO_LOGFILES"
    if flying.is_ardupilot:
        return
    metadata = ComponentMetadata(system)
    available = queue.Queue()
    metadata.subscribe_metadata_available(lambda data, *_: available.put(data))
    metadata.request_autopilot_component()
    available.get(timeout=60.0)
    told = metadata.get_metadata(1, int(MetadataType.PARAMETER))
    entries = {entry["name"]: entry for entry in json.loads(told.json_metadata)["parameters"]}
    names = set(entries)
    assert (entries["MPC_XY_P"]["min"], entries["MPC_XY_P"]["max"]) == (0.0, 2.0)
    table = flying.vehicle.firmware.parameters(flying.vehicle.pilot.spec, 1)
    assert names == {parameter.name for parameter in table}


@autopilots()
def test_mavsdk_downloads_the_log_of_a_flight(autopilot, connected, tools, tmp_path):
    from mavsdk.plugins.ftp import Ftp
    from mavsdk.plugins.log_files import LogFiles

    flying, system = connected(autopilot)
    pilot = flying.vehicle.pilot
    tools.wait_until(lambda: pilot.now_s > 5.0, what="some seconds")
    pilot.arm()
    tools.wait_until(lambda: pilot.now_s > 10.0, what="some seconds")
    pilot.disarm()
    ended_s = pilot.now_s
    tools.wait_until(lambda: pilot.now_s > ended_s + 3.0, what="the end of the log")
    files, ftp = LogFiles(system), Ftp(system)
    got = tmp_path / "got.tlog"
    (log,) = files.get_entries()
    assert log.date.startswith("20")
    assert finished(lambda told: files.download_log_file_async(log, str(got), told)) == "SUCCESS"
    assert got.stat().st_size == log.size_bytes
    folder = "/APM/LOGS"
    if not flying.is_ardupilot:
        (day,) = ftp.list_directory("/fs/microsd/log").entries
        folder = f"/fs/microsd/log/{day.name}"
    (entry,) = ftp.list_directory(folder).entries
    assert entry.size_bytes == log.size_bytes
    saved = tmp_path / entry.name
    remote = f"{folder}/{entry.name}"
    assert finished(lambda told: ftp.download_async(remote, str(tmp_path), True, told)) == "SUCCESS"
    assert saved.read_bytes() == got.read_bytes()
    told = [(time_s, message.get_type()) for time_s, message in read_tlog(saved)]
    assert told[-1][0] - told[0][0] > 3.0
    assert "HEARTBEAT" in {kind for _, kind in told}


# MAVSDK does the same with a PX4 above.
@autopilots(slow_with=("px4",))
def test_mavftp_lists_puts_and_gets(autopilot, fly, tools, tmp_path):
    from pymavlink import mavutil
    from pymavlink.mavftp import MAVFTP

    flying = fly(autopilot)
    connection = mavutil.mavlink_connection(f"tcp:127.0.0.1:{tools.port_of(flying.urls[0])}")
    connection.wait_heartbeat(timeout=10)
    ftp = MAVFTP(connection, 1, 1)
    ftp.ftp_settings.idle_detection_time = 1.1  # A list has no end but silence, longer than it asks again
    sent, got = tmp_path / "sent.txt", tmp_path / "got.txt"
    sent.write_bytes(b"0123456789" * 500)
    assert ftp.cmd_put([str(sent), "/sent.txt"]).error_code == 0
    assert ftp.process_ftp_reply("CreateFile", timeout=20).error_code == 0
    names = {entry.name: entry for entry in ftp.cmd_list(["/"]).directory_listing}
    assert names["sent.txt"].size_b == 5000
    assert ftp.cmd_get(["/sent.txt", str(got)]).error_code == 0
    assert ftp.process_ftp_reply("OpenFileRO", timeout=20).error_code == 0
    assert got.read_bytes() == sent.read_bytes()
    if flying.is_ardupilot:
        values, defaults = tmp_path / "values.parm", tmp_path / "defaults.parm"
        assert ftp.cmd_getparams([str(values), str(defaults)]).error_code == 0
        assert ftp.process_ftp_reply("OpenFileRO", timeout=30).error_code == 0
        rows = dict(line.replace(",", " ").split()[:2] for line in values.read_text().splitlines())
        table = flying.vehicle.firmware.parameters(flying.vehicle.pilot.spec, 1)
        assert set(rows) == {parameter.name for parameter in table}
    connection.close()
