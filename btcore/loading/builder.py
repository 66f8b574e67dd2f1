"""Build trees in Python code: each node is a method of a Builder, each port a keyword argument.

The tree is written as XML and then loaded like any other document:

    b = Builder(nodes)  # by default the nodes of Registry.standard()
    bump = b.Sequence(b.Back(), b.Turn(angle=1.57), name="bump")
    tree = b.build(b.ReactiveSequence(b.Fallback(b.Inverter(b.IsObstacle()), bump), b.Forward()))
    print(b.xml(bump))
"""

import inspect
from collections.abc import Callable, Mapping, Sequence
from enum import Enum
from functools import partial
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
from btcore.diagnostics import Diagnostic
from btcore.errors import ConversionError, PortError, TreeError, UnknownNodeError, XmlSyntaxError
from btcore.fixes import Fix
from btcore.loading.instantiate import instantiate
from btcore.loading.load import registry_or_standard
from btcore.registry.manifest import Manifest
from btcore.registry.registry import Registry
from btcore.suggestions import nearest_name, suggestion
from btcore.tree.tree import Tree
from btcore.values import to_text
from btcore.xml.models.tree_nodes_model import quoted
from btcore.xml.plan.plan import plan_document
from btcore.xml.read.document import Document
from btcore.xml.read.element import Element
from btcore.xml.read.read import parse_text

_STEP: Final = "    "
MAX_BUILDER_DEPTH: Final = 2_000
"""Maximum number of levels of a tree that is built in code."""


class NodeDraft:
    """A node and its children as code describes them, created by a Builder.

    A NodeDraft can be used in several trees, and several times in a tree. *where* is the `(file, line)`
    of the code that created it.
    """

    def __init__(
        self, id: str, children: Sequence["NodeDraft"], attributes: Mapping[str, str], where: tuple[str, int]
    ) -> None:
        self.id = id
        self.children = tuple(children)
        self.attributes = dict(attributes)
        self.where = where

    def __repr__(self) -> str:
        return f"<{' '.join([self.id, *(f'{key}={quoted(text)}' for key, text in self.attributes.items())])}>"


def blackboard_key(name: str) -> str:
    """Return the port text for the entry *name*: `blackboard_key("goal")` is `"{goal}"`.

    Examples:
        >>> from btcore import blackboard_key
        >>> blackboard_key("goal")
        '{goal}'
    """
    return f"{{{name}}}"


class Builder:
    """Creates drafts (`NodeDraft`) of registered nodes: `b.Sequence(…)`, or `b["Sequence"](…)`.

    Positional arguments are children; keywords are ports, `name`, `_skipIf` and other attributes.
    Values are converted to text. Append an underscore to names that are Python keywords (`if_`,
    `else_`). `b.SubTree("Dock", goal="{home}")` calls a tree; `node` creates a draft from a
    registered function or class. An ID that is not registered raises UnknownNodeError.

    Examples:
        >>> import btcore
        >>> b = btcore.Builder()
        >>> bump = b.Fallback(b.AlwaysFailure(name="free"), b.Sleep(msec=500), name="bump")
        >>> print(b.xml(bump), end="")
        <root BTCPP_format="4" main_tree_to_execute="Main">
            <BehaviorTree ID="Main">
                <Fallback name="bump">
                    <AlwaysFailure name="free"/>
                    <Sleep msec="500"/>
                </Fallback>
            </BehaviorTree>
        </root>
        >>> b.build(bump, clock=btcore.SimClock()).tick_while_running()
        <Status.SUCCESS: 2>
    """

    def __init__(self, nodes: Registry | None = None) -> None:
        self._nodes = registry_or_standard(nodes)

    def __getattr__(self, id: str) -> Callable[..., NodeDraft]:
        if id.startswith("__"):
            raise AttributeError(id)
        return self[id]

    def __getitem__(self, id: str) -> Callable[..., NodeDraft]:
        manifest = self._nodes.get(id)
        if manifest is None:
            near = nearest_name(id, self._nodes.manifests)
            hint = suggestion(near) if near is not None else "add it to the registry: nodes.add(…)"
            raise UnknownNodeError([Diagnostic(UNKNOWN_NODE, f"unknown node {id}", *_caller(), hint=hint)])
        return partial(self._describe, manifest)

    def node(self, implementation: Any, *children: NodeDraft, **ports: object) -> NodeDraft:
        """Return a draft of a node, given its function or class.

        Args:
            implementation: The registered function or class.
            *children: Drafts of the children.
            **ports: Ports and other attributes.

        Raises:
            UnknownNodeError: *implementation* is not registered.
        """
        for manifest in self._nodes:
            if implementation in (manifest.function, manifest.cls):
                return self._describe(manifest, *children, **ports)
        message = f"{getattr(implementation, '__qualname__', implementation)!r} is not registered"
        raise UnknownNodeError(
            [Diagnostic(UNKNOWN_NODE, message, *_caller(), hint="add it to the registry: nodes.add(…)")]
        )

    def xml(self, main: NodeDraft, id: str = "Main", /, **subtrees: NodeDraft) -> str:
        """Return the XML of a tree and its subtrees.

        Args:
            main: The root of the main tree.
            id: ID of the main tree.
            **subtrees: The roots of the subtrees, by their IDs.

        Raises:
            XmlSyntaxError: The tree has more than `MAX_BUILDER_DEPTH` levels.
        """
        return _write(main, id, subtrees, _STEP)[0]

    def build(
        self,
        main: NodeDraft,
        id: str = "Main",
        /,
        *,
        resources: Sequence[object] = (),
        blackboard: Blackboard | None = None,
        clock: Clock | None = None,
        tick_limit: float | None = None,
        **subtrees: NodeDraft,
    ) -> Tree:
        """Build a tree, as `btcore.load` does. It can have more levels than a tree in a file.

        Args:
            main: The root of the main tree.
            id: ID of the main tree.
            resources: Objects that leaves require, selected by their types.
            blackboard: The blackboard of the main tree; by default a new blackboard.
            clock: The clock; by default the first of *resources* that is a clock, else the system clock.
            tick_limit: As in `btcore.load`.
            **subtrees: The roots of the subtrees, by their IDs.

        Returns:
            The tree.

        Raises:
            TreeError: The tree has errors; each has the file and line of the code that created the draft.
        """
        text, drafts = _write(main, id, subtrees, "")
        document = _BuiltDocument(text, main.where[0], drafts)
        plans = plan_document(document, self._nodes, id)
        return instantiate(plans, resources, blackboard, clock, tick_limit)

    def _describe(self, manifest: Manifest, /, *children: Any, **ports: object) -> NodeDraft:
        where = _caller()
        attributes: dict[str, str] = {}
        # The first argument of b.SubTree("Dock") is an ID, not a child.
        if manifest.id == "SubTree" and children and isinstance(children[0], str):
            attributes["ID"], children = children[0], children[1:]
        for child in children:
            if not isinstance(child, NodeDraft):
                message = f"invalid child {child!r} of <{manifest.id}>: children must be nodes of a builder"
                hint = "to set a port, use its name as keyword" if manifest.ports else ""
                raise TreeError([Diagnostic(WRONG_CHILD_COUNT, message, *where, hint=hint)])
        for name, value in ports.items():
            # "if_" stands for the port "if", unless a port has the name "if_".
            bare = name[:-1] if name.endswith("_") and name not in manifest.ports else name
            attributes[bare] = _text(value, manifest, bare, where)
        return NodeDraft(manifest.id, children, attributes, where)


def _text(value: object, manifest: Manifest, name: str, where: tuple[str, int]) -> str:
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
        message = f"invalid value {value!r} of the port '{name}' of <{manifest.id}>: {error}"
        raise PortError([Diagnostic(INCONVERTIBLE_TEXT, message, *where)]) from error


def _caller() -> tuple[str, int]:
    """Return the file and the line of the code that called the builder."""
    frame = inspect.currentframe()
    while frame is not None and frame.f_code.co_filename == __file__:
        frame = frame.f_back
    if frame is None:
        return "", 0
    path = Path(frame.f_code.co_filename)
    here = Path.cwd()
    return str(path.relative_to(here) if path.is_relative_to(here) else path), frame.f_lineno


def _write(
    main: NodeDraft, id: str, subtrees: Mapping[str, NodeDraft], step: str
) -> tuple[str, list[NodeDraft | None]]:
    """Return the XML of a document, and the draft of each element in document order; `<root>` has no draft.

    Each element has a line of its own, which each level indents by *step*.
    """
    drafts: list[NodeDraft | None] = [None]
    lines = [f'<root BTCPP_format="4" main_tree_to_execute={quoted(id)}>']
    for name, root in {id: main, **subtrees}.items():
        drafts.append(root)
        lines.append(f"{step}<BehaviorTree ID={quoted(name)}>")
        # A str is an end tag. A loop instead of recursion, because trees may be very deep.
        pending: list[tuple[NodeDraft | str, int]] = [("</BehaviorTree>", 1), (root, 2)]
        while pending:
            draft, depth = pending.pop()
            indent = step * depth
            if isinstance(draft, str):
                lines.append(indent + draft)
                continue
            if depth > MAX_BUILDER_DEPTH + 1:
                message = f"nodes are nested more than {MAX_BUILDER_DEPTH:,} deep"
                hint = "make parts of it subtrees"
                raise XmlSyntaxError([Diagnostic(TOO_DEEP, message, *draft.where, hint=hint)])
            drafts.append(draft)
            words = [draft.id, *(f"{key}={quoted(text)}" for key, text in draft.attributes.items())]
            lines.append(f"{indent}<{' '.join(words)}{'>' if draft.children else '/>'}")
            if draft.children:
                pending.append((f"</{draft.id}>", depth))
                pending += [(child, depth + 1) for child in reversed(draft.children)]
    return "\n".join([*lines, "</root>"]) + "\n", drafts


class _BuiltDocument(Document):
    """A document written by a builder: diagnostics refer to the lines of the code."""

    max_depth = MAX_BUILDER_DEPTH

    def __init__(self, text: str, file: str, drafts: Sequence[NodeDraft | None]) -> None:
        super().__init__(parse_text(text).root, text, file)
        self._drafts = drafts

    def line(self, element: Element) -> int:
        """Return the line of the code that created *element*."""
        draft = self._drafts[self.source_map.index(element)]
        return draft.where[1] if draft is not None else 0

    def diagnostic(
        self,
        code: DiagnosticCode,
        message: str,
        element: Element,
        hint: str = "",
        fixes: Sequence[Fix] = (),
        **_: object,
    ) -> Diagnostic:
        """Return a diagnostic at the place in the code, with the generated XML in the hint; without fixes."""
        draft = self._drafts[self.source_map.index(element)]
        if draft is None:
            return Diagnostic(code, message, self.file, hint=hint)
        shown = f"the generated XML is {super().diagnostic(code, message, element).source.strip()}"
        return Diagnostic(code, message, *draft.where, hint=f"{hint}; {shown}" if hint else shown)
