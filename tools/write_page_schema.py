"""Write `page/src/schema.ts`, TypeScript types of the page's messages, from `addons/web/schema.py`.

Run ``python tools/write_page_schema.py`` after a change of the Python module; a test compares both files.
"""

from __future__ import annotations

import ast
import textwrap
from collections.abc import Iterator, Sequence
from pathlib import Path

SOURCE = Path(__file__).parents[1] / "wbf_mission" / "addons" / "web" / "schema.py"
TYPES = SOURCE.parent / "page" / "src" / "schema.ts"
_PLAIN = {"float": "number", "int": "number", "str": "string", "bool": "boolean", "None": "null"}
_WIDTH = 116


def typescript(source: str) -> str:
    r"""Return TypeScript types, with docstrings, for the structs in the source of a Python module.

    >>> print(typescript('class A(Struct):\n    "One."\n    x: list[int | None]  # Many\n    y: str = ""'))
    // Made of schema.py by tools/write_page_schema.py.
    <BLANKLINE>
    /** One. */
    export interface A {
      /** Many. */
      x: (number | null)[];
      y?: string;
    }
    <BLANKLINE>
    """
    module = ast.parse(source)
    aliases: dict[str, str] = {}
    given = source.splitlines()
    lines = ["// Made of schema.py by tools/write_page_schema.py."]
    lines += [f"// {line}".rstrip() for line in (ast.get_docstring(module) or "").splitlines()[2:]]
    for statement, doc in _documented(module.body, given):
        match statement:
            case ast.ClassDef(name=name, bases=[ast.Name(id=base), *_]):
                lines += ["", *_comment(ast.get_docstring(statement), "")]
                lines.append(f"export interface {name} {'' if base == 'Struct' else f'extends {base} '}{{")
                for field, text in _documented(statement.body, given):
                    if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
                        mark = "" if field.value is None else "?"
                        lines += _comment(text, "  ")
                        lines.append(f"  {field.target.id}{mark}: {_type(field.annotation, aliases)};")
                lines.append("}")
            case ast.AnnAssign(target=ast.Name(id=name), annotation=ast.Name(id="TypeAlias"), value=value):
                assert value is not None
                kind = _type(value, aliases)
                if doc:
                    lines += ["", *_comment(doc, ""), f"export type {name} = {kind};"]
                else:
                    aliases[name] = kind
    return "\n".join(lines) + "\n"


def _documented(body: Sequence[ast.stmt], lines: Sequence[str]) -> Iterator[tuple[ast.stmt, str | None]]:
    """Yield each statement with the docstring or comment after it, if any."""
    for statement, following in zip(body, [*body[1:], None], strict=True):
        match following:
            case ast.Expr(value=ast.Constant(value=str(text))):
                yield statement, text
            case _:
                comment = lines[(statement.end_lineno or 1) - 1].partition("  # ")[2]
                yield statement, f"{comment}." if comment else None


def _comment(text: str | None, indent: str) -> list[str]:
    if not text:
        return []
    words = " ".join(text.split())
    return textwrap.wrap(f"/** {words} */", _WIDTH, initial_indent=indent, subsequent_indent=f"{indent} * ")


def _type(node: ast.expr, aliases: dict[str, str]) -> str:
    def of(one: ast.expr) -> str:
        return _type(one, aliases)

    match node:
        case ast.Name(id=name):
            return aliases.get(name, _PLAIN.get(name, name))
        case ast.Constant(value=None):
            return "null"
        case ast.BinOp(left=left, right=ast.Name(id="UnsetType")):
            return of(left)
        case ast.BinOp(left=ast.BinOp(left=left, right=ast.Name(id="UnsetType")), right=right):
            return f"{of(left)} | {of(right)}"
        case ast.BinOp(left=left, right=right):
            return f"{of(left)} | {of(right)}"
        case ast.Subscript(value=ast.Name(id="Annotated"), slice=ast.Tuple(elts=[kind, *_])):
            return of(kind)
        case ast.Subscript(value=ast.Name(id="Literal"), slice=ast.Tuple(elts=values)):
            return " | ".join(f'"{ast.literal_eval(value)}"' for value in values)
        case ast.Subscript(value=ast.Name(id="dict"), slice=ast.Tuple(elts=[key, value])):
            return f"Record<{of(key)}, {of(value)}>"
        case (
            ast.Subscript(value=ast.Name(id="list"), slice=kind)
            | ast.Subscript(value=ast.Name(id="tuple"), slice=ast.Tuple(elts=[kind, ast.Constant()]))
        ):
            inner = of(kind)
            return f"({inner})[]" if "|" in inner else f"{inner}[]"
        case ast.Subscript(value=ast.Name(id="tuple"), slice=ast.Tuple(elts=kinds)):
            return f"[{', '.join(map(of, kinds))}]"
    msg = f"no type in TypeScript is known for {ast.unparse(node)}"
    raise ValueError(msg)


if __name__ == "__main__":
    TYPES.write_text(typescript(SOURCE.read_text(encoding="utf-8")), encoding="utf-8")
