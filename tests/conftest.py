"""What all tests share: property tests have no deadlines, and the same examples on every run in CI."""

import gc
import os
import signal
import sys

import pytest
import slow_part
from hypothesis import settings
from sweeps import IN_THE_SLOW_PART

settings.register_profile("default", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "default")

# pymavlink chooses its dialect when it is first imported, whichever test comes first.
os.environ["MAVLINK20"] = "1"

# What a user's cache holds must not decide what a test sees.
os.environ["WBF_MISSION_ENVIRONMENT_CACHE_MB"] = "0"

# Tests run in one process per core, and threads of linear algebra in each would only wait for one another.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Where Python is told to write no bytecode, as in many images of containers, every worker would rewrite all
# tests anew, and every process that tests start would compile the product.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# In the background of a shell or under nohup, tests and what they start would ignore Ctrl-C or a hang-up.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """All tests of a file go to one worker, which makes what they share once; files in their order."""
    from xdist.scheduler import LoadFileScheduling

    config.option.loadscopereorder = False
    return (slow_part.scheduling() if IN_THE_SLOW_PART in os.environ else LoadFileScheduling)(config, log)


def pytest_ignore_collect(collection_path, config):
    """Of the slow part, files that name neither a slow test nor a sweep are not even imported."""
    if config.getoption("markexpr") != "slow" or collection_path.suffix != ".py":
        return None
    text = collection_path.read_bytes()
    return None if b"slow" in text or b"sweep" in text else True


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Collect without the garbage collector, which then never looks at the modules and tests again."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_configure(config):
    """Sweeps are tests of the slow part, too; there they have more examples."""
    if config.getoption("markexpr") == "slow":
        os.environ[IN_THE_SLOW_PART] = "1"
