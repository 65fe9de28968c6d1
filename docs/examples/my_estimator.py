"""A user's estimator: the mean of the readings near a cell, with weights that fall with the distance."""

import numpy as np
from scipy.ndimage import gaussian_filter

from wbf_mission import PAPER_FIELDS, BaseEstimator, InformationModel


class Smooth(BaseEstimator):
    """Takes `reach`, the standard deviation of the weights in cells."""

    def __init__(self, reach=2.0, fields=PAPER_FIELDS):
        self.reach = reach
        self.fields = fields

    def _start(self, grid):
        self.sums_ = np.zeros((2, len(self.fields), *grid.shape))

    def _learn(self, observations):
        for k, sensed in enumerate(observations.sensed.T):
            at = observations.x[sensed], observations.y[sensed]
            np.add.at(self.sums_[0, k], at, np.clip(observations.values[sensed, k], 0.0, 1.0))
            np.add.at(self.sums_[1, k], at, 1.0)

    def _estimate(self):
        values, counts = (gaussian_filter(one, (0, self.reach, self.reach)) for one in self.sums_)
        defaults = np.array([field.default for field in self.fields])[:, None, None]
        value = (values + 0.01 * defaults) / (counts + 0.01)
        names = self.fields.names
        return InformationModel(value.astype("f4"), (0.01 / (counts + 0.01)).astype("f4"), fields=names)
