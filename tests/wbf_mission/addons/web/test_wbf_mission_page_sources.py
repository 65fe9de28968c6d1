"""What users load is built of the page's sources, and the compiler accepts these."""

import hashlib
import os
import shutil
import subprocess
from pathlib import Path

import pytest

import wbf_mission.addons.web

WEB = Path(wbf_mission.addons.web.__file__).parent
PAGE = WEB / "page"


def test_the_built_files_are_those_of_the_sources() -> None:
    digest = hashlib.sha256()
    for path in sorted((PAGE / "src").iterdir(), key=lambda path: path.name):
        digest.update(path.name.encode())
        digest.update(path.read_bytes())
    digest.update((PAGE / "package-lock.json").read_bytes())
    assert (WEB / "static" / "sources.sha256").read_text().strip() == digest.hexdigest()


@pytest.mark.slow
@pytest.mark.skipif(
    shutil.which("npm") is None or not (PAGE / "node_modules").exists(),
    reason="needs node and `npm ci` in page/",
)
def test_the_compiler_accepts_the_sources_and_builds_the_same_files(tmp_path: Path) -> None:
    page = tmp_path / "page"
    shutil.copytree(PAGE, page, symlinks=True, ignore=shutil.ignore_patterns("node_modules"))
    (page / "node_modules").symlink_to(PAGE / "node_modules", target_is_directory=True)
    for script in ("check", "build"):
        done = subprocess.run(
            ["npm", "run", script], cwd=page, capture_output=True, text=True, env={**os.environ}
        )
        assert done.returncode == 0, done.stdout + done.stderr
    for built in (tmp_path / "static").iterdir():
        assert built.read_bytes() == (WEB / "static" / built.name).read_bytes(), built.name
