"""What a run was flown with."""

import functools
import subprocess

import numpy as np
import pytest

from wbf_mission.bench import provenance
from wbf_mission.bench.provenance import in_words, versions


class UCB:
    def __init__(self, beta, near=None):
        self._beta, self.near = beta, near


class Bare:
    def __init__(self, *given):
        self.weights = np.zeros((2, 3))


def closed_over(step):
    def plan(request):
        return step

    return plan


@pytest.fixture
def fresh():
    versions.cache_clear()
    yield
    versions.cache_clear()


def git(folder, *arguments):
    named = ("-c", "user.name=n", "-c", "user.email=n@example.org")
    ended = subprocess.run(
        ["git", "-C", str(folder), *named, *arguments], check=True, capture_output=True, text=True
    )
    return ended.stdout.strip()


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (UCB(9.0), "UCB(beta=9.0, near=None)"),
        (UCB(1, near=UCB(2)), "UCB(beta=1, near=UCB)"),
        (UCB(np.float64(0.5)), "UCB(beta=0.5, near=None)"),
        (Bare(), "Bare(weights=array of 2 x 3)"),
        (object(), "object()"),
        (closed_over(3), "plan(step=3)"),
        (functools.partial(closed_over, step=3), "closed_over(step=3)"),
    ],
)
def test_objects_are_told_with_their_parameters(made, words):
    assert in_words(made) == words


def test_a_checkout_tells_its_commit_and_whether_the_packages_differ_from_it(tmp_path, monkeypatch, fresh):
    (tmp_path / "geo").mkdir()
    source = tmp_path / "geo" / "one.py"
    source.write_text("1\n")
    git(tmp_path, "init", "-q")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-q", "-m", "one")
    monkeypatch.setattr(provenance, "_ROOT", tmp_path)
    commit = git(tmp_path, "rev-parse", "HEAD")
    assert versions()["commit"] == commit
    versions.cache_clear()
    (tmp_path / "notes.txt").write_text("elsewhere")
    assert versions()["commit"] == commit
    versions.cache_clear()
    source.write_text("2\n")
    assert versions()["commit"] == f"{commit}+changes"


@pytest.mark.parametrize(
    ("told", "commit"),
    [
        ('{"url": "x", "vcs_info": {"vcs": "git", "commit_id": "abc"}}', "abc"),
        ('{"url": "file:///x", "dir_info": {}}', None),
        (None, None),
    ],
)
def test_an_installed_package_tells_the_commit_that_it_came_from(told, commit, tmp_path, monkeypatch, fresh):
    class Installed:
        def read_text(self, name):
            assert name == "direct_url.json"
            return told

    monkeypatch.setattr(provenance, "_ROOT", tmp_path)
    monkeypatch.setattr(provenance.importlib.metadata, "distribution", lambda name: Installed())
    assert versions().get("commit") == commit


def test_without_git_there_is_no_commit(monkeypatch, fresh):
    monkeypatch.setattr(provenance.shutil, "which", lambda name: None)
    assert "commit" not in versions()
