"""XML as mission files and exports write it."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np


def decimal(value: float) -> str:
    """Return a number as XML's decimals are written: no exponent, and exact when read back.

    >>> decimal(1e-7), decimal(30)
    ('0.0000001', '30.0')
    """
    return np.format_float_positional(float(value), unique=True, trim="0")


def document(root: ElementTree.Element) -> str:
    """Return the text of a document, one element a line."""
    ElementTree.indent(root, " ")
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def add(
    parent: ElementTree.Element, tag: str, text: str | None = None, **attributes: str
) -> ElementTree.Element:
    """Add an element and return it."""
    made = ElementTree.SubElement(parent, tag, attributes)
    made.text = text
    return made
