"""The stream of events that terminal, files and pages share."""

from wbf_mission.events import EventStream, Noted, Progressed, VehicleMoved


def test_every_listener_hears_every_event_in_order():
    stream, first, second = EventStream(), [], []
    stream.listen(first.append)
    stream.listen(second.append)
    stream.tell(Noted("one"))
    stream.progress("flying", 1.0, 2.0)
    assert first == second == [Noted("one"), Progressed("flying", 1.0, 2.0)]


def test_a_listener_hears_only_the_kinds_that_it_wants():
    stream, told = EventStream(), []
    assert not stream.wants(Progressed)
    stream.listen(told.append, Progressed)
    stream.tell(Noted("nothing of it"))
    stream.progress("planning", 0.0, 1.0)
    assert told == [Progressed("planning", 0.0, 1.0)]
    assert stream.wants(Progressed) and not stream.wants(VehicleMoved)
    stream.listen(told.append)
    assert stream.wants(VehicleMoved)
