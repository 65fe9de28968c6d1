"""Errors of fields, environments, observations and estimators."""

from geo.errors import WbfMissionError


class FieldError(WbfMissionError, ValueError):
    """A field, a set of fields or a field file that cannot be used."""


class CameraError(WbfMissionError, ValueError):
    """A camera that is unknown or has impossible values, or a camera file that cannot be used."""


class EnvironmentDataError(WbfMissionError, ValueError):
    """An environment that cannot be generated, stored or read."""


class ObservationError(WbfMissionError, ValueError):
    """Observations that do not fit the farm, or an observation file that cannot be read."""


class EstimatorError(WbfMissionError, ValueError):
    """An estimator that is unknown, wrongly configured or used before ``fit``."""
