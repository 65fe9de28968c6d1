"""The examples of pymavlink that need a vehicle, written after them: the same calls in the same order.

Run with ``NAME [ADDRESS]``.
"""

import sys
from pathlib import Path

from clock import now
from pymavlink import mavftp, mavutil

ADDRESS = sys.argv[2] if len(sys.argv) > 2 else "tcp:127.0.0.1:5760"


def say(*words):
    sys.stdout.write(" ".join(map(str, words)) + "\n")
    sys.stdout.flush()


def opened(**options):
    master = mavutil.mavlink_connection(ADDRESS, baud=115200, **options)
    master.wait_heartbeat()
    return master


def apmsetrate():
    master = opened()
    for _ in range(3):
        master.mav.request_data_stream_send(
            master.target_system, master.target_component, mavutil.mavlink.MAV_DATA_STREAM_ALL, 4, 1
        )
    for _ in range(200):
        message = master.recv_match(blocking=True, timeout=5)
        say(message.get_type())


def mavftp_example():
    """A file of its own takes the place of the scripts that the example gets from the web."""
    master = opened(source_system=250)
    ftp = mavftp.MAVFTP(master, target_system=master.target_system, target_component=master.target_component)

    def tell(answer):
        answer.display_message()
        say(answer.operation_name, answer.error_code)

    tell(ftp.cmd_list(["/APM/LOGS"]))
    ftp.cmd_getparams(["params.param", "defaults.param"])
    tell(ftp.process_ftp_reply("OpenFileRO", timeout=50))
    tell(ftp.cmd_list(["/APM/LOGS"]))
    ftp.cmd_rmdir(["test_dir"])
    tell(ftp.cmd_mkdir(["test_dir"]))
    tell(ftp.cmd_rmdir(["test_dir"]))
    tell(ftp.cmd_mkdir(["test_dir2"]))
    Path("helper.lua").write_text("-- a script\n" * 100)
    ftp.cmd_put(["helper.lua", "/APM/Scripts/helper.lua"])
    tell(ftp.process_ftp_reply("CreateFile", timeout=5))
    master.close()


def mavtester():
    """Its messages are those of pymavlink's own tests; here each that a ground station may send, zeroed."""
    master = mavutil.mavlink_connection(ADDRESS, baud=115200, source_system=255)
    master.recv_match(type="HEARTBEAT", blocking=True)
    for kind in mavutil.mavlink.mavlink_map.values():
        lengths = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
        zeros = {
            name: b"\0" if text == "char" else [0] * lengths[name] or 0
            for name, text in zip(kind.fieldnames, kind.fieldtypes, strict=True)
        }
        master.mav.send(kind(**zeros))
    for _ in range(2):
        master.recv_match(type="HEARTBEAT", blocking=True)
    say("still there")


def status_msg():
    master = opened()
    target = (master.target_system, master.target_component)
    master.mav.command_long_send(*target, mavutil.mavlink.MAV_CMD_DO_SEND_BANNER, *[0] * 8)
    end_s = now() + 2
    while now() < end_s:
        message = master.recv_match(blocking=True, timeout=0.1)
        if message is not None and message.get_type() == "STATUSTEXT":
            say("banner", message.text)
    number = mavutil.mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION
    master.mav.command_long_send(*target, mavutil.mavlink.MAV_CMD_REQUEST_MESSAGE, 0, number, *[0] * 6)
    version = master.recv_match(type="AUTOPILOT_VERSION", blocking=True, timeout=5)
    say("version", version.flight_sw_version >> 24, version.flight_sw_version >> 16 & 255)
    master.close()


if __name__ == "__main__":
    globals()[sys.argv[1]]()
    say("done")
