"""What who watches a flight orders: refused or taken at once, carried out by who flies."""

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from mission.outcome import Outcome
from wbf_mission import Simulated, fly
from wbf_mission.events import Asked, Decided, EventStream, Noted, Orderable, VehicleMoved
from wbf_mission.run.orders import LIFE_S, Orders
from wbf_mission.scenario import Scenario


def heard_orders():
    stream, heard = EventStream(), []
    stream.listen(heard.append)
    return Orders(stream), heard


@pytest.mark.parametrize(
    ("asked", "text"),
    [
        (([1], "jump"), "'jump' cannot be ordered now"),
        (([1], "return"), "'return' cannot be ordered now"),
        (([7], "hold"), "there is no vehicle 7 to take the order"),
        (([], "hold"), "there is no vehicle named to take the order"),
        (([1], "start"), "start starts motors: it has to be confirmed"),
        (([1], "arm", "", "yes"), "arm starts motors: it has to be confirmed"),
        (([1], "takeoff", "10"), "takeoff starts motors: it has to be confirmed"),
        (([1], "takeoff", "2000", True), "takeoff 2000: give a height above home of 1 to 1000 metres"),
        (([1], "set item", "0"), "set-item 0: give the number of an item, counted from 1"),
        (([1], "set item", "1e3"), "set-item 1e3: give the number of an item, counted from 1"),
        (([1], "hold", "now"), "hold now: hold takes nothing more; leave 'now' out"),
        (([1, 2], "land"), "land is for 2 vehicles: it has to be confirmed"),
        (([2, 1], "land", "", "yes"), "land is for 2 vehicles: it has to be confirmed"),
    ],
)
def test_what_may_not_be_ordered_is_refused_at_once(asked, text):
    orders, _ = heard_orders()
    orders.allow(("start", "arm", "takeoff", "hold", "set item", "land"), {1, 2})
    assert orders.take(*asked) == text
    assert orders.taken() == [] and not orders.waits


def test_nothing_may_be_ordered_before_somebody_flies():
    orders, heard = heard_orders()
    assert orders.take([1], "hold") == "'hold' cannot be ordered now"
    orders.allow(("hold",), {1})
    orders.allow(("hold",), {1, 2})
    assert heard == [Orderable(("hold",))], "told when it changes"
    assert orders.take([2], "hold") == ""
    assert [one.is_for(1) for one in orders.taken()] == [False]
    for _ in range(200):
        last = orders.take([1, 2], "hold")
    assert last == "too many orders wait already", "a page that floods does not fill the memory"


def test_an_order_that_came_too_late_is_not_for_the_next_flight():
    orders, _ = heard_orders()
    orders.allow(("hold",), {1})
    assert orders.take([1], "hold") == ""
    orders.allow((), ())
    orders.allow(("hold",), {1})
    assert orders.taken() == []


def test_only_the_words_of_the_open_question_answer_it():
    orders, heard = heard_orders()
    assert orders.answer("no more", 0) == "'no more' is not a valid answer"
    orders.ask("change the battery", ("battery changed", "no more"))
    orders.ask("change the battery", ("battery changed", "no more"))
    (number,) = [one.number for one in heard if isinstance(one, Asked)]
    assert orders.answer("y", number) == "'y' is not a valid answer: give battery changed or no more"
    assert orders.answer("no more", number) == ""
    assert orders.answered() == "no more"
    assert orders.answered() is None
    assert orders.answer("battery changed", number) == ""
    orders.ask("")
    assert orders.answered() is None, "an answer is to the question for which it was given"
    assert [one.question for one in heard if isinstance(one, Asked)] == ["change the battery", ""]


def test_an_answer_to_the_question_before_does_not_answer_the_next_one():
    orders, heard = heard_orders()
    orders.ask("sortie 2 of 3?", ("battery changed", "no more"))
    orders.ask("sortie 3 of 3?", ("battery changed", "no more"))
    first, second = (one.number for one in heard)
    assert orders.answer("battery changed", first) == ("the question has changed: look at the page")
    assert orders.answered() is None
    assert orders.answer("battery changed", second) == ""


@given(ages=st.lists(st.tuples(st.floats(0.0, 10.0), st.floats(0.0, 10.0)), min_size=1, max_size=8))
@example(ages=[(0.0, LIFE_S + 0.01)])
@example(ages=[(LIFE_S + 0.01, 0.0)])
@example(ages=[(LIFE_S, 0.0)])
def test_what_is_older_than_two_seconds_is_not_carried_out_whereever_it_got_old(ages):
    now_s, warned = [1e6], []
    stream = EventStream()
    stream.listen(lambda event: warned.append(event.text) if event.warns else None, Noted)
    orders = Orders(stream, clock=lambda: now_s[0])
    orders.allow(("hold",), {1})
    orders.ask("?", ("yes",))
    for on_the_way_s, waiting_s in ages:
        warned.clear()
        refused = orders.take([1], "hold", age_s=on_the_way_s)
        unanswered = orders.answer("yes", 1, age_s=on_the_way_s)
        assert bool(refused) is bool(unanswered) is (on_the_way_s > LIFE_S)
        now_s[0] += waiting_s
        age_s = on_the_way_s + waiting_s
        taken, answered = orders.taken(), orders.answered()
        if abs(age_s - LIFE_S) > 1e-6:
            assert bool(taken) is (answered == "yes") is (age_s < LIFE_S)
            late = on_the_way_s <= LIFE_S < age_s
            assert len(warned) == 2 * late and all("too late: it was given" in one for one in warned)
        assert orders.taken() == [] and orders.answered() is None


def test_an_order_is_for_the_vehicles_that_were_there_when_it_was_given():
    orders, _ = heard_orders()
    orders.allow(("hold",), {1, 2})
    assert orders.take([2, 1], "hold") == ""
    orders.allow(("hold",), {1, 2, 3})
    (order,) = orders.taken()
    assert [order.is_for(number) for number in (1, 2, 3)] == [True, True, False]
    assert orders.take([3, 9], "hold") == "", "who is there takes it"


class Watcher:
    """Orders one thing after the other, each when the vehicle shows what is waited for."""

    def __init__(self, *steps):
        self.stream, self.modes, self.notes = EventStream(), [], []
        # However slow the machine is, no order grows too old.
        self.orders, self._steps = Orders(self.stream, clock=lambda: 0.0), list(steps)
        self.stream.listen(self.look, VehicleMoved)
        self.stream.listen(lambda one: self.notes.append(one.text), Noted)

    def look(self, moved):
        if not self.modes or self.modes[-1] != moved.mode:
            self.modes.append(moved.mode)
        if self._steps and self._steps[0][0](moved):
            _, order, value = self._steps.pop(0)
            assert self.orders.take([1], order, value) == ""

    def fly(self, **options):
        given = {"farm": "miniberry-10", "budget": "2min", "estimator": "point"}
        if "policy" not in options:
            given["planner"] = "lawnmower"
        return fly(Scenario(**(given | options)), by=Simulated(orders=self.orders), events=self.stream)


def in_mode(*names):
    return lambda moved: moved.mode in names


def at_item(item):
    return lambda moved: moved.item is not None and moved.item >= item


HOLDS = in_mode("LOITER", "BRAKE")


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_simulated_vehicle_holds_goes_on_and_finishes_its_mission(autopilot):
    watcher = Watcher((at_item(3), "hold", ""), (HOLDS, "resume", ""))
    result = watcher.fly(autopilot=autopilot)
    hold, mission = {"px4": ("LOITER", "MISSION"), "ardupilot": ("BRAKE", "AUTO")}[autopilot]
    at = watcher.modes.index(hold)
    assert watcher.modes[at - 1] == watcher.modes[at + 1] == mission
    assert watcher.notes == ["ordered by the page: hold", "ordered by the page: resume"]
    assert result.outcome is Outcome.COMPLETED
    (warning,) = [one for one in result.warnings if "by hand" in one]
    assert warning.startswith("ordered by hand: hold at ")
    assert warning.endswith("the seed cannot repeat this flight")


@pytest.mark.parametrize(
    ("order", "autopilot"),
    [("return", "px4"), ("land", "ardupilot"), ("return", "ardupilot"), ("land", "px4")],
)
def test_a_simulated_vehicle_comes_down_when_it_is_told_to(order, autopilot):
    result = Watcher((at_item(3), order, "")).fly(autopilot=autopilot)
    assert result.outcome is Outcome.INTERRUPTED
    assert result.reason == f"the operator ordered the vehicle to {order}"
    assert len(result.observations), "what was seen until then is kept"


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_simulated_vehicle_flies_on_from_another_item(autopilot):
    plain = Watcher().fly(autopilot=autopilot)
    last = len(plain.plan.mission.items) - 1
    watcher = Watcher((at_item(4), "set item", str(last)), (at_item(4), "set item", "400"))
    result = watcher.fly(autopilot=autopilot)
    assert result.outcome is Outcome.COMPLETED
    assert len(result.observations) < len(plain.observations), "what lies between is not flown"
    assert watcher.notes[-1].startswith("item 400 does not exist; there are ")
    assert not plain.warnings


def test_a_policy_is_not_asked_while_the_operator_holds_the_vehicle():
    held = []

    def long_enough(moved):
        held.extend([moved.time_s] if HOLDS(moved) else [])
        return bool(held) and moved.time_s > held[0] + 20.0

    watcher = Watcher((lambda moved: moved.time_s > 25.0, "hold", ""), (long_enough, "resume", ""))
    decided = []
    watcher.stream.listen(lambda one: decided.append(one.time_s), Decided)
    result = watcher.fly(policy="greedy", autopilot="px4")
    assert result.outcome is Outcome.COMPLETED
    assert not [one for one in decided if held[0] <= one <= held[-1]]
    assert decided[-1] > held[-1], "it is asked again when the vehicle goes on"


def test_one_of_two_vehicles_is_ordered_alone():
    watcher = Watcher()
    done = []

    def order(moved):
        if moved.system_id == 2 and (moved.item or 0) >= 3 and not done:
            done.append(watcher.orders.take([2], "return"))

    watcher.stream.listen(order, VehicleMoved)
    result = watcher.fly(vehicles=2)
    assert done == [""]
    by_vehicle = {one.system_id: one.outcome for one in result.flights}
    assert by_vehicle == {1: Outcome.COMPLETED, 2: Outcome.INTERRUPTED}
    assert watcher.notes == ["vehicle 2: ordered by the page: return"]
