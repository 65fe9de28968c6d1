"""What ``wbf-mission`` loads, mostly late: processes of tests are forks of one that has it."""

import matplotlib.figure
import numba
import pyarrow.parquet
import rich.progress
import rich.table
import scipy.linalg
import scipy.spatial
import shapely
import zarr

import sim_vehicle.autopilot.ardupilot
import sim_vehicle.autopilot.px4
import sim_vehicle.motion.arducopter
import sim_vehicle.motion.multirotor
import sim_vehicle.motion.px4
import wbf_mission.__main__
import wbf_mission.addons.base.simulator
import wbf_mission.addons.operate.link
import wbf_mission.cli.app
import wbf_mission.flight

PARTS = (matplotlib, numba, pyarrow, rich, scipy, shapely, zarr, sim_vehicle, wbf_mission)
