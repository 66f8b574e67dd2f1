"""Warnings about one definition, and which leaves are only names so far."""

from dataclasses import replace
from typing import Final

from btcore.diagnostic_codes import DiagnosticCode
from btcore.registry.manifest import Manifest
from btcore.xml.models.stand_ins import (
    StubAction,
    StubCondition,
    StubControl,
    StubDecorator,
)
from btcore.xml.plan.plan import NodePlan
from btcore.xml.read.diagnostics import DiagnosticCollector
from btcore.xml.read.document import Document
from btcore.xml.read.positions import ElementPart

_STAND_INS: Final = (StubAction, StubCondition, StubControl, StubDecorator)


class LintReporter:
    """Takes the warnings, one of each sort a place: a tree that is called twice is one text."""

    def __init__(self, diagnostics: DiagnosticCollector) -> None:
        self.diagnostics = diagnostics
        self._told = {(one.code, one.file, one.line, one.column) for one in diagnostics.warnings}

    def warn(
        self,
        code: DiagnosticCode,
        message: str,
        document: Document,
        node: NodePlan,
        attribute: str = "",
        hint: str = "",
        part: ElementPart = "value",
        within: int = 0,
        width: int = 0,
    ) -> None:
        """Note a warning (or, by its *code*, an error) about *node*, or about one of its attributes.

        For the place see :meth:`Document.span`; *width* is how many characters are meant from *within* on.
        """
        found = document.diagnostic(code, message, node.element, attribute, part, hint, within)
        if width and found.width < width:
            found = replace(found, width=width)
        place = (code, found.file, found.line, found.column)
        if place not in self._told:
            self._told.add(place)
            self.diagnostics.add(found)


def node_label(node: NodePlan) -> str:
    """*node* as messages name it."""
    if node.call is not None:
        return f'<SubTree ID="{node.call.tree}">'
    return f"<{node.id}>"


def line_of(document: Document, node: NodePlan) -> str:
    """``line 4``."""
    return f"line {document.line(node.element)}"


def is_stub(manifest: Manifest) -> bool:
    """Whether the node is known by a model alone: what it does, and which ports it can do without, isn't."""
    return issubclass(manifest.cls, _STAND_INS)


def is_built_in(manifest: Manifest) -> bool:
    """Whether it is one of BehaviorTree.CPP's nodes, as btcore brings it."""
    return manifest.function is None and is_builtin_class(manifest.cls)


def is_builtin_class(cls: type) -> bool:
    """Whether *cls* is a built-in node or a base class of built-in nodes."""
    return cls.__module__.startswith("btcore.nodes.")
