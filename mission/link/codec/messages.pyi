# The part of the MAVLink dialect that the code uses, for type checkers.

from collections.abc import Sequence
from struct import Struct
from typing import Any, ClassVar, Final, dataclass_transform

class MAVError(Exception): ...

class EnumEntry:
    name: str
    description: str

enums: Final[dict[str, dict[int, EnumEntry]]]

@dataclass_transform()
class MAVLink_message:
    id: int
    msgname: ClassVar[str]
    crc_extra: ClassVar[int]
    fieldnames: ClassVar[list[str]]
    ordered_fieldnames: ClassVar[list[str]]
    unpacker: ClassVar[Struct]
    def get_type(self) -> str: ...
    def get_msgId(self) -> int: ...
    def get_srcSystem(self) -> int: ...
    def get_srcComponent(self) -> int: ...
    def get_seq(self) -> int: ...
    def get_msgbuf(self) -> bytes: ...
    def to_dict(self) -> dict[str, Any]: ...
    def pack(self, mav: MAVLink, force_mavlink1: bool = ...) -> bytes: ...

class MAVLink:
    seq: int
    srcSystem: int
    srcComponent: int
    def __init__(self, file: None, srcSystem: int = ..., srcComponent: int = ...) -> None: ...
    def decode(self, msgbuf: bytearray) -> MAVLink_message: ...

mavlink_map: Final[dict[int, type[MAVLink_message]]]

# What follows is written by tools/write_message_stub.py; do not edit it.

CAMERA_CAP_FLAGS_CAPTURE_IMAGE: Final[int]
CAMERA_CAP_FLAGS_HAS_IMAGE_SURVEY_MODE: Final[int]
CAMERA_CAP_FLAGS_HAS_MODES: Final[int]
CAMERA_FEEDBACK_PHOTO: Final[int]
CAMERA_MODE_IMAGE: Final[int]
CAMERA_MODE_IMAGE_SURVEY: Final[int]
EKF_CONST_POS_MODE: Final[int]
EKF_POS_HORIZ_ABS: Final[int]
EKF_PRED_POS_HORIZ_ABS: Final[int]
ESTIMATOR_ATTITUDE: Final[int]
ESTIMATOR_POS_HORIZ_ABS: Final[int]
ESTIMATOR_VELOCITY_HORIZ: Final[int]
GIMBAL_DEVICE_FLAGS_NEUTRAL: Final[int]
GIMBAL_DEVICE_FLAGS_PITCH_LOCK: Final[int]
GIMBAL_DEVICE_FLAGS_RETRACT: Final[int]
GIMBAL_DEVICE_FLAGS_ROLL_LOCK: Final[int]
GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME: Final[int]
GIMBAL_DEVICE_FLAGS_YAW_LOCK: Final[int]
GIMBAL_MANAGER_CAP_FLAGS_CAN_POINT_LOCATION_GLOBAL: Final[int]
GIMBAL_MANAGER_CAP_FLAGS_CAN_POINT_LOCATION_LOCAL: Final[int]
GIMBAL_MANAGER_CAP_FLAGS_HAS_NEUTRAL: Final[int]
GIMBAL_MANAGER_CAP_FLAGS_HAS_RC_INPUTS: Final[int]
GIMBAL_MANAGER_CAP_FLAGS_HAS_RETRACT: Final[int]
GIMBAL_MANAGER_FLAGS_YAW_LOCK: Final[int]
GPS_FIX_TYPE_3D_FIX: Final[int]
MAVLINK_MSG_ID_AHRS: Final[int]
MAVLINK_MSG_ID_AHRS2: Final[int]
MAVLINK_MSG_ID_ALTITUDE: Final[int]
MAVLINK_MSG_ID_ATTITUDE: Final[int]
MAVLINK_MSG_ID_ATTITUDE_QUATERNION: Final[int]
MAVLINK_MSG_ID_AUTOPILOT_STATE_FOR_GIMBAL_DEVICE: Final[int]
MAVLINK_MSG_ID_AUTOPILOT_VERSION: Final[int]
MAVLINK_MSG_ID_AVAILABLE_MODES: Final[int]
MAVLINK_MSG_ID_AVAILABLE_MODES_MONITOR: Final[int]
MAVLINK_MSG_ID_BATTERY_STATUS: Final[int]
MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS: Final[int]
MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED: Final[int]
MAVLINK_MSG_ID_CAMERA_INFORMATION: Final[int]
MAVLINK_MSG_ID_CAMERA_SETTINGS: Final[int]
MAVLINK_MSG_ID_CAMERA_TRIGGER: Final[int]
MAVLINK_MSG_ID_COMMAND_INT: Final[int]
MAVLINK_MSG_ID_COMMAND_LONG: Final[int]
MAVLINK_MSG_ID_COMPONENT_METADATA: Final[int]
MAVLINK_MSG_ID_CURRENT_MODE: Final[int]
MAVLINK_MSG_ID_DEBUG_FLOAT_ARRAY: Final[int]
MAVLINK_MSG_ID_EKF_STATUS_REPORT: Final[int]
MAVLINK_MSG_ID_ESTIMATOR_STATUS: Final[int]
MAVLINK_MSG_ID_EXTENDED_SYS_STATE: Final[int]
MAVLINK_MSG_ID_FENCE_STATUS: Final[int]
MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL: Final[int]
MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS: Final[int]
MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION: Final[int]
MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS: Final[int]
MAVLINK_MSG_ID_GLOBAL_POSITION_INT: Final[int]
MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: Final[int]
MAVLINK_MSG_ID_GPS_RAW_INT: Final[int]
MAVLINK_MSG_ID_HEARTBEAT: Final[int]
MAVLINK_MSG_ID_HIGHRES_IMU: Final[int]
MAVLINK_MSG_ID_HIL_STATE_QUATERNION: Final[int]
MAVLINK_MSG_ID_HOME_POSITION: Final[int]
MAVLINK_MSG_ID_LOCAL_POSITION_NED: Final[int]
MAVLINK_MSG_ID_LOG_DATA: Final[int]
MAVLINK_MSG_ID_LOG_ENTRY: Final[int]
MAVLINK_MSG_ID_MEMINFO: Final[int]
MAVLINK_MSG_ID_MESSAGE_INTERVAL: Final[int]
MAVLINK_MSG_ID_MISSION_ACK: Final[int]
MAVLINK_MSG_ID_MISSION_CLEAR_ALL: Final[int]
MAVLINK_MSG_ID_MISSION_COUNT: Final[int]
MAVLINK_MSG_ID_MISSION_CURRENT: Final[int]
MAVLINK_MSG_ID_MISSION_ITEM: Final[int]
MAVLINK_MSG_ID_MISSION_ITEM_INT: Final[int]
MAVLINK_MSG_ID_MISSION_ITEM_REACHED: Final[int]
MAVLINK_MSG_ID_MISSION_REQUEST: Final[int]
MAVLINK_MSG_ID_MISSION_REQUEST_INT: Final[int]
MAVLINK_MSG_ID_MISSION_REQUEST_LIST: Final[int]
MAVLINK_MSG_ID_MISSION_REQUEST_PARTIAL_LIST: Final[int]
MAVLINK_MSG_ID_MISSION_WRITE_PARTIAL_LIST: Final[int]
MAVLINK_MSG_ID_MOUNT_STATUS: Final[int]
MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT: Final[int]
MAVLINK_MSG_ID_ODOMETRY: Final[int]
MAVLINK_MSG_ID_PARAM_VALUE: Final[int]
MAVLINK_MSG_ID_PING: Final[int]
MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT: Final[int]
MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: Final[int]
MAVLINK_MSG_ID_POWER_STATUS: Final[int]
MAVLINK_MSG_ID_PROTOCOL_VERSION: Final[int]
MAVLINK_MSG_ID_RAW_IMU: Final[int]
MAVLINK_MSG_ID_RC_CHANNELS: Final[int]
MAVLINK_MSG_ID_SCALED_IMU2: Final[int]
MAVLINK_MSG_ID_SCALED_PRESSURE: Final[int]
MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: Final[int]
MAVLINK_MSG_ID_SIM_STATE: Final[int]
MAVLINK_MSG_ID_STATUSTEXT: Final[int]
MAVLINK_MSG_ID_STORAGE_INFORMATION: Final[int]
MAVLINK_MSG_ID_SYSTEM_TIME: Final[int]
MAVLINK_MSG_ID_SYS_STATUS: Final[int]
MAVLINK_MSG_ID_TERRAIN_REPORT: Final[int]
MAVLINK_MSG_ID_TIMESYNC: Final[int]
MAVLINK_MSG_ID_VFR_HUD: Final[int]
MAVLINK_MSG_ID_VIBRATION: Final[int]
MAVLINK_MSG_ID_WIND: Final[int]
MAVLINK_MSG_ID_WIND_COV: Final[int]
MAV_AUTOPILOT_ARDUPILOTMEGA: Final[int]
MAV_AUTOPILOT_GENERIC: Final[int]
MAV_AUTOPILOT_INVALID: Final[int]
MAV_AUTOPILOT_PX4: Final[int]
MAV_BATTERY_CHARGE_STATE_CRITICAL: Final[int]
MAV_BATTERY_CHARGE_STATE_EMERGENCY: Final[int]
MAV_BATTERY_CHARGE_STATE_FAILED: Final[int]
MAV_BATTERY_CHARGE_STATE_LOW: Final[int]
MAV_BATTERY_CHARGE_STATE_OK: Final[int]
MAV_BATTERY_FUNCTION_ALL: Final[int]
MAV_BATTERY_FUNCTION_PROPULSION: Final[int]
MAV_BATTERY_TYPE_LIPO: Final[int]
MAV_CMD_COMPONENT_ARM_DISARM: Final[int]
MAV_CMD_CONDITION_GATE: Final[int]
MAV_CMD_CONDITION_YAW: Final[int]
MAV_CMD_DO_ACCEPT_MAG_CAL: Final[int]
MAV_CMD_DO_CANCEL_MAG_CAL: Final[int]
MAV_CMD_DO_CHANGE_ALTITUDE: Final[int]
MAV_CMD_DO_FENCE_ENABLE: Final[int]
MAV_CMD_DO_FLIGHTTERMINATION: Final[int]
MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE: Final[int]
MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW: Final[int]
MAV_CMD_DO_GO_AROUND: Final[int]
MAV_CMD_DO_GRIPPER: Final[int]
MAV_CMD_DO_JUMP_TAG: Final[int]
MAV_CMD_DO_MOUNT_CONFIGURE: Final[int]
MAV_CMD_DO_MOUNT_CONTROL: Final[int]
MAV_CMD_DO_ORBIT: Final[int]
MAV_CMD_DO_PAUSE_CONTINUE: Final[int]
MAV_CMD_DO_REPOSITION: Final[int]
MAV_CMD_DO_SEND_BANNER: Final[int]
MAV_CMD_DO_SET_ACTUATOR: Final[int]
MAV_CMD_DO_SET_CAM_TRIGG_DIST: Final[int]
MAV_CMD_DO_SET_CAM_TRIGG_INTERVAL: Final[int]
MAV_CMD_DO_SET_MISSION_CURRENT: Final[int]
MAV_CMD_DO_SET_MODE: Final[int]
MAV_CMD_DO_SET_RELAY: Final[int]
MAV_CMD_DO_SET_SERVO: Final[int]
MAV_CMD_DO_SET_STANDARD_MODE: Final[int]
MAV_CMD_DO_START_MAG_CAL: Final[int]
MAV_CMD_DO_TRIGGER_CONTROL: Final[int]
MAV_CMD_DO_WINCH: Final[int]
MAV_CMD_GET_HOME_POSITION: Final[int]
MAV_CMD_GET_MESSAGE_INTERVAL: Final[int]
MAV_CMD_IMAGE_START_CAPTURE: Final[int]
MAV_CMD_IMAGE_STOP_CAPTURE: Final[int]
MAV_CMD_INJECT_FAILURE: Final[int]
MAV_CMD_JUMP_TAG: Final[int]
MAV_CMD_MISSION_START: Final[int]
MAV_CMD_NAV_CONTINUE_AND_CHANGE_ALT: Final[int]
MAV_CMD_NAV_LAND: Final[int]
MAV_CMD_NAV_PAYLOAD_PLACE: Final[int]
MAV_CMD_NAV_TAKEOFF: Final[int]
MAV_CMD_PREFLIGHT_CALIBRATION: Final[int]
MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: Final[int]
MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: Final[int]
MAV_CMD_REQUEST_CAMERA_CAPTURE_STATUS: Final[int]
MAV_CMD_REQUEST_CAMERA_IMAGE_CAPTURE: Final[int]
MAV_CMD_REQUEST_CAMERA_INFORMATION: Final[int]
MAV_CMD_REQUEST_CAMERA_SETTINGS: Final[int]
MAV_CMD_REQUEST_MESSAGE: Final[int]
MAV_CMD_REQUEST_PROTOCOL_VERSION: Final[int]
MAV_CMD_REQUEST_STORAGE_INFORMATION: Final[int]
MAV_CMD_RESET_CAMERA_SETTINGS: Final[int]
MAV_CMD_RUN_PREARM_CHECKS: Final[int]
MAV_CMD_SET_CAMERA_MODE: Final[int]
MAV_CMD_SET_MESSAGE_INTERVAL: Final[int]
MAV_CMD_STORAGE_FORMAT: Final[int]
MAV_COMP_ID_AUTOPILOT1: Final[int]
MAV_COMP_ID_CAMERA: Final[int]
MAV_COMP_ID_MISSIONPLANNER: Final[int]
MAV_COMP_ID_USER1: Final[int]
MAV_DATA_STREAM_ALL: Final[int]
MAV_DO_REPOSITION_FLAGS_CHANGE_MODE: Final[int]
MAV_ESTIMATOR_TYPE_AUTOPILOT: Final[int]
MAV_FRAME_BODY_FRD: Final[int]
MAV_FRAME_GLOBAL: Final[int]
MAV_FRAME_GLOBAL_RELATIVE_ALT: Final[int]
MAV_FRAME_LOCAL_NED: Final[int]
MAV_LANDED_STATE_IN_AIR: Final[int]
MAV_LANDED_STATE_ON_GROUND: Final[int]
MAV_MISSION_ACCEPTED: Final[int]
MAV_MISSION_DENIED: Final[int]
MAV_MISSION_ERROR: Final[int]
MAV_MISSION_INVALID: Final[int]
MAV_MISSION_INVALID_PARAM1: Final[int]
MAV_MISSION_INVALID_PARAM5_X: Final[int]
MAV_MISSION_INVALID_SEQUENCE: Final[int]
MAV_MISSION_NO_SPACE: Final[int]
MAV_MISSION_OPERATION_CANCELLED: Final[int]
MAV_MISSION_UNSUPPORTED: Final[int]
MAV_MISSION_UNSUPPORTED_FRAME: Final[int]
MAV_MODE_FLAG_AUTO_ENABLED: Final[int]
MAV_MODE_FLAG_CUSTOM_MODE_ENABLED: Final[int]
MAV_MODE_FLAG_GUIDED_ENABLED: Final[int]
MAV_MODE_FLAG_MANUAL_INPUT_ENABLED: Final[int]
MAV_MODE_FLAG_SAFETY_ARMED: Final[int]
MAV_MODE_FLAG_STABILIZE_ENABLED: Final[int]
MAV_MOUNT_MODE_MAVLINK_TARGETING: Final[int]
MAV_PARAM_ERROR_DOES_NOT_EXIST: Final[int]
MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE: Final[int]
MAV_PARAM_TYPE_INT16: Final[int]
MAV_PARAM_TYPE_INT32: Final[int]
MAV_PARAM_TYPE_INT8: Final[int]
MAV_PARAM_TYPE_REAL32: Final[int]
MAV_PARAM_TYPE_UINT32: Final[int]
MAV_PROTOCOL_CAPABILITY_COMMAND_INT: Final[int]
MAV_PROTOCOL_CAPABILITY_FLIGHT_TERMINATION: Final[int]
MAV_PROTOCOL_CAPABILITY_FTP: Final[int]
MAV_PROTOCOL_CAPABILITY_MAVLINK2: Final[int]
MAV_PROTOCOL_CAPABILITY_MISSION_FENCE: Final[int]
MAV_PROTOCOL_CAPABILITY_MISSION_FLOAT: Final[int]
MAV_PROTOCOL_CAPABILITY_MISSION_INT: Final[int]
MAV_PROTOCOL_CAPABILITY_MISSION_RALLY: Final[int]
MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE: Final[int]
MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST: Final[int]
MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT: Final[int]
MAV_PROTOCOL_CAPABILITY_SET_ATTITUDE_TARGET: Final[int]
MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT: Final[int]
MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED: Final[int]
MAV_RESULT_ACCEPTED: Final[int]
MAV_RESULT_COMMAND_INT_ONLY: Final[int]
MAV_RESULT_DENIED: Final[int]
MAV_RESULT_FAILED: Final[int]
MAV_RESULT_IN_PROGRESS: Final[int]
MAV_RESULT_TEMPORARILY_REJECTED: Final[int]
MAV_RESULT_UNSUPPORTED: Final[int]
MAV_SEVERITY_CRITICAL: Final[int]
MAV_SEVERITY_INFO: Final[int]
MAV_SEVERITY_NOTICE: Final[int]
MAV_SEVERITY_WARNING: Final[int]
MAV_STATE_ACTIVE: Final[int]
MAV_STATE_CRITICAL: Final[int]
MAV_STATE_EMERGENCY: Final[int]
MAV_STATE_FLIGHT_TERMINATION: Final[int]
MAV_STATE_POWEROFF: Final[int]
MAV_STATE_STANDBY: Final[int]
MAV_SYS_STATUS_AHRS: Final[int]
MAV_SYS_STATUS_GEOFENCE: Final[int]
MAV_SYS_STATUS_PREARM_CHECK: Final[int]
MAV_SYS_STATUS_SENSOR_3D_ACCEL: Final[int]
MAV_SYS_STATUS_SENSOR_3D_GYRO: Final[int]
MAV_SYS_STATUS_SENSOR_3D_MAG: Final[int]
MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE: Final[int]
MAV_SYS_STATUS_SENSOR_BATTERY: Final[int]
MAV_SYS_STATUS_SENSOR_GPS: Final[int]
MAV_TYPE_ADSB: Final[int]
MAV_TYPE_ANTENNA_TRACKER: Final[int]
MAV_TYPE_CAMERA: Final[int]
MAV_TYPE_FIXED_WING: Final[int]
MAV_TYPE_GCS: Final[int]
MAV_TYPE_GENERIC: Final[int]
MAV_TYPE_GIMBAL: Final[int]
MAV_TYPE_GROUND_ROVER: Final[int]
MAV_TYPE_ONBOARD_CONTROLLER: Final[int]
MAV_TYPE_QUADROTOR: Final[int]
MAV_TYPE_SURFACE_BOAT: Final[int]
ORBIT_YAW_BEHAVIOUR_HOLD_FRONT_TANGENT_TO_CIRCLE: Final[int]
ORBIT_YAW_BEHAVIOUR_HOLD_INITIAL_HEADING: Final[int]
ORBIT_YAW_BEHAVIOUR_RC_CONTROLLED: Final[int]
ORBIT_YAW_BEHAVIOUR_UNCHANGED: Final[int]
ORBIT_YAW_BEHAVIOUR_UNCONTROLLED: Final[int]
STORAGE_STATUS_READY: Final[int]

class MAVLink_ahrs2_message(MAVLink_message):
    roll: float
    pitch: float
    yaw: float
    altitude: float
    lat: int
    lng: int

class MAVLink_ahrs_message(MAVLink_message):
    omegaIx: float
    omegaIy: float
    omegaIz: float
    accel_weight: float
    renorm_val: float
    error_rp: float
    error_yaw: float

class MAVLink_altitude_message(MAVLink_message):
    time_usec: int
    altitude_monotonic: float
    altitude_amsl: float
    altitude_local: float
    altitude_relative: float
    altitude_terrain: float
    bottom_clearance: float

class MAVLink_attitude_message(MAVLink_message):
    time_boot_ms: int
    roll: float
    pitch: float
    yaw: float
    rollspeed: float
    pitchspeed: float
    yawspeed: float

class MAVLink_attitude_quaternion_message(MAVLink_message):
    time_boot_ms: int
    q1: float
    q2: float
    q3: float
    q4: float
    rollspeed: float
    pitchspeed: float
    yawspeed: float
    repr_offset_q: Sequence[float] = ...

class MAVLink_autopilot_state_for_gimbal_device_message(MAVLink_message):
    target_system: int
    target_component: int
    time_boot_us: int
    q: Sequence[float]
    q_estimated_delay_us: int
    vx: float
    vy: float
    vz: float
    v_estimated_delay_us: int
    feed_forward_angular_velocity_z: float
    estimator_status: int
    landed_state: int
    angular_velocity_z: float = ...

class MAVLink_autopilot_version_message(MAVLink_message):
    capabilities: int
    flight_sw_version: int
    middleware_sw_version: int
    os_sw_version: int
    board_version: int
    flight_custom_version: Sequence[int]
    middleware_custom_version: Sequence[int]
    os_custom_version: Sequence[int]
    vendor_id: int
    product_id: int
    uid: int
    uid2: Sequence[int] = ...

class MAVLink_available_modes_message(MAVLink_message):
    number_modes: int
    mode_index: int
    standard_mode: int
    custom_mode: int
    properties: int
    mode_name: str
    def __init__(
        self,
        number_modes: int,
        mode_index: int,
        standard_mode: int,
        custom_mode: int,
        properties: int,
        mode_name: bytes,
    ) -> None: ...

class MAVLink_available_modes_monitor_message(MAVLink_message):
    seq: int

class MAVLink_battery_status_message(MAVLink_message):
    id: int
    battery_function: int
    type: int
    temperature: int
    voltages: Sequence[int]
    current_battery: int
    current_consumed: int
    energy_consumed: int
    battery_remaining: int
    time_remaining: int = ...
    charge_state: int = ...
    voltages_ext: Sequence[int] = ...
    mode: int = ...
    fault_bitmask: int = ...

class MAVLink_camera_capture_status_message(MAVLink_message):
    time_boot_ms: int
    image_status: int
    video_status: int
    image_interval: float
    recording_time_ms: int
    available_capacity: float
    image_count: int = ...
    camera_device_id: int = ...

class MAVLink_camera_feedback_message(MAVLink_message):
    time_usec: int
    target_system: int
    cam_idx: int
    img_idx: int
    lat: int
    lng: int
    alt_msl: float
    alt_rel: float
    roll: float
    pitch: float
    yaw: float
    foc_len: float
    flags: int
    completed_captures: int = ...

class MAVLink_camera_image_captured_message(MAVLink_message):
    time_boot_ms: int
    time_utc: int
    camera_id: int
    lat: int
    lon: int
    alt: int
    relative_alt: int
    q: Sequence[float]
    image_index: int
    capture_result: int
    file_url: str
    def __init__(
        self,
        time_boot_ms: int,
        time_utc: int,
        camera_id: int,
        lat: int,
        lon: int,
        alt: int,
        relative_alt: int,
        q: Sequence[float],
        image_index: int,
        capture_result: int,
        file_url: bytes,
    ) -> None: ...

class MAVLink_camera_information_message(MAVLink_message):
    time_boot_ms: int
    vendor_name: Sequence[int]
    model_name: Sequence[int]
    firmware_version: int
    focal_length: float
    sensor_size_h: float
    sensor_size_v: float
    resolution_h: int
    resolution_v: int
    lens_id: int
    flags: int
    cam_definition_version: int
    cam_definition_uri: str
    gimbal_device_id: int = ...
    camera_device_id: int = ...
    def __init__(
        self,
        time_boot_ms: int,
        vendor_name: Sequence[int],
        model_name: Sequence[int],
        firmware_version: int,
        focal_length: float,
        sensor_size_h: float,
        sensor_size_v: float,
        resolution_h: int,
        resolution_v: int,
        lens_id: int,
        flags: int,
        cam_definition_version: int,
        cam_definition_uri: bytes,
        gimbal_device_id: int = ...,
        camera_device_id: int = ...,
    ) -> None: ...

class MAVLink_camera_settings_message(MAVLink_message):
    time_boot_ms: int
    mode_id: int
    zoomLevel: float = ...
    focusLevel: float = ...
    camera_device_id: int = ...

class MAVLink_camera_trigger_message(MAVLink_message):
    time_usec: int
    seq: int

class MAVLink_command_ack_message(MAVLink_message):
    command: int
    result: int
    progress: int = ...
    result_param2: int = ...
    target_system: int = ...
    target_component: int = ...

class MAVLink_command_int_message(MAVLink_message):
    target_system: int
    target_component: int
    frame: int
    command: int
    current: int
    autocontinue: int
    param1: float
    param2: float
    param3: float
    param4: float
    x: int
    y: int
    z: float

class MAVLink_command_long_message(MAVLink_message):
    target_system: int
    target_component: int
    command: int
    confirmation: int
    param1: float
    param2: float
    param3: float
    param4: float
    param5: float
    param6: float
    param7: float

class MAVLink_component_metadata_message(MAVLink_message):
    time_boot_ms: int
    file_crc: int
    uri: str
    def __init__(self, time_boot_ms: int, file_crc: int, uri: bytes) -> None: ...

class MAVLink_current_mode_message(MAVLink_message):
    standard_mode: int
    custom_mode: int
    intended_custom_mode: int

class MAVLink_debug_float_array_message(MAVLink_message):
    time_usec: int
    name: str
    array_id: int
    data: Sequence[float] = ...
    def __init__(self, time_usec: int, name: bytes, array_id: int, data: Sequence[float] = ...) -> None: ...

class MAVLink_ekf_status_report_message(MAVLink_message):
    flags: int
    velocity_variance: float
    pos_horiz_variance: float
    pos_vert_variance: float
    compass_variance: float
    terrain_alt_variance: float
    airspeed_variance: float = ...

class MAVLink_estimator_status_message(MAVLink_message):
    time_usec: int
    flags: int
    vel_ratio: float
    pos_horiz_ratio: float
    pos_vert_ratio: float
    mag_ratio: float
    hagl_ratio: float
    tas_ratio: float
    pos_horiz_accuracy: float
    pos_vert_accuracy: float

class MAVLink_extended_sys_state_message(MAVLink_message):
    vtol_state: int
    landed_state: int

class MAVLink_fence_status_message(MAVLink_message):
    breach_status: int
    breach_count: int
    breach_type: int
    breach_time: int
    breach_mitigation: int = ...

class MAVLink_file_transfer_protocol_message(MAVLink_message):
    target_network: int
    target_system: int
    target_component: int
    payload: Sequence[int]

class MAVLink_follow_target_message(MAVLink_message):
    timestamp: int
    est_capabilities: int
    lat: int
    lon: int
    alt: float
    vel: Sequence[float]
    acc: Sequence[float]
    attitude_q: Sequence[float]
    rates: Sequence[float]
    position_cov: Sequence[float]
    custom_state: int

class MAVLink_gimbal_device_attitude_status_message(MAVLink_message):
    target_system: int
    target_component: int
    time_boot_ms: int
    flags: int
    q: Sequence[float]
    angular_velocity_x: float
    angular_velocity_y: float
    angular_velocity_z: float
    failure_flags: int
    delta_yaw: float = ...
    delta_yaw_velocity: float = ...
    gimbal_device_id: int = ...

class MAVLink_gimbal_manager_information_message(MAVLink_message):
    time_boot_ms: int
    cap_flags: int
    gimbal_device_id: int
    roll_min: float
    roll_max: float
    pitch_min: float
    pitch_max: float
    yaw_min: float
    yaw_max: float

class MAVLink_gimbal_manager_set_attitude_message(MAVLink_message):
    target_system: int
    target_component: int
    flags: int
    gimbal_device_id: int
    q: Sequence[float]
    angular_velocity_x: float
    angular_velocity_y: float
    angular_velocity_z: float

class MAVLink_gimbal_manager_set_pitchyaw_message(MAVLink_message):
    target_system: int
    target_component: int
    flags: int
    gimbal_device_id: int
    pitch: float
    yaw: float
    pitch_rate: float
    yaw_rate: float

class MAVLink_gimbal_manager_status_message(MAVLink_message):
    time_boot_ms: int
    flags: int
    gimbal_device_id: int
    primary_control_sysid: int
    primary_control_compid: int
    secondary_control_sysid: int
    secondary_control_compid: int

class MAVLink_global_position_int_message(MAVLink_message):
    time_boot_ms: int
    lat: int
    lon: int
    alt: int
    relative_alt: int
    vx: int
    vy: int
    vz: int
    hdg: int

class MAVLink_gps_global_origin_message(MAVLink_message):
    latitude: int
    longitude: int
    altitude: int
    time_usec: int = ...

class MAVLink_gps_raw_int_message(MAVLink_message):
    time_usec: int
    fix_type: int
    lat: int
    lon: int
    alt: int
    eph: int
    epv: int
    vel: int
    cog: int
    satellites_visible: int
    alt_ellipsoid: int = ...
    h_acc: int = ...
    v_acc: int = ...
    vel_acc: int = ...
    hdg_acc: int = ...
    yaw: int = ...

class MAVLink_heartbeat_message(MAVLink_message):
    type: int
    autopilot: int
    base_mode: int
    custom_mode: int
    system_status: int
    mavlink_version: int

class MAVLink_highres_imu_message(MAVLink_message):
    time_usec: int
    xacc: float
    yacc: float
    zacc: float
    xgyro: float
    ygyro: float
    zgyro: float
    xmag: float
    ymag: float
    zmag: float
    abs_pressure: float
    diff_pressure: float
    pressure_alt: float
    temperature: float
    fields_updated: int
    id: int = ...

class MAVLink_hil_state_quaternion_message(MAVLink_message):
    time_usec: int
    attitude_quaternion: Sequence[float]
    rollspeed: float
    pitchspeed: float
    yawspeed: float
    lat: int
    lon: int
    alt: int
    vx: int
    vy: int
    vz: int
    ind_airspeed: int
    true_airspeed: int
    xacc: int
    yacc: int
    zacc: int

class MAVLink_home_position_message(MAVLink_message):
    latitude: int
    longitude: int
    altitude: int
    x: float
    y: float
    z: float
    q: Sequence[float]
    approach_x: float
    approach_y: float
    approach_z: float
    time_usec: int = ...

class MAVLink_local_position_ned_message(MAVLink_message):
    time_boot_ms: int
    x: float
    y: float
    z: float
    vx: float
    vy: float
    vz: float

class MAVLink_log_data_message(MAVLink_message):
    id: int
    ofs: int
    count: int
    data: Sequence[int]

class MAVLink_log_entry_message(MAVLink_message):
    id: int
    num_logs: int
    last_log_num: int
    time_utc: int
    size: int

class MAVLink_log_erase_message(MAVLink_message):
    target_system: int
    target_component: int

class MAVLink_log_request_data_message(MAVLink_message):
    target_system: int
    target_component: int
    id: int
    ofs: int
    count: int

class MAVLink_log_request_end_message(MAVLink_message):
    target_system: int
    target_component: int

class MAVLink_log_request_list_message(MAVLink_message):
    target_system: int
    target_component: int
    start: int
    end: int

class MAVLink_manual_control_message(MAVLink_message):
    target: int
    x: int
    y: int
    z: int
    r: int
    buttons: int
    buttons2: int = ...
    enabled_extensions: int = ...
    s: int = ...
    t: int = ...
    aux1: int = ...
    aux2: int = ...
    aux3: int = ...
    aux4: int = ...
    aux5: int = ...
    aux6: int = ...

class MAVLink_meminfo_message(MAVLink_message):
    brkval: int
    freemem: int
    freemem32: int = ...

class MAVLink_message_interval_message(MAVLink_message):
    message_id: int
    interval_us: int

class MAVLink_mission_ack_message(MAVLink_message):
    target_system: int
    target_component: int
    type: int
    mission_type: int = ...
    opaque_id: int = ...

class MAVLink_mission_clear_all_message(MAVLink_message):
    target_system: int
    target_component: int
    mission_type: int = ...

class MAVLink_mission_count_message(MAVLink_message):
    target_system: int
    target_component: int
    count: int
    mission_type: int = ...
    opaque_id: int = ...

class MAVLink_mission_current_message(MAVLink_message):
    seq: int
    total: int = ...
    mission_state: int = ...
    mission_mode: int = ...
    mission_id: int = ...
    fence_id: int = ...
    rally_points_id: int = ...

class MAVLink_mission_item_int_message(MAVLink_message):
    target_system: int
    target_component: int
    seq: int
    frame: int
    command: int
    current: int
    autocontinue: int
    param1: float
    param2: float
    param3: float
    param4: float
    x: int
    y: int
    z: float
    mission_type: int = ...

class MAVLink_mission_item_message(MAVLink_message):
    target_system: int
    target_component: int
    seq: int
    frame: int
    command: int
    current: int
    autocontinue: int
    param1: float
    param2: float
    param3: float
    param4: float
    x: float
    y: float
    z: float
    mission_type: int = ...

class MAVLink_mission_item_reached_message(MAVLink_message):
    seq: int

class MAVLink_mission_request_int_message(MAVLink_message):
    target_system: int
    target_component: int
    seq: int
    mission_type: int = ...

class MAVLink_mission_request_list_message(MAVLink_message):
    target_system: int
    target_component: int
    mission_type: int = ...

class MAVLink_mission_request_message(MAVLink_message):
    target_system: int
    target_component: int
    seq: int
    mission_type: int = ...

class MAVLink_mission_request_partial_list_message(MAVLink_message):
    target_system: int
    target_component: int
    start_index: int
    end_index: int
    mission_type: int = ...

class MAVLink_mission_set_current_message(MAVLink_message):
    target_system: int
    target_component: int
    seq: int

class MAVLink_mission_write_partial_list_message(MAVLink_message):
    target_system: int
    target_component: int
    start_index: int
    end_index: int
    mission_type: int = ...

class MAVLink_mount_configure_message(MAVLink_message):
    target_system: int
    target_component: int
    mount_mode: int
    stab_roll: int
    stab_pitch: int
    stab_yaw: int

class MAVLink_mount_control_message(MAVLink_message):
    target_system: int
    target_component: int
    input_a: int
    input_b: int
    input_c: int
    save_position: int

class MAVLink_mount_status_message(MAVLink_message):
    target_system: int
    target_component: int
    pointing_a: int
    pointing_b: int
    pointing_c: int
    mount_mode: int = ...

class MAVLink_nav_controller_output_message(MAVLink_message):
    nav_roll: float
    nav_pitch: float
    nav_bearing: int
    target_bearing: int
    wp_dist: int
    alt_error: float
    aspd_error: float
    xtrack_error: float

class MAVLink_odometry_message(MAVLink_message):
    time_usec: int
    frame_id: int
    child_frame_id: int
    x: float
    y: float
    z: float
    q: Sequence[float]
    vx: float
    vy: float
    vz: float
    rollspeed: float
    pitchspeed: float
    yawspeed: float
    pose_covariance: Sequence[float]
    velocity_covariance: Sequence[float]
    reset_counter: int = ...
    estimator_type: int = ...
    quality: int = ...

class MAVLink_param_error_message(MAVLink_message):
    target_system: int
    target_component: int
    param_id: str
    param_index: int
    error: int
    def __init__(
        self, target_system: int, target_component: int, param_id: bytes, param_index: int, error: int
    ) -> None: ...

class MAVLink_param_request_list_message(MAVLink_message):
    target_system: int
    target_component: int

class MAVLink_param_request_read_message(MAVLink_message):
    target_system: int
    target_component: int
    param_id: str
    param_index: int
    def __init__(
        self, target_system: int, target_component: int, param_id: bytes, param_index: int
    ) -> None: ...

class MAVLink_param_set_message(MAVLink_message):
    target_system: int
    target_component: int
    param_id: str
    param_value: float
    param_type: int
    def __init__(
        self, target_system: int, target_component: int, param_id: bytes, param_value: float, param_type: int
    ) -> None: ...

class MAVLink_param_value_message(MAVLink_message):
    param_id: str
    param_value: float
    param_type: int
    param_count: int
    param_index: int
    def __init__(
        self, param_id: bytes, param_value: float, param_type: int, param_count: int, param_index: int
    ) -> None: ...

class MAVLink_ping_message(MAVLink_message):
    time_usec: int
    seq: int
    target_system: int
    target_component: int

class MAVLink_position_target_global_int_message(MAVLink_message):
    time_boot_ms: int
    coordinate_frame: int
    type_mask: int
    lat_int: int
    lon_int: int
    alt: float
    vx: float
    vy: float
    vz: float
    afx: float
    afy: float
    afz: float
    yaw: float
    yaw_rate: float

class MAVLink_position_target_local_ned_message(MAVLink_message):
    time_boot_ms: int
    coordinate_frame: int
    type_mask: int
    x: float
    y: float
    z: float
    vx: float
    vy: float
    vz: float
    afx: float
    afy: float
    afz: float
    yaw: float
    yaw_rate: float

class MAVLink_power_status_message(MAVLink_message):
    Vcc: int
    Vservo: int
    flags: int

class MAVLink_protocol_version_message(MAVLink_message):
    version: int
    min_version: int
    max_version: int
    spec_version_hash: Sequence[int]
    library_version_hash: Sequence[int]

class MAVLink_raw_imu_message(MAVLink_message):
    time_usec: int
    xacc: int
    yacc: int
    zacc: int
    xgyro: int
    ygyro: int
    zgyro: int
    xmag: int
    ymag: int
    zmag: int
    id: int = ...
    temperature: int = ...

class MAVLink_rc_channels_message(MAVLink_message):
    time_boot_ms: int
    chancount: int
    chan1_raw: int
    chan2_raw: int
    chan3_raw: int
    chan4_raw: int
    chan5_raw: int
    chan6_raw: int
    chan7_raw: int
    chan8_raw: int
    chan9_raw: int
    chan10_raw: int
    chan11_raw: int
    chan12_raw: int
    chan13_raw: int
    chan14_raw: int
    chan15_raw: int
    chan16_raw: int
    chan17_raw: int
    chan18_raw: int
    rssi: int

class MAVLink_rc_channels_override_message(MAVLink_message):
    target_system: int
    target_component: int
    chan1_raw: int
    chan2_raw: int
    chan3_raw: int
    chan4_raw: int
    chan5_raw: int
    chan6_raw: int
    chan7_raw: int
    chan8_raw: int
    chan9_raw: int = ...
    chan10_raw: int = ...
    chan11_raw: int = ...
    chan12_raw: int = ...
    chan13_raw: int = ...
    chan14_raw: int = ...
    chan15_raw: int = ...
    chan16_raw: int = ...
    chan17_raw: int = ...
    chan18_raw: int = ...

class MAVLink_request_data_stream_message(MAVLink_message):
    target_system: int
    target_component: int
    req_stream_id: int
    req_message_rate: int
    start_stop: int

class MAVLink_scaled_imu2_message(MAVLink_message):
    time_boot_ms: int
    xacc: int
    yacc: int
    zacc: int
    xgyro: int
    ygyro: int
    zgyro: int
    xmag: int
    ymag: int
    zmag: int
    temperature: int = ...

class MAVLink_scaled_pressure_message(MAVLink_message):
    time_boot_ms: int
    press_abs: float
    press_diff: float
    temperature: int
    temperature_press_diff: int = ...

class MAVLink_servo_output_raw_message(MAVLink_message):
    time_usec: int
    port: int
    servo1_raw: int
    servo2_raw: int
    servo3_raw: int
    servo4_raw: int
    servo5_raw: int
    servo6_raw: int
    servo7_raw: int
    servo8_raw: int
    servo9_raw: int = ...
    servo10_raw: int = ...
    servo11_raw: int = ...
    servo12_raw: int = ...
    servo13_raw: int = ...
    servo14_raw: int = ...
    servo15_raw: int = ...
    servo16_raw: int = ...

class MAVLink_set_attitude_target_message(MAVLink_message):
    time_boot_ms: int
    target_system: int
    target_component: int
    type_mask: int
    q: Sequence[float]
    body_roll_rate: float
    body_pitch_rate: float
    body_yaw_rate: float
    thrust: float

class MAVLink_set_gps_global_origin_message(MAVLink_message):
    target_system: int
    latitude: int
    longitude: int
    altitude: int
    time_usec: int = ...

class MAVLink_set_mode_message(MAVLink_message):
    target_system: int
    base_mode: int
    custom_mode: int

class MAVLink_set_position_target_global_int_message(MAVLink_message):
    time_boot_ms: int
    target_system: int
    target_component: int
    coordinate_frame: int
    type_mask: int
    lat_int: int
    lon_int: int
    alt: float
    vx: float
    vy: float
    vz: float
    afx: float
    afy: float
    afz: float
    yaw: float
    yaw_rate: float

class MAVLink_set_position_target_local_ned_message(MAVLink_message):
    time_boot_ms: int
    target_system: int
    target_component: int
    coordinate_frame: int
    type_mask: int
    x: float
    y: float
    z: float
    vx: float
    vy: float
    vz: float
    afx: float
    afy: float
    afz: float
    yaw: float
    yaw_rate: float

class MAVLink_setup_signing_message(MAVLink_message):
    target_system: int
    target_component: int
    secret_key: Sequence[int]
    initial_timestamp: int

class MAVLink_sim_state_message(MAVLink_message):
    q1: float
    q2: float
    q3: float
    q4: float
    roll: float
    pitch: float
    yaw: float
    xacc: float
    yacc: float
    zacc: float
    xgyro: float
    ygyro: float
    zgyro: float
    lat: float
    lon: float
    alt: float
    std_dev_horz: float
    std_dev_vert: float
    vn: float
    ve: float
    vd: float
    lat_int: int = ...
    lon_int: int = ...

class MAVLink_statustext_message(MAVLink_message):
    severity: int
    text: str
    id: int = ...
    chunk_seq: int = ...
    def __init__(self, severity: int, text: bytes, id: int = ..., chunk_seq: int = ...) -> None: ...

class MAVLink_storage_information_message(MAVLink_message):
    time_boot_ms: int
    storage_id: int
    storage_count: int
    status: int
    total_capacity: float
    used_capacity: float
    available_capacity: float
    read_speed: float
    write_speed: float
    type: int = ...
    name: str = ...
    storage_usage: int = ...
    def __init__(
        self,
        time_boot_ms: int,
        storage_id: int,
        storage_count: int,
        status: int,
        total_capacity: float,
        used_capacity: float,
        available_capacity: float,
        read_speed: float,
        write_speed: float,
        type: int = ...,
        name: bytes = ...,
        storage_usage: int = ...,
    ) -> None: ...

class MAVLink_sys_status_message(MAVLink_message):
    onboard_control_sensors_present: int
    onboard_control_sensors_enabled: int
    onboard_control_sensors_health: int
    load: int
    voltage_battery: int
    current_battery: int
    battery_remaining: int
    drop_rate_comm: int
    errors_comm: int
    errors_count1: int
    errors_count2: int
    errors_count3: int
    errors_count4: int
    onboard_control_sensors_present_extended: int = ...
    onboard_control_sensors_enabled_extended: int = ...
    onboard_control_sensors_health_extended: int = ...

class MAVLink_system_time_message(MAVLink_message):
    time_unix_usec: int
    time_boot_ms: int

class MAVLink_terrain_report_message(MAVLink_message):
    lat: int
    lon: int
    spacing: int
    terrain_height: float
    current_height: float
    pending: int
    loaded: int

class MAVLink_timesync_message(MAVLink_message):
    tc1: int
    ts1: int

class MAVLink_vfr_hud_message(MAVLink_message):
    airspeed: float
    groundspeed: float
    heading: int
    throttle: int
    alt: float
    climb: float

class MAVLink_vibration_message(MAVLink_message):
    time_usec: int
    vibration_x: float
    vibration_y: float
    vibration_z: float
    clipping_0: int
    clipping_1: int
    clipping_2: int

class MAVLink_wind_cov_message(MAVLink_message):
    time_usec: int
    wind_x: float
    wind_y: float
    wind_z: float
    var_horiz: float
    var_vert: float
    wind_alt: float
    horiz_accuracy: float
    vert_accuracy: float

class MAVLink_wind_message(MAVLink_message):
    direction: float
    speed: float
    speed_z: float
