"""A user's policy: rows until a part of the budget is spent, then the cells with the greatest value."""

from wbf_mission import NO_CHANGE, Decision, Event, make_planner, make_policy


class RowsThenGreedy:
    """Takes `share`, the fraction of the budget that is spent on rows."""

    def __init__(self, share=0.3):
        self.share = share
        self.rows = make_planner("lawnmower")
        self.greedy = make_policy("greedy")

    @property
    def triggers(self):
        return self.greedy.triggers

    def start(self):
        self.greedy.start()

    def decide(self, observation):
        if observation.event is Event.START:
            return Decision({one.system_id: self.rows(one.request).points_m for one in observation.vehicles})
        spent = [one.spent / (one.spent + one.left) for one in observation.steerable]
        if observation.event is not Event.LOST and max(spent, default=1.0) < self.share:
            return NO_CHANGE
        return self.greedy.decide(observation)
