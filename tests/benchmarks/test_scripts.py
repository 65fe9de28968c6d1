"""The benchmarks and what is said of them: pages name scripts that exist, and every script is named."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
NAMED = re.compile(r"(?<![\w/.])benchmarks/([\w-]+(?:/[\w-]+)*\.\w+)")
IMPORTED = re.compile(r"^\s*(?:from|import) (\w+)", re.MULTILINE)
TEXTS = ("*.md", "*.cff", "pyproject.toml", ".ci/**/*", "docs/**/*.md", "docs/**/*.py", "docs/**/*.ipynb")
CODE = ("tests/**/*.py", "tools/**/*.py", "missions/**/*.toml", "benchmarks/**/*.py")
PACKAGES = tuple(f"{name}/**/*.py" for name in ("geo", "sensors", "mission", "sim_vehicle", "wbf_mission"))


def named(*patterns: str) -> dict[str, set[str]]:
    """Return the names below benchmarks/ that files have, by file."""
    found = {}
    for pattern in patterns:
        for path in ROOT.glob(pattern):
            # A list of changes names what was there once.
            if path.is_file() and path.name != "CHANGELOG.md":
                text = path.read_text(encoding="utf-8", errors="replace")
                found[str(path.relative_to(ROOT))] = set(NAMED.findall(text))
    return found


def test_what_is_named_of_the_benchmarks_exists() -> None:
    files = named(*TEXTS, *CODE, *PACKAGES)
    assert {"docs/evidence/speed.md", "CONTRIBUTING.md", "missions/bench/tuned.toml"} <= set(files)
    gone = {
        f"{file}: benchmarks/{name}"
        for file, names in files.items()
        for name in names
        if name not in ("NAME.py", "test_scripts.py") and not (ROOT / "benchmarks" / name).exists()
    }
    assert gone == set()


def test_a_page_rests_on_every_script_and_a_script_or_a_test_on_every_module() -> None:
    on_pages = set().union(*named("docs/**/*.md").values())
    sources = [*ROOT.glob("benchmarks/**/*.py"), *ROOT.glob("tests/**/*.py"), *ROOT.glob("docs/*.py")]
    imported = {name for path in sources for name in IMPORTED.findall(path.read_text(encoding="utf-8"))}
    for path in (ROOT / "benchmarks").glob("*.py"):
        if '__name__ == "__main__"' in path.read_text(encoding="utf-8"):
            assert path.name in on_pages, f"no page names benchmarks/{path.name}"
        else:
            assert path.stem in imported, f"nothing imports benchmarks/{path.name}"


def test_a_figure_stands_on_one_page() -> None:
    pages: dict[str, set[str]] = {}
    for path in ROOT.glob("docs/**/*.md"):
        for line in path.read_text(encoding="utf-8").splitlines():
            if line.startswith("|") and len(re.findall(r"\d\.\d", line)) >= 2:
                pages.setdefault(line, set()).add(path.name)
    assert len(pages) > 100
    assert {line: names for line, names in pages.items() if len(names) > 1} == {}
