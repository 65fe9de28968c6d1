"""Files that a user's code uses from its folder: imported modules, and data files named in the code."""

from __future__ import annotations

import ast
import hashlib
import itertools
from collections.abc import Iterator
from pathlib import Path

_LONGEST = 200
_MOST_MATCHES = 1000


def neighbours(file: Path) -> dict[str, Path]:
    """Return the modules in the folder of `file` that `file` imports, by name."""
    found: dict[str, Path] = {}
    for node in ast.walk(_tree(file)):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            names = [node.module]
        for name in {module.partition(".")[0] for module in names}:
            for path in (file.parent / f"{name}.py", file.parent / name / "__init__.py"):
                if path.is_file() and path != file:
                    found.setdefault(name, path)
    return found


def files_beside(file: Path) -> list[Path]:
    """Return the files that a user's code file uses from its folder, sorted.

    These are the modules that it imports directly or indirectly (of a package, all modules), and data files.
    A data file counts if a string in the code is its name or a matching pattern, such as ``weights-*.npz``.
    Data files are searched in the folder of the code and in subfolders that the code names.
    """
    code, waiting = {file}, [file]
    while waiting:
        for path in neighbours(waiting.pop()).values():
            new = set(path.parent.rglob("*.py")) if path.name == "__init__.py" else {path}
            waiting += new - code
            code |= new
    found = set(code)
    for path in code:
        found.update(_named(path))
    return sorted(found - {file})


def digest_beside(file: Path) -> str:
    """Return a digest of `files_beside`; empty if there are none."""
    digest = hashlib.sha256()
    files = files_beside(file)
    for path in files:
        content = path.read_bytes()
        digest.update(f"{path.relative_to(file.parent).as_posix()} {len(content)}\n".encode())
        digest.update(content)
    return digest.hexdigest() if files else ""


def _named(file: Path) -> Iterator[Path]:
    texts = {
        node.value
        for node in ast.walk(_tree(file))
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and _may_name(node.value)
    }
    folders = [file.parent, *(file.parent / text for text in texts if (file.parent / text).is_dir())]
    for folder in folders:
        for text in texts:
            if not set("*?").isdisjoint(text):
                matches = itertools.islice(folder.glob(text), _MOST_MATCHES)
                yield from (path for path in matches if path.is_file())
            elif (folder / text).is_file():
                yield folder / text


def _may_name(text: str) -> bool:
    """Return whether `text` can be a relative file name, or a pattern of file names."""
    parts = text.split("/")
    plain = text.isprintable() and 0 < len(text.encode()) <= _LONGEST and any(map(str.isalnum, text))
    pattern = not set("*?").isdisjoint(text)
    return plain and not {"", ".", ".."} & set(parts) and "**" not in text and not (pattern and " " in text)


def _tree(file: Path) -> ast.AST:
    """Return the syntax tree of a file; an empty one if the file is not valid Python."""
    try:
        return ast.parse(file.read_bytes())
    except (OSError, SyntaxError, ValueError, RecursionError, MemoryError):
        return ast.Module([], [])
