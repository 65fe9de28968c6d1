"""Simulator and ground program as processes of their own, as two terminals run them."""

import contextlib
import json
import multiprocessing
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from dataclasses import dataclass

from geo.compiled import compiled_folder

LONG_S = 300.0  # a limit against hanging, not a measure
FARM = ("--farm", "miniberry-10")
JOB = ("--budget", "60s", "--estimator", "point")
_COMPILED = compiled_folder()
ENVIRONMENT = {**os.environ, "COLUMNS": "200", "TERM": "dumb"}


def environment(**more):
    """Return the environment of a process with a terminal of 200 columns and what else is given."""
    return {**os.environ, "COLUMNS": "200", **more}


def command(*words):
    """Return a call of the command line."""
    return [sys.executable, "-m", "wbf_mission", *map(str, words)]


def started(words, **options):
    """Start a process in a group of its own, as a terminal would; its output is kept for `communicate`."""
    return subprocess.Popen(
        words,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        **{"env": environment(), **options},
    )


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def compiled_by(code, folder):
    """Run Python code that prints JSON in a process that finds nothing compiled; return what it printed."""
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "NUMBA_CACHE_DIR": str(folder)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def copy_compiled(folder, *patterns, but=()):
    """Copy compiled functions, by the names of their modules, for a process that shall find no others."""
    without = {path for pattern in but for path in _COMPILED.glob(pattern)}
    for path in {path for pattern in patterns for path in _COMPILED.glob(pattern)} - without:
        shutil.copytree(path, folder / path.name)


def wait_until(condition, what="nothing came", limit_s=LONG_S):
    """Wait until a condition holds, and return what it returned."""
    end_s = time.monotonic() + limit_s
    while not (found := condition()):
        assert time.monotonic() < end_s, f"not within {limit_s:g} s: {what}"
        time.sleep(0.01)
    return found


@contextlib.contextmanager
def running(words, cwd, **options):
    """Run a process; it is stopped at the end if it still runs."""
    process = subprocess.Popen(words, cwd=cwd, text=True, start_new_session=True, env=ENVIRONMENT, **options)
    with _stopped(process):
        yield process


class Forked:
    """A process of ``wbf-mission`` without the second that its imports take: a fork of one that has them.

    It runs in a folder, in a session of its own, with streams to files; it has what tests use of a `Popen`.
    """

    def __init__(self, words, cwd, out=os.devnull, err=os.devnull):
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload(["preloaded"])
        words = [str(word) for word in words]
        self._process = self._context.Process(target=_run_forked, args=(words, str(cwd), str(out), str(err)))
        self._process.start()
        self.pid = self._process.pid

    @property
    def returncode(self):
        return self._process.exitcode

    def poll(self):
        return self._process.exitcode

    def wait(self, limit_s=LONG_S):
        self._process.join(limit_s)
        if self._process.exitcode is None:
            raise subprocess.TimeoutExpired("wbf-mission", limit_s)
        return self._process.exitcode

    def send_signal(self, number):
        os.kill(self.pid, number)

    def terminate(self):
        self._process.terminate()

    def kill(self):
        self._process.kill()


def _run_forked(words, cwd, out, err):
    os.setsid()
    os.chdir(cwd)
    os.environ.clear()
    os.environ.update(ENVIRONMENT)
    for path, stream in ((out, sys.stdout), (err, sys.stderr)):
        with open(path, "w") as file:  # noqa: PTH123
            os.dup2(file.fileno(), stream.fileno())
    sys.argv[:] = ["wbf-mission", *words]
    from wbf_mission.__main__ import main

    main()


@contextlib.contextmanager
def forked(words, cwd, **streams):
    """Run ``wbf-mission`` as a `Forked`; it is stopped at the end if it still runs."""
    process = Forked(words, cwd, **streams)
    with _stopped(process):
        yield process


@contextlib.contextmanager
def _stopped(process):
    try:
        yield
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(10.0)
        if process.poll() is None:
            process.kill()
            process.wait(10.0)


def run_forked(words, cwd, out=os.devnull, err=os.devnull):
    """Run ``wbf-mission`` to its end; return its exit code."""
    with forked(words, cwd, out=out, err=err) as process:
        return process.wait()


@contextlib.contextmanager
def simulator(cwd, *options, autopilot="px4", speed=5, listen=("tcpin:127.0.0.1:0",), camera=False):
    """Run ``wbf-mission sim``; yields what others call to reach it, one address for each link."""
    cwd.mkdir(exist_ok=True)
    ready = cwd / "sim.ready"
    ready.unlink(missing_ok=True)
    links = [word for url in listen for word in ("--listen", url)]
    words = ["sim", *FARM, "--autopilot", autopilot, "--speed", speed, "--ready-file", ready]
    words += [*links, *options]
    words.append("--camera" if camera else "--no-camera")
    with forked(words, cwd, err=cwd / "sim.err") as process:
        wait_until(lambda: ready.exists() or process.poll() is not None, "the simulator does not start")
        assert process.poll() is None, (cwd / "sim.err").read_text()
        yield Links(process, [_other_end(url) for url in ready.read_text().split()])


class Links(list):
    """What others call to reach a simulator, one address for each link, and its process."""

    def __init__(self, process, urls):
        super().__init__(urls)
        self.process = process


def _other_end(url):
    for ours, theirs in (("tcpin:", "tcp:"), ("udpin:", "udpout:"), ("udpout:", "udpin:")):
        if url.startswith(ours):
            return theirs + url.removeprefix(ours)
    return url


@dataclass
class Flown:
    """What a ground program came to."""

    code: int
    summary: dict
    told: str

    @property
    def ended(self):
        """Exit code and outcome."""
        return self.code, self.summary["outcome"]


class Ground:
    """A running ``wbf-mission fly --connect``; what it tells can be waited for."""

    def __init__(self, process, cwd):
        self.process, self._cwd = process, cwd

    @property
    def told(self):
        """What it wrote for the operator so far."""
        return (self._cwd / "fly.err").read_text()

    def wait_for(self, text):
        """Wait until it tells this."""
        wait_until(lambda: text in self.told or self.process.poll() is not None, text)
        assert text in self.told, self.told

    def end(self):
        """Wait until it is over."""
        self.process.wait(LONG_S)
        told, out = self.told, (self._cwd / "fly.json").read_text()
        assert "Traceback" not in told, told
        return Flown(self.process.returncode, json.loads(out) if out else {}, told)


@contextlib.contextmanager
def flying(cwd, url, *options, decider=("--planner", "lawnmower")):
    """Run ``wbf-mission fly --connect``, whose start is agreed to beforehand."""
    words = ["fly", *FARM, *JOB, *decider, "--connect", url, "--yes", "--json", "--no-plots"]
    words += ["--out", "run", *options]
    files = {"out": cwd / "fly.json", "err": cwd / "fly.err"}
    for file in files.values():
        file.touch()
    with forked(words, cwd, **files) as process:
        yield Ground(process, cwd)


def flown(cwd, url, *options, **more):
    """Fly to the end."""
    with flying(cwd, url, *options, **more) as ground:
        return ground.end()
