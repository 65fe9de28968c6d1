"""A client and a server over a bad link in virtual time, for tests of the mission transfer."""

from __future__ import annotations

import numpy as np

from mission.link.codec.frames import FrameReader, FrameWriter
from mission.link.faults import Faults, FaultyChannel
from mission.model import MissionItem, MissionType

LIMIT_S = 3600.0
GROUND = (255, 190)


def make_items(
    number: int, seed: int, mission_type: MissionType = MissionType.MISSION
) -> tuple[MissionItem, ...]:
    rng = np.random.default_rng(seed)
    items = []
    for _ in range(number):
        place = {
            "x": float(rng.uniform(-80, 80)),
            "y": float(rng.uniform(-170, 170)),
            "z": float(np.float32(rng.uniform(0, 50))),
        }
        if mission_type == MissionType.MISSION:
            items.append(MissionItem.waypoint(place["x"], place["y"], place["z"]))
        elif mission_type == MissionType.RALLY:
            items.append(MissionItem(5100, 3, **place))
        else:
            items.append(MissionItem(5003, 3, param1=float(np.float32(rng.uniform(1, 9))), **place))
    return tuple(items)


class Network:
    """A client and a server, bytes between them, and a clock that jumps."""

    def __init__(self, server, up: Faults, down: Faults, seed: int = 0) -> None:
        first, second = np.random.default_rng(seed).spawn(2)
        self.server = server
        self.up, self.down = FaultyChannel(up, first), FaultyChannel(down, second)
        self.ground_out, self.ground_in = FrameWriter(*GROUND), FrameReader()
        self.vehicle_out, self.vehicle_in = FrameWriter(1, 1), FrameReader()
        self.now_s = 100.0
        self.client_events: list = []
        self.server_events: list = []
        self.steps = 0

    def ground(self, output) -> None:
        self.client_events += output.events
        for message in output.messages:
            self.up.send(self.ground_out.encode(message), self.now_s)

    def vehicle(self, output) -> None:
        self.server_events += output.events
        for message in output.messages:
            self.down.send(self.vehicle_out.encode(message), self.now_s)

    def deliver(self, client) -> None:
        for data in self.up.receive(self.now_s):
            for message in self.vehicle_in.feed(data):
                self.vehicle(self.server.receive(message, self.now_s))
        for data in self.down.receive(self.now_s):
            for message in self.ground_in.feed(data):
                self.ground(client.receive(message, self.now_s))

    def run(self, client):
        """Run until the client is done and the air is empty; return the client's last event."""
        self.ground(client.start(self.now_s))
        begun_s = self.now_s
        while True:
            self.steps += 1
            times = [
                time
                for time in (
                    self.up.next_arrival(),
                    self.down.next_arrival(),
                    client.next_deadline(),
                    self.server.next_deadline(),
                )
                if time is not None
            ]
            if not times:
                break
            self.now_s = max(self.now_s, min(times))
            assert self.now_s - begun_s < LIMIT_S, "the transfer hangs"
            assert self.steps < 200_000, "the transfer spins"
            self.deliver(client)
            self.ground(client.poll(self.now_s))
            self.vehicle(self.server.poll(self.now_s))
        assert client.done
        assert not self.server.busy
        return self.client_events[-1]
