"""Datagrams that wait: each sender has its share of the memory, whoever else sends."""

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from mission.link import sockets
from mission.link.sockets import WaitingDatagrams

SHARES, SHARE = 4, 1000  # The last share is that of all other senders
BYTES = SHARES * SHARE
VEHICLE = ("10.0.0.1", 14550)


@pytest.fixture(scope="module", autouse=True)
def _small():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sockets, "_SHARES", SHARES)
        patch.setattr(sockets, "_MOST_BYTES", BYTES)
        patch.setattr(sockets, "_OVERHEAD_BYTES", 10)
        yield


def stranger(number):
    return ("10.0.0.2", number)


class Line:
    """What senders sent, and what came out of the queue."""

    def __init__(self):
        self.queue = WaitingDatagrams()
        self.sent, self.came, self.overrun = [], [], set()

    def send(self, peer, size):
        data = len(self.sent).to_bytes(4, "big") + bytes(size - 14)
        self.sent.append((data, peer))
        self.queue.put(data, peer)
        if self.held(peer) > SHARE:
            self.overrun.add(peer)

    def take(self, most):
        taken = self.queue.take(most)
        assert len(taken) <= most
        self.came += taken
        assert [data for data, _ in self.came] == sorted(data for data, _ in self.came), "as they arrived"
        assert bool(self.queue) is (self.held() > 0)

    def held(self, peer=None):
        """Bytes of a sender that wait as long as none of them is dropped, or of all that do wait."""
        if peer is None:
            return sum(share.held_bytes for share in (self.queue._others, *self.queue._shares.values()))
        came = {data for data, _ in self.came}
        return sum(len(data) + 10 for data, sender in self.sent if sender == peer and data not in came)

    def check(self, peer):
        assert [data for data, sender in self.came if sender == peer] == [
            data for data, sender in self.sent if sender == peer
        ]


STEPS = st.lists(
    st.tuples(st.integers(0, SHARES - 2), st.integers(14, 1500))
    | st.integers(1, 8).map(lambda most: (None, most)),
    max_size=60,
)


@given(STEPS)
@example([(0, 1000), *[(1, 1500)] * 3, (2, 1000), (1, 14)])
@example([(0, 14)] * (BYTES // 14) + [(1, 900), (None, 8)])
def test_a_sender_within_its_share_loses_nothing(steps):
    line = Line()
    for number, size in steps:
        if number is None:
            line.take(size)
        else:
            line.send(stranger(number), size)
        assert line.held() <= BYTES
    lost = {f"10.0.0.2:{peer[1]}" for peer in line.overrun}
    assert line.queue.dropped.keys() <= lost, "who loses datagrams has sent more than its share"
    line.take(1000)
    for number in range(SHARES - 1):
        if stranger(number) not in line.overrun:
            line.check(stranger(number))
    assert len(line.came) + sum(line.queue.dropped.values()) == len(line.sent)
    assert line.held() == 0


@given(
    st.lists(st.integers(0, 10) | st.just(None), max_size=200),
    st.lists(st.integers(0, 199), max_size=9, unique=True).map(set),
    st.booleans(),
)
def test_a_vehicle_that_was_heard_loses_nothing_to_forged_addresses(strangers, turns, taken):
    """Datagrams of the vehicle come in between those of any number of senders, which are not taken."""
    line = Line()
    for _ in range(30):
        line.send(VEHICLE, 100)
        line.take(1)
    for turn, number in enumerate(strangers):
        line.send(stranger(turn if number is None else number), 500)
        if taken and not turn % 10:
            line.take(1)
        if turn in turns:
            line.send(VEHICLE, 100)
    assert len(line.queue._shares) < SHARES
    line.take(1000)
    line.check(VEHICLE)
    assert line.queue.dropped.keys() <= {f"10.0.0.2:{turn}" for turn in range(200)} | {"other senders"}
    assert len(line.came) + sum(line.queue.dropped.values()) == len(line.sent)
