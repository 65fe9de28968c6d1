"""What own code uses of the files beside it: modules that it imports, and data that it names."""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterator
from pathlib import Path

_LONGEST = 200
_MOST_MATCHES = 1000


def neighbours(file: Path) -> dict[str, Path]:
    """Return the modules beside a file that it imports, wherever in it, by their names."""
    found: dict[str, Path] = {}
    for node in ast.walk(_tree(file)):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            names = [node.module]
        for name in {one.partition(".")[0] for one in names}:
            for path in (file.parent / f"{name}.py", file.parent / name / "__init__.py"):
                if path.is_file() and path != file:
                    found.setdefault(name, path)
    return found


def files_beside(file: Path) -> list[Path]:
    """Return the files beside a file of own code that count with it, sorted.

    These are the modules that it imports, with all of the packages among them, and the files in its folder,
    or in a folder there that it names, whose names or patterns such as ``weights-*.npz`` stand as a text in
    it or in one of these modules.
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
    """Return a digest of the files beside a file of own code that count with it; empty without any."""
    taken = hashlib.sha256()
    files = files_beside(file)
    for path in files:
        content = path.read_bytes()
        taken.update(f"{path.relative_to(file.parent).as_posix()} {len(content)}\n".encode())
        taken.update(content)
    return taken.hexdigest() if files else ""


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
                matches = (one for _, one in zip(range(_MOST_MATCHES), folder.glob(text), strict=False))
                yield from (one for one in matches if one.is_file())
            elif (folder / text).is_file():
                yield folder / text


def _may_name(text: str) -> bool:
    """Return whether a text can be the name of a file below a folder, or a pattern of such."""
    parts = text.split("/")
    plain = text.isprintable() and 0 < len(text.encode()) <= _LONGEST and any(map(str.isalnum, text))
    pattern = not set("*?").isdisjoint(text)
    return plain and not {"", ".", ".."} & set(parts) and "**" not in text and not (pattern and " " in text)


def _tree(file: Path) -> ast.AST:
    """Return the parsed source; nothing of what is no Python."""
    try:
        return ast.parse(file.read_bytes())
    except (OSError, SyntaxError, ValueError, RecursionError, MemoryError):
        return ast.Module([], [])
