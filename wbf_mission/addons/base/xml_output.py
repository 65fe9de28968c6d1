"""Writes XML for mission files and exports."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np

GPX = {"version": "1.1", "creator": "wbf-mission", "xmlns": "http://www.topografix.com/GPX/1/1"}
"""Attributes of the root of a GPX file."""


def decimal(value: float) -> str:
    """Return a number as an XML decimal, without exponent; reading it gives exactly this number.

    >>> decimal(1e-7), decimal(30)
    ('0.0000001', '30.0')
    """
    return np.format_float_positional(float(value), unique=True, trim="0")


def document(root: ElementTree.Element) -> str:
    """Return an XML document as text, with one element per line."""
    ElementTree.indent(root, " ")
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def add(
    parent: ElementTree.Element, tag: str, text: str | None = None, **attributes: str
) -> ElementTree.Element:
    """Add a child element to `parent` and return the child."""
    made = ElementTree.SubElement(parent, tag, attributes)
    made.text = text
    return made
