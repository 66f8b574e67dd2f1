"""Trees built in code: nodes by their names, ports as keywords, written as XML and loaded as any other.

::

    b = Builder(nodes)  # those of Registry.standard(), if none are given
    bump = b.Sequence(b.Back(), b.Turn(angle=1.57), name="bump")
    tree = b.build(b.ReactiveSequence(b.Fallback(b.Inverter(b.IsObstacle()), bump), b.Forward()))
    print(b.xml(bump))
"""

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from enum import Enum
from pathlib import Path
from typing import Any, Final

from btcore.blackboard.blackboard import Blackboard
from btcore.clock import Clock
from btcore.diagnostic_codes import (
    INCONVERTIBLE_TEXT,
    TOO_DEEP,
    UNKNOWN_NODE,
    WRONG_CHILD_COUNT,
    DiagnosticCode,
)
from btcore.errors import (
    ConversionError,
    Diagnostic,
    PortError,
    TreeError,
    UnknownNodeError,
    XmlSyntaxError,
)
from btcore.registry.manifest import Manifest
from btcore.registry.registry import Registry
from btcore.suggestions import nearest_name
from btcore.tree.tree import Tree
from btcore.values import to_text
from btcore.xml.build import build
from btcore.xml.models.tree_nodes_model import quoted
from btcore.xml.read.document import Document, parse_text
from btcore.xml.read.element import Element
from btcore.xml.read.positions import ElementPart
from btcore.xml.read.tinyxml2_compat import EscapedText

_STEP: Final = "    "
MAX_BUILDER_DEPTH: Final = 2_000
"""How deep a tree may be that is built in code."""


class NodeSpec:
    """One node of a tree that is being built, with its children: a description, made by a Builder.

    It may stand in several trees, and several times in one. *where* is the ``(file, line)`` that made it.
    """

    def __init__(
        self, id: str, children: Sequence["NodeSpec"], attributes: Mapping[str, str], where: tuple[str, int]
    ) -> None:
        self.id = id
        self.children = tuple(children)
        self.attributes = dict(attributes)
        self.where = where

    def __repr__(self) -> str:
        return f"<{' '.join([self.id, *(f'{key}={quoted(text)}' for key, text in self.attributes.items())])}>"


def blackboard_key(name: str) -> str:
    """The port text for the blackboard entry *name*: ``key("goal")`` is ``"{goal}"``."""
    return f"{{{name}}}"


class Builder:
    """Makes twigs of the nodes of a registry: ``b.Sequence(…)``, or ``b["Sequence"](…)``.

    Children come first; keywords are ports, ``name``, ``_skipIf`` and the like. A value is written as
    its text; a keyword that Python has for itself takes an underscore more (``if_``, ``else_``).
    ``b.SubTree("Dock", goal="{home}")`` calls a tree; :meth:`node` makes a twig of the function or class
    that is registered.
    """

    def __init__(self, nodes: Registry | None = None) -> None:
        self._nodes = nodes if nodes is not None else Registry.standard()

    def __getattr__(self, id: str) -> Callable[..., NodeSpec]:
        if id.startswith("__"):
            raise AttributeError(id)
        return self._maker(id, _caller())

    def __getitem__(self, id: str) -> Callable[..., NodeSpec]:
        return self._maker(id, _caller())

    def node(self, thing: Any, *children: NodeSpec, **ports: object) -> NodeSpec:
        """Return a spec of the node that *thing* is registered as. Raises UnknownNodeError."""
        where = _caller()
        for manifest in self._nodes:
            if thing in (manifest.function, manifest.cls):
                return self._twig(manifest, children, ports, where)
        message = f"{getattr(thing, '__qualname__', thing)!r} is not registered"
        raise UnknownNodeError(
            [Diagnostic(UNKNOWN_NODE, message, *where, hint="add it to the registry: nodes.add(…)")]
        )

    def xml(self, main: NodeSpec, id: str = "Main", /, **subtrees: NodeSpec) -> str:
        """The document of the tree *main*, which is called *id*, and of *subtrees* by their IDs."""
        return _Writer(main, id, subtrees, _STEP).text()

    def build(
        self,
        main: NodeSpec,
        id: str = "Main",
        /,
        *,
        resources: Sequence[object] = (),
        blackboard: Blackboard | None = None,
        clock: Clock | None = None,
        **subtrees: NodeSpec,
    ) -> Tree:
        """The tree *main*, ready to be ticked, as :func:`btcore.load` makes one.

        It may be 2,000 levels deep, where a file has 256. Raises TreeError with every fault found, each
        with the file and line that made the twig.
        """
        document = _Writer(main, id, subtrees, "").document()
        return build(document, self._nodes, tree=id, resources=resources, blackboard=blackboard, clock=clock)

    def _maker(self, id: str, where: tuple[str, int]) -> Callable[..., NodeSpec]:
        manifest = self._nodes.get(id)
        if manifest is None:
            near = nearest_name(id, self._nodes.manifests)
            hint = f"did you mean {near}?" if near is not None else "add it to the registry: nodes.add(…)"
            raise UnknownNodeError([Diagnostic(UNKNOWN_NODE, f"unknown node {id}", *where, hint=hint)])

        def make(*children: Any, **ports: object) -> NodeSpec:
            return self._twig(manifest, children, ports, _caller())

        return make

    def _twig(
        self, manifest: Manifest, children: Sequence[Any], ports: Mapping[str, object], where: tuple[str, int]
    ) -> NodeSpec:
        attributes: dict[str, str] = {}
        if manifest.id == "SubTree" and children and isinstance(children[0], str):
            attributes["ID"], *children = children
        for child in children:
            if not isinstance(child, NodeSpec):
                message = f"{child!r} is no child of <{manifest.id}>: children are nodes of a builder"
                hint = "name the port that it is for" if manifest.ports else ""
                raise TreeError([Diagnostic(WRONG_CHILD_COUNT, message, *where, hint=hint)])
        for name, value in ports.items():
            bare = name[:-1] if name.endswith("_") and name not in manifest.ports else name
            attributes[bare] = _text(value, manifest, bare, where)
        return NodeSpec(manifest.id, children, attributes, where)


def _text(value: object, manifest: Manifest, name: str, where: tuple[str, int]) -> str:
    """*value* as the text of the port *name*. Raises PortError, with the place of the call."""
    if isinstance(value, str):
        return value
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, (list, tuple)):
        return ";".join(_text(item, manifest, "", where) for item in value)
    port = manifest.ports.get(name)
    try:
        return port.type.to_text(value) if port is not None and port.type.strong else to_text(value)
    except ConversionError as error:
        message = f"the port '{name}' of <{manifest.id}> is given {value!r}: {error}"
        raise PortError([Diagnostic(INCONVERTIBLE_TEXT, message, *where)]) from error


def _caller() -> tuple[str, int]:
    """The file and the line that called the builder."""
    frame = inspect.currentframe()
    while frame is not None and frame.f_code.co_filename == __file__:
        frame = frame.f_back
    if frame is None:
        return "", 0
    path = Path(frame.f_code.co_filename)
    here = Path.cwd()
    return str(path.relative_to(here) if path.is_relative_to(here) else path), frame.f_lineno


class _Writer:
    """Writes twigs as a document, one element a line, and remembers which twig is which.

    Each level is indented by *step*.
    """

    def __init__(self, main: NodeSpec, id: str, subtrees: Mapping[str, NodeSpec], step: str) -> None:
        self._twigs: list[NodeSpec | None] = [None]
        self._lines = [f'<root BTCPP_format="4" main_tree_to_execute={quoted(id)}>']
        self._main = main
        self._step = step
        self._too_deep: NodeSpec | None = None
        for name, twig in {id: main, **subtrees}.items():
            self._twigs.append(twig)
            self._lines.append(f"{step}<BehaviorTree ID={quoted(name)}>")
            self._write(twig)
            self._lines.append(f"{step}</BehaviorTree>")
        self._lines.append("</root>")

    def _write(self, top: NodeSpec) -> None:
        # A text stands for the end of an element. No recursion: trees built in code may be very deep.
        pending: list[tuple[NodeSpec | str, int]] = [(top, 2)]
        while pending:
            twig, depth = pending.pop()
            indent = self._step * depth
            if isinstance(twig, str):
                self._lines.append(indent + twig)
                continue
            if depth > MAX_BUILDER_DEPTH + 1:
                self._too_deep = twig
            self._twigs.append(twig)
            words = [twig.id, *(f"{key}={quoted(text)}" for key, text in twig.attributes.items())]
            self._lines.append(f"{indent}<{' '.join(words)}{'>' if twig.children else '/>'}")
            if twig.children:
                pending.append((f"</{twig.id}>", depth))
                pending += [(child, depth + 1) for child in reversed(twig.children)]

    def text(self) -> str:
        """The document."""
        return "\n".join(self._lines) + "\n"

    def document(self) -> Document:
        """The document, whose places are those of the code that made the twigs. Raises XmlSyntaxError."""
        if self._too_deep is not None:
            message, where = f"nodes are nested more than {MAX_BUILDER_DEPTH:,} deep", self._too_deep.where
            raise XmlSyntaxError([Diagnostic(TOO_DEEP, message, *where, hint="make parts of it subtrees")])
        text = self.text()
        return _BuiltDocument(parse_text(text).root, text, self._main.where[0], self._twigs)


class _BuiltDocument(Document):
    """A document written by a builder: its faults are told at the lines of the code."""

    max_depth = MAX_BUILDER_DEPTH

    def __init__(self, root: Element, text: str, file: str, twigs: Sequence[NodeSpec | None]) -> None:
        super().__init__(root, EscapedText(text, ()), text, file)
        self._twigs = twigs

    @property
    def folder(self) -> Path:
        """The current folder."""
        return Path()

    def line(self, element: Element) -> int:
        """The line of the code that made *element*."""
        twig = self._twigs[self.source_map.index(element)]
        return twig.where[1] if twig is not None else 0

    def diagnostic(
        self,
        code: DiagnosticCode,
        message: str,
        element: Element | int,
        attribute: str = "",
        part: ElementPart = "value",
        hint: str = "",
        within: int = 0,
    ) -> Diagnostic:
        """As any document's, at the place in the code; the XML is shown, as nobody has written it."""
        found = super().diagnostic(code, message, element, attribute, part, hint, within)
        index = element if isinstance(element, int) else self.source_map.index(element)
        twig = self._twigs[index]
        if twig is None:
            return replace(found, line=0, column=0, source="", width=1)
        file, line = twig.where
        shown = f"it is written {found.source.strip()}"
        return replace(
            found,
            file=file,
            line=line,
            column=0,
            source="",
            width=1,
            hint=f"{hint}; {shown}" if hint else shown,
        )
