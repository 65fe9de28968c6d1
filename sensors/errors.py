"""Errors of fields, environments, observations and estimators."""

from geo.errors import WbfMissionError


class FieldError(WbfMissionError, ValueError):
    """Error of a field, a set of fields or a field file that cannot be used."""


class CameraError(WbfMissionError, ValueError):
    """Error of a camera that is unknown or has impossible values, or of an unusable camera file."""


class EnvironmentDataError(WbfMissionError, ValueError):
    """Error of an environment that cannot be generated, stored or read."""


class ObservationError(WbfMissionError, ValueError):
    """Error of observations that do not fit the farm, or of an observation file that cannot be read."""


class EstimatorError(WbfMissionError, ValueError):
    """Error of an estimator that is unknown, wrongly configured or used before ``fit``."""
