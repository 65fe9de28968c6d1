"""The root of the project's error tree, and the errors of farms.

::

    WbfMissionError                       anything a user can mend; its text is one line
    +-- geo.errors.FarmError              a farm or a farm file
    +-- sensors.errors.*                  environment data, observations, estimators
    +-- mission.errors.*                  planning, mission items and files, transfer, links
    +-- sim_vehicle.errors.VehicleError   a vehicle or its specification
"""


class WbfMissionError(Exception):
    """An error whose text tells a user in one line what was wrong, where, and what to do."""


class FarmError(WbfMissionError, ValueError):
    """A farm that does not exist, or a farm file whose geometry or properties cannot be used."""
