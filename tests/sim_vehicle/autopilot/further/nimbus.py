"""An autopilot as another package would give it: own modes, rules, parameters, procedures, profile."""

from dataclasses import replace
from types import MappingProxyType

from mission.autopilots.profile import FlightModes, Meaning, Profile, VehicleSettings
from mission.link.codec.dialect import mavlink as m
from sim_vehicle.autopilot import Autopilot, Firmware
from sim_vehicle.autopilot.behaviour import FailsafeRules, Mode, ModeTable, actions_by_value
from sim_vehicle.autopilot.mavlink_profile import COMMON_CAPABILITIES, Identity, MavlinkProfile
from sim_vehicle.autopilot.parameters import FailsafeDefaults, MavParameter, ParameterSpec
from sim_vehicle.autopilot.procedures import GenericProcedures


class NimbusProcedures(GenericProcedures):
    """Generic motion, whose cruise speed is a parameter."""

    name = "nimbus"
    parameters = MappingProxyType({"NIM_SPEED": ParameterSpec(7.0, 1.0, 12.0, "m/s", "cruise speed")})

    def fit(self, spec):
        speed = dict(spec.parameters).get("NIM_SPEED", 7.0)
        return replace(spec, cruise_speed_m_s=speed)


def parameter_table(spec, system_id):
    return [
        MavParameter("NIM_SYSTEM", integer=True, value=system_id),
        MavParameter("NIM_LINK_ACT", "link_action", integer=True, low=0, high=1),
        MavParameter("NIM_LINK_TIME", "link_timeout_s", low=1.0, high=60.0),
    ]


PROFILE = Profile(
    "Nimbus",
    m.MAV_AUTOPILOT_REFLEX,
    home_at_zero=True,
    streams_on_request=True,
    takeoff_above_sea=False,
    modes=FlightModes(
        lambda _kind: {"STAY": (1.0, 72.0, 0.0), "SURVEY": (1.0, 75.0, 0.0)},
        mission=frozenset({"SURVEY"}),
        hold={None: "STAY"},
        arming={None: None},
        ends=lambda _kind, _last: frozenset(),
    ),
    settings=VehicleSettings({None: {Meaning.LINK_LOST: {"NIM_LINK_ACT": 1.0}}}),
)
RULES = FailsafeRules(
    fence_actions=actions_by_value(NONE="0", RETURN="1"),
    link_actions=actions_by_value(NONE="0", LAND="1"),
    battery_actions=(actions_by_value(RETURN="1"),) * 3,
    critical_apart=False,
    watches_voltage=False,
    any_inclusion=True,
    needs_stream=False,
    pauses_in_mode=True,
    yaws_to_setpoint=False,
    fences_setpoints=False,
    tells_link_loss=True,
    preflight="Nimbus check",
    arming_texts=("Nimbus arming: {}",),
    fence_text="Nimbus fence: {}",
    fence_clear="Nimbus fence clear",
    link_lost="Nimbus link lost",
    link_regained="Nimbus link back",
    stream_lost="Nimbus setpoints lost: {}",
    defaults=FailsafeDefaults(link_timeout_s=4.0),
)
MAVLINK = MavlinkProfile(
    identity=Identity(
        m.MAV_AUTOPILOT_REFLEX,
        m.MAV_TYPE_QUADROTOR,
        (3, 2, 1),
        COMMON_CAPABILITIES | m.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST,
        banner="Nimbus 3.2.1",
    ),
    modes=ModeTable(
        rows=(
            (70, Mode.MANUAL, ""),
            (71, Mode.ALTITUDE, ""),
            (72, Mode.POSITION, ""),
            (73, Mode.HOLD, ""),
            (74, Mode.TAKEOFF, ""),
            (75, Mode.MISSION, ""),
            (76, Mode.RTL, ""),
            (77, Mode.LAND, ""),
            (78, Mode.GUIDED, ""),
        ),
        boot=Mode.POSITION,
        after_takeoff=Mode.HOLD,
        after_command=Mode.GUIDED,
    ),
    rates_hz=MappingProxyType({m.MAVLINK_MSG_ID_HEARTBEAT: 2.0}),
    truth_message=m.MAVLINK_MSG_ID_SIM_STATE,
)
NIMBUS = Autopilot(
    name="nimbus",
    title="Nimbus",
    firmwares=MappingProxyType(
        {
            "multirotor": Firmware(
                title="Nimbus Copter",
                mavlink=MAVLINK,
                rules=RULES,
                profile=PROFILE,
                parameter_table=parameter_table,
                procedures=NimbusProcedures(),
            )
        }
    ),
    simulator_urls=lambda index: (f"tcpin:127.0.0.1:{7700 + index}",),
)
