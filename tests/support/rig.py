"""A vehicle without links, its clock, and the orders that a safety test gives it."""

from geo.frame import LocalFrame
from mission.link.codec.dialect import mavlink as m
from mission.model import GeoPoint
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot.px4 import PX4
from sim_vehicle.execution.state import FlightPhase
from sim_vehicle.mavlink import SimVehicle

HOME = GeoPoint(28.05, -82.15, 20.0)
FRAME = LocalFrame(HOME.latitude_deg, HOME.longitude_deg, HOME.altitude_m)
QUAD = get_vehicle("quad")


class Rig:
    """A vehicle and its clock."""

    def __init__(self, autopilot=PX4, spec=QUAD, **tuning):
        self.vehicle = SimVehicle(spec, HOME, autopilot=autopilot)
        self.pilot = self.vehicle.pilot
        self.now_s, self.texts, self.sent = 0.0, [], []
        self.tune(**tuning)
        self.run(0.1)

    def tune(self, **values):
        for name, value in values.items():
            assert hasattr(self.pilot.parameters, name)
            setattr(self.pilot.parameters, name, value)
        self.pilot.apply_parameters()

    def take(self, messages):
        self.sent += messages
        for message in messages:
            if message.get_type() == "STATUSTEXT":
                self.texts.append(message.text)

    def run(self, seconds, until=None, beats=False, stream=None):
        end_s = self.now_s + seconds
        while self.now_s < end_s - 1e-9 and not (until and until()):
            self.now_s = round(self.now_s + 0.1, 6)
            if beats and round(self.now_s * 10) % 10 == 0:
                self.beat()
            if stream is not None:
                self.tell(stream)
            self.take(self.vehicle.poll(self.now_s))

    def tell(self, message, system=255, component=190):
        # A message that crossed no wire has no sender of its own.
        message._header.srcSystem, message._header.srcComponent = system, component
        self.take(self.vehicle.receive(message, self.now_s))

    def beat(self):
        self.tell(m.MAVLink_heartbeat_message(m.MAV_TYPE_GCS, 8, 0, 0, 4, 3))

    def command(self, number, *params):
        before = len(self.sent)
        self.tell(m.MAVLink_command_long_message(1, 1, number, 0, *params, *[0.0] * (7 - len(params))))
        return next(s.result for s in self.sent[before:] if s.get_type() == "COMMAND_ACK")

    def aloft(self, height_m=20.0, beats=False):
        self.pilot.arm()
        self.pilot.takeoff(height_m)
        self.run(30.0, until=lambda: self.pilot.state.phase is FlightPhase.HOLD, beats=beats)
        return self

    def goto(self, x, y, z=20.0, **options):
        mode = self.vehicle.firmware.mavlink.modes.after_command
        self.pilot.goto(*FRAME.to_wgs84(float(x), float(y)), z, mode=mode, **options)

    def drift(self, x, y, up=0.0):
        """Fly at a velocity, which the fence does not judge beforehand."""
        self.pilot.executor.steer((x, y, up))

    @property
    def place(self):
        return self.pilot.state.position_m

    def health(self, bit):
        built = self.vehicle.built(m.MAVLINK_MSG_ID_SYS_STATUS)[0]
        return bool(built.onboard_control_sensors_health & bit)
