"""Guard and arming gate, each by itself, against vehicles and links of every kind."""

from hypothesis import example, given, settings
from hypothesis import strategies as st

from mission.autopilots import ARDUPILOT
from mission.ground.arming_gate import ArmingGate, Stage
from mission.ground.change import FailsafeGuard
from mission.ground.contact import Contact
from mission.link.codec.dialect import mavlink as m

PREARM = m.MAV_SYS_STATUS_PREARM_CHECK


class Parameters:
    """A vehicle with parameters, on a link that loses and delays."""

    def __init__(self, values, *, lost=()):
        self.values, self.lost = dict(values), set(lost)
        self.states = [dict(values)]  # After each change
        self.messages = 0

    def receive(self, message):
        self.messages += 1
        if self.messages in self.lost:
            return []
        name = message.param_id.decode() if isinstance(message.param_id, bytes) else message.param_id
        if message.get_type() == "PARAM_SET":
            self.values[name] = round(message.param_value)
            self.states.append(dict(self.values))
        return [m.MAVLink_param_value_message(name.encode(), float(self.values[name]), 6, 1, 0)]


def guarded(vehicle, needed, *, late_s=0.0):
    """Let a guard do its work over a link whose answers come late."""
    notes, arrivals, now_s = [], [], 0.0
    contact = Contact((1, 1), is_real=True)
    if late_s:
        contact.round_trip.sample(late_s)
    guard = FailsafeGuard(needed, contact, notes)
    out = guard.begin(now_s)
    while not (guard.ready or guard.refused):
        arrivals += [(now_s + late_s, answer) for message in out for answer in vehicle.receive(message)]
        now_s = min([guard.due_s, *(arrival_s for arrival_s, _ in arrivals)])
        assert now_s < 100.0, "it never ends"
        arrived = arrivals and arrivals[0][0] <= now_s
        out = guard.receive(arrivals.pop(0)[1]) if arrived else guard.poll(now_s)
    return guard, notes


kinds = sorted(ARDUPILOT.change_failsafe)


@given(
    kind=st.sampled_from(kinds),
    values=st.lists(st.integers(0, 30), min_size=4, max_size=4),
    late_s=st.sampled_from([0.0, 0.3, 0.9, 1.1, 1.7]),
    lost=st.integers(0, 6),
)
def test_the_failsafe_is_switched_on_last_and_what_was_set_is_told(kind, values, late_s, lost):
    """After each setting, at which the link may break, the vehicle comes home at least as it did before."""
    needed = ARDUPILOT.change_failsafe[kind]
    given_values = {one.name: value for one, value in zip(needed, values, strict=False)}
    vehicle = Parameters(given_values, lost={lost})
    guard, notes = guarded(vehicle, needed, late_s=late_s)
    assert guard.ready and not guard.refused
    names = [one.name for one in needed]
    assert all(one.wanted(vehicle.values[one.name]) == vehicle.values[one.name] for one in needed)
    for state in vehicle.states:
        set_already = [name for name in names if state[name] != given_values[name]]
        wanted = [one.name for one in needed if one.wanted(given_values[one.name]) != given_values[one.name]]
        assert set_already == wanted[: len(set_already)], "one after the other, in their order"
    assert notes == [
        f"{name} was {given_values[name]}, is set to {vehicle.values[name]} and stays so"
        for name in names
        if vehicle.values[name] != given_values[name]
    ]


def status(present, healthy):
    bits = PREARM * present, 0, PREARM * healthy
    return m.MAVLink_sys_status_message(*bits, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0)


orders = st.sampled_from(["agree", "hold", "release", "refuse", "again"])
reports = st.tuples(st.booleans(), st.booleans(), st.booleans())


@settings(deadline=None, max_examples=200)
@given(st.booleans(), st.lists(st.one_of(orders, reports), max_size=12))
@example(False, ["hold", (True, True, True), "agree"])
@example(True, ["hold", (True, True, True)])
@example(True, [(True, True, True), "again"])
def test_motors_start_only_where_vehicle_operator_and_the_others_are_ready(agreed, steps):
    gate = ArmingGate((1, 1), agreed=agreed)
    willing = refused = held = able = granted = False
    willing = agreed
    for step in steps:
        if isinstance(step, tuple):
            knows, healthy, position = step
            gate.on_sys_status(status(knows, healthy), has_position=position)
            if not (granted or refused):
                able = position and (healthy or not knows)
        elif step == "agree":
            gate.agree()
            willing = True
        elif step == "hold":
            gate.hold()
            held = True
        elif step == "release":
            gate.release()
            held = False
        elif step == "refuse":
            gate.refuse()
            refused, granted = True, False
        elif not refused:
            gate.check_again(1.0)
            able, granted, willing = False, False, agreed
        granted = granted or (able and willing and not held and not refused)
        assert (gate.stage is Stage.GRANTED) is granted
        assert (gate.stage is Stage.REFUSED) is refused
        if not (granted or refused):
            stage = Stage.CHECKING if not able else Stage.WAITING if willing else Stage.ASKING
            assert gate.stage is stage
