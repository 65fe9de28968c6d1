"""The stream of events that terminal, files and pages share."""

from wbf_mission.events import EventStream, Noted, Progressed, progress_only


def test_every_listener_hears_every_event_in_order() -> None:
    stream, first, second = EventStream(), [], []
    assert not stream
    stream.listen(first.append)
    stream.listen(second.append)
    assert stream
    stream.tell(Noted("one"))
    stream.progress("flying", 1.0, 2.0)
    assert first == second == [Noted("one"), Progressed("flying", 1.0, 2.0)]


def test_a_progress_callback_hears_only_how_far_work_is() -> None:
    told = []
    listen = progress_only(lambda *how_far: told.append(how_far))
    listen(Noted("nothing of it"))
    listen(Progressed("planning", 0.0, 1.0))
    assert told == [("planning", 0.0, 1.0)]
