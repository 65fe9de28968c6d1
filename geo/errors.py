"""The root of the project's error tree, the errors of farms, and whose code an error came from.

::

    WbfMissionError                                      anything a user can mend; its text is one line
    +-- geo.errors.FarmError                             a farm or a farm file
    +-- geo.errors.GroundError                           heights of the ground
    +-- geo.atomic.FolderError                           a folder that cannot be written now
    +-- geo.memory.NotEnoughMemoryError                  work that needs more memory than there is
    +-- geo.named.ParameterError                         parameters of a planner or an estimator
    +-- geo.reading.UnreadableError                      a file that a user names
    +-- geo.seeds.SeedError                              a seed
    +-- sensors.errors.FieldError                        a field of an environment
    +-- sensors.errors.CameraError                       a camera by its sensor and lens
    +-- sensors.errors.EnvironmentDataError              an environment or its files
    +-- sensors.errors.ObservationError                  observations
    +-- sensors.errors.EstimatorError                    an estimator
    +-- mission.errors.PlanningError                     a planner, a budget or a path
    |   +-- mission.errors.AnswerError                   an answer of a policy
    +-- mission.errors.MissionError                      a mission or one of its items
    +-- mission.errors.MissionFileError                  a mission file
    +-- mission.errors.TransferError                     an upload, a download or a clear
    |   +-- mission.transfer.errors.LocalTransferError   called in a way that makes no sense
    |   +-- mission.transfer.errors.RemoteTransferError  failed by the vehicle or the link
    |   |   +-- mission.transfer.errors.NoVehicleError   nobody was there
    +-- mission.errors.LinkError                         a link that cannot be opened
    |   +-- mission.errors.NoPeerError                   nobody answers at the other end
    |   +-- mission.errors.LinkLostError                 a link that broke
    +-- mission.logs.track.LogError                      a log of a flight, or a folder of pictures
    +-- mission.ground.station.NotFlyingError            a mission that cannot be changed now
    +-- mission.ground.status_text.NotStartedError       Ctrl-C before a vehicle was started
    +-- mission.ground.modes.ModeError                   a flight mode that the vehicle does not have
    +-- wbf_mission.addons.boards.apart._LostError       own code whose process ended
    +-- wbf_mission.addons.check.peer.CheckError         a check that does not exist
    +-- wbf_mission.addons.check.peer.FailedError        a check that failed
    +-- wbf_mission.addons.check.peer.SkippedError       a check that does not apply
    +-- sim_vehicle.errors.VehicleError                  a vehicle or its specification
    |   +-- sim_vehicle.faults.fault.FaultError          a fault to be injected
    |   +-- sim_vehicle.pilot.controls.RefusedError       a command that the vehicle refuses
    +-- wbf_mission.scenario.option.ScenarioError        a scenario or one of its options
    +-- mission.ground.command.OrderError              an order that is none
    +-- wbf_mission.live.discovery.LiveFlightError       a run that a vehicle behind a link cannot do
    +-- mission.ground.command.VehicleRefusedError     a vehicle that does not do what it is told
    +-- mission.ground.command.MotorsStandError        an order that would start motors, which was not said
    +-- mission.ground.command.VehicleSilentError      a vehicle that does not answer any more
    +-- wbf_mission.preflight.finding.PreflightError     a plan that cannot be checked, or must not go up
    +-- wbf_mission.run.resolve.FlightError              a flight that cannot go on
    +-- wbf_mission.maps.gis.MapError                    a treatment map, its costs or its files
    +-- wbf_mission.pictures.animation.AnimationError    a moving picture of a run
    +-- wbf_mission.results.storage.ArrayFileError       arrays of a result
    +-- wbf_mission.bench.engine.ClusterError            a Dask cluster
    +-- wbf_mission.addons.rl.errors.TrainingError       a training environment
    +-- wbf_mission.results.storage.ResultError          the folder of a result
    +-- wbf_mission.addons.export.rerun.ExportError      a run that cannot be exported
    +-- wbf_mission.addons.web.tiles.MapTilesError              a file of map tiles
    +-- wbf_mission.addons.web.report.ReportError               runs of which no report can be made
    +-- wbf_mission.addons.web.drafts.DraftError                a draft of the studio
    +-- wbf_mission.addons.web.newest.SupersededError           work in whose place newer work is done
    +-- wbf_mission.cli.options.TargetError              a file or folder to be written
"""

from __future__ import annotations

import sysconfig
import traceback
from functools import cache
from pathlib import Path

from geo.texts import one_line


class WbfMissionError(Exception):
    """An error whose text tells a user in one line what was wrong, where, and what to do."""


class GroundError(WbfMissionError, ValueError):
    """A raster of the ground's heights that cannot be read or does not cover the flight."""


class FarmError(WbfMissionError, ValueError):
    """A farm that does not exist, or a farm file whose geometry or properties cannot be used."""


PACKAGES = ("geo", "mission", "sensors", "sim_vehicle", "wbf_mission")
"""What this program consists of."""


_CYTHON = frozenset({".pyx", ".pxi", ".pxd"})


@cache
def is_users_file(file: str) -> bool:
    """Tell whether a source is a user's: neither of this program, nor installed, nor of Python itself."""
    path = Path(file).absolute()
    if file.startswith("<frozen") or {"site-packages", "dist-packages"} & set(path.parts):
        return False
    if path.suffix in _CYTHON:  # compiled libraries name their sources, not where they are
        return False
    here = Path(__file__).absolute().parents[1]
    inside = [here / name for name in PACKAGES] + [Path(sysconfig.get_path("stdlib"))]
    return not any(path.is_relative_to(one) for one in inside)


def users_line(error: BaseException) -> str | None:
    """Return the file and line of a user's code that an error came through last; None if through none.

    Examples
    --------
    >>> try:
    ...     exec(compile("1 / 0", "mine.py", "exec"))
    ... except ZeroDivisionError as error:
    ...     users_line(error), told_error(error)
    ('mine.py, line 1', 'ZeroDivisionError: division by zero (mine.py, line 1)')
    """
    frames = [one for one in traceback.extract_tb(error.__traceback__) if is_users_file(one.filename)]
    return f"{Path(frames[-1].filename).name}, line {frames[-1].lineno}" if frames else None


def told_error(error: BaseException) -> str:
    """Return an error in one line: its class, its text, and the user's line where it came from one."""
    line = users_line(error)
    text = one_line(str(error))
    return type(error).__name__ + (f": {text}" if text else "") + (f" ({line})" if line else "")
