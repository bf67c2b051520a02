"""XML from files of others: elements and text only."""

from __future__ import annotations

from xml.etree import ElementTree

FORBIDDEN = ("<!doctype", "<!entity")
"""Declarations with which a few lines can stand for gigabytes; no voxel format needs them."""


def parse_xml(text: str) -> ElementTree.Element:
    """Parse XML without declarations.

    Raises
    ------
    xml.etree.ElementTree.ParseError
        If it is not well-formed, or declares anything.
    """
    if any(word in text.lower() for word in FORBIDDEN):
        raise ElementTree.ParseError("it holds declarations, which are not read")
    return ElementTree.fromstring(text)
