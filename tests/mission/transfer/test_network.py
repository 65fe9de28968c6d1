"""Client and server over a bad link in virtual time: the promise of the transfer, as a property."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sweeps import sweep
from transfer_network import GROUND, Network, make_items

from mission.autopilots import ARDUPILOT, GENERIC, PX4
from mission.link.faults import Faults
from mission.model import MissionType
from mission.transfer import (
    DownloadComplete,
    MissionDownload,
    MissionServer,
    PlanReplaced,
    PlanState,
    RoundTrip,
    TransferFailed,
    UploadComplete,
    UploadVerified,
    VerifiedUpload,
)


def check_promise(server, old, new, end, mission_type) -> str:
    """New plan and success, or failure and the old plan; when unconfirmed, one of the two, whole."""
    held = server.plan(mission_type).items
    assert held in (old, new), "half a plan"
    if isinstance(end, UploadVerified | UploadComplete):
        assert held == new
        return "new"
    assert isinstance(end, TransferFailed)
    if end.vehicle_plan is PlanState.OLD:
        assert held == old
        return "old"
    return "unknown"


faults = st.builds(
    Faults,
    loss=st.floats(0, 0.3),
    duplicate=st.floats(0, 0.3),
    corrupt=st.floats(0, 0.05),
    delay_s=st.floats(0, 0.3),
    jitter_s=st.floats(0, 0.3),
)


@sweep(few=60, many=300)
@given(
    number=st.integers(0, 25),
    kind=st.sampled_from(list(MissionType)),
    up=faults,
    down=faults,
    seed=st.integers(0, 2**32 - 1),
)
def test_what_arrives_is_what_was_sent(number, kind, up, down, seed):
    server = MissionServer(1, profile=GENERIC)
    old, new = make_items(7, 1, kind), make_items(number, 2, kind)
    server.set_plan(kind, old)
    network = Network(server, up, down, seed)
    client = VerifiedUpload(new, kind, source=GROUND)
    end = network.run(client)
    outcome = check_promise(server, old, new, end, kind)
    if outcome == "old":
        assert not any(isinstance(event, PlanReplaced) for event in network.server_events)
    others = [other for other in MissionType if other != kind]
    assert all(server.plan(other).items == () for other in others)


class Counting(Network):
    """A network that counts what the ground sends."""

    def __init__(self, *given) -> None:
        super().__init__(*given)
        self.sent: list = []

    def ground(self, output) -> None:
        self.sent += [(self.now_s, message) for message in output.messages]
        super().ground(output)

    def copies(self, kind):
        """When each item went up, or was asked for."""
        found: dict[int, list[float]] = {}
        for time_s, message in self.sent:
            if message.get_type() == kind:
                found.setdefault(message.seq, []).append(time_s)
        return found


@pytest.mark.parametrize("profile", [PX4, ARDUPILOT], ids=["px4", "ardupilot"])
@pytest.mark.parametrize("delay_s", [0.05, 0.5, 1.0, 2.0])
def test_a_slow_link_is_not_flooded(profile, delay_s):
    """A vehicle that asks every quarter of a second is answered once in a round trip."""
    server = MissionServer(1, profile=profile)
    new = make_items(12, 4)
    link = Faults(delay_s=delay_s, baud=57600.0)
    network = Counting(server, link, link, 1)
    client = VerifiedUpload(new, source=GROUND, profile=profile)
    assert isinstance(network.run(client), UploadVerified)
    counts = [message for _, message in network.sent if message.get_type() == "MISSION_COUNT"]
    assert len(counts) <= 1 + 2.0 * delay_s / 1.5
    for times_s in network.copies("MISSION_ITEM_INT").values():
        assert len(times_s) <= 2
        assert np.all(np.diff(times_s) >= 2.0 * delay_s - 1e-6)
    asked = network.copies("MISSION_REQUEST_INT")
    assert sum(map(len, asked.values())) <= 2 * len(asked)
    # Items, requests and their answers; nothing is sent that nobody asked for.
    assert sum(len(network.ground_out.encode(message)) for _, message in network.sent) < 120 * len(new) + 200


@pytest.mark.parametrize("profile", [PX4, ARDUPILOT], ids=["px4", "ardupilot"])
@pytest.mark.parametrize("delay_s", [0.3, 2.0])
def test_thirty_percent_loss_each_way_on_a_slow_link(profile, delay_s):
    """A vehicle gives up after 5 or 8 s of nothing new: a few copies a round trip, and it works."""
    uploaded = 0
    for seed in range(12):
        server = MissionServer(1, profile=profile)
        new = make_items(15, seed)
        bad = Faults(loss=0.3, delay_s=delay_s, baud=57600.0)
        network = Counting(server, bad, bad, seed)
        trip = RoundTrip()
        trip.loss = 0.3
        client = VerifiedUpload(new, source=GROUND, profile=profile, round_trip=trip)
        uploaded += isinstance(network.run(client), UploadVerified)
        most = trip.copies(profile.abort_s)[0]
        for times_s in network.copies("MISSION_ITEM_INT").values():
            for time_s in times_s:
                in_a_trip = [one for one in times_s if time_s <= one < time_s + 2.0 * delay_s - 1e-6]
                assert len(in_a_trip) <= 2 * most <= 8
        sent = sum(len(network.ground_out.encode(message)) for _, message in network.sent)
        assert sent < 0.1 * 5760.0 * (network.now_s - 100.0), "a tenth of the line is enough"
    assert uploaded >= 11


@sweep(few=60, many=300)
@given(
    number=st.integers(0, 25),
    up=faults,
    down=faults,
    seed=st.integers(0, 2**32 - 1),
    window=st.integers(1, 12),
)
def test_a_download_is_the_vehicles_plan_or_fails(number, up, down, seed, window):
    profile = ARDUPILOT if window > 1 else GENERIC
    server = MissionServer(1, profile=profile)
    plan = make_items(number, 5)
    server.set_plan(MissionType.MISSION, plan)
    network = Network(server, up, down, seed)
    end = network.run(MissionDownload(source=GROUND, profile=profile, window=window))
    if isinstance(end, DownloadComplete):
        assert end.items == plan
    else:
        assert isinstance(end, TransferFailed)
    assert server.plan(MissionType.MISSION).items == plan
