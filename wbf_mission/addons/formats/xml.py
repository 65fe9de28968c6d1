r"""Reads untrusted XML: entities and external files are refused; nesting and elements are limited.

>>> root = parse(b"<kml>\n<Point a='1'>text</Point></kml>", "kml", "a KML file")
>>> [(node.tag, node.line, node.attributes, node.text) for node in root.children]
[('Point', 2, {'a': '1'}, 'text')]
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any
from xml.parsers import expat

from mission.errors import MissionFileError
from mission.files.common import kind_of, wrong_kind

_DEEPEST = 100
_MOST_ELEMENTS = 2_000_000


@dataclass(slots=True)
class Node:
    """An XML element: name and attributes without prefixes, text, and line number of the start tag."""

    tag: str
    line: int
    attributes: dict[str, str]
    # Shared empty tuples save memory: a track may have millions of elements.
    children: list[Node] | tuple[Node, ...] = ()
    chunks: list[str] | tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """Text of the element without the text of its children, stripped."""
        return "".join(self.chunks).strip()

    def iter(self, *tags: str) -> Iterator[Node]:
        """Yield the descendants with one of the names `tags`, in the order of the document."""
        left = list(reversed(self.children))
        while left:
            node = left.pop()
            if node.tag in tags:
                yield node
            left.extend(reversed(node.children))

    def child(self, tag: str) -> Node | None:
        """Return the first child with the name `tag`, or None."""
        return next((child for child in self.children if child.tag == tag), None)

    def child_text(self, tag: str) -> str:
        """Return the text of the first child with the name `tag`; empty if there is no such child."""
        found = self.child(tag)
        return "" if found is None else found.text


def parse(data: bytes, root: str, kind: str) -> Node:
    """Return a document's root element; MissionFileError if the document is broken or of another kind."""
    if kind_of(data) != kind:
        raise wrong_kind(data, kind)
    parser = expat.ParserCreate()
    open_nodes, count = [Node("", 0, {})], 0
    top = open_nodes[0]

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal count
        count, line = count + 1, parser.CurrentLineNumber
        if len(open_nodes) > _DEEPEST:
            raise MissionFileError(
                f"line {line}: more than {_DEEPEST} nested elements, which no mission needs"
            )
        if count > _MOST_ELEMENTS:
            raise MissionFileError(f"line {line}: more than {_MOST_ELEMENTS} elements; give a shorter path")
        node = Node(_local(tag), line, {_local(name): value for name, value in attributes.items()})
        parent = open_nodes[-1]
        if isinstance(parent.children, tuple):
            parent.children = []
        parent.children.append(node)
        open_nodes.append(node)

    def characters(text: str) -> None:
        node = open_nodes[-1]
        if isinstance(node.chunks, tuple):
            node.chunks = []
        node.chunks.append(text)

    def entity(name: str, *_: Any) -> None:
        line = parser.CurrentLineNumber
        raise MissionFileError(f"line {line}: the entity {name[:40]!r} is declared, which no mission needs")

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _tag: open_nodes.pop()
    parser.CharacterDataHandler = characters
    parser.EntityDeclHandler = entity
    parser.buffer_text = True
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        what = expat.errors.messages.get(error.code, "it is broken")
        raise MissionFileError(f"line {error.lineno}: it is not XML ({what}); save the file again") from None
    except MissionFileError:
        raise
    except (ValueError, LookupError) as error:  # Unknown encoding
        raise MissionFileError(f"line 1: {error}; save the file as UTF-8") from None
    found = top.children[0]
    if found.tag != root:
        raise MissionFileError(f"line {found.line}: the document is {found.tag[:40]!r}, not {kind}")
    return found


def _local(name: str) -> str:
    return name.rpartition(":")[2]
