"""Describe nodes, ports and types in Markdown, for hovers and completion."""

import re
from typing import Final

from btcore.blackboard.ports import LOAD_TIME_ROLES, Direction, Port
from btcore.documentation_site import node_url
from btcore.escaping import escape_controls
from btcore.lint.ports import is_required
from btcore.registry.manifest import Manifest
from btcore.registry.nodes_without_code import is_mock
from btcore.status import NodeType
from btcore.suggestions import shortened
from btcore.values import DOUBLE, ValueType
from btcore.values.types import literals_of

ARROWS: Final = {Direction.IN: "→", Direction.OUT: "←", Direction.INOUT: "↔"}
"""The sign of a port's direction: the node reads the port, writes it, or both."""

CONDITION_ATTRIBUTES: Final = {
    "_failureIf": "A script, run before the node starts. If it is true, the node is not ticked and fails.",
    "_successIf": "A script, run before the node starts. If it is true, the node is not ticked and succeeds.",
    "_skipIf": "A script, run before the node starts. If it is true, the node is not ticked and is SKIPPED.",
    "_while": "A script, run before every tick. If it is false, the node is not ticked and is SKIPPED; "
    "a RUNNING node is halted.",
    "_onHalted": "A script that runs after the node was halted.",
    "_onFailure": "A script that runs after the node failed.",
    "_onSuccess": "A script that runs after the node succeeded.",
    "_post": "A script that runs after the node succeeded or failed.",
}
"""The attributes with scripts that every node of format 4 has, with their descriptions."""

SHARING_ATTRIBUTES: Final = {
    "_autoremap": "If true, every other key of the called tree is the key of the same name in this tree.",
    "__autoremap": "If true, every other key of the called tree is the key of the same name in this tree.",
    "__shared_blackboard": "If true, the called tree uses the blackboard of this tree.",
}
"""The attributes of SubTree elements that share entries, with their descriptions."""

ELEMENTS: Final = {
    "root": "The outermost element of a document of trees.",
    "BehaviorTree": "A tree. It has one root node.",
    "include": "Another file, whose trees this file can call.",
    "TreeNodesModel": "The ports of nodes and trees, as Groot writes them.",
}
"""The elements around the nodes, with their descriptions."""

_MAX_CODE: Final = 120
_MAX_DESCRIPTION: Final = 6_000
_MAX_PORTS: Final = 60
_CODE: Final = re.compile(r"(`[^`\n]*`)")
# Characters with which Markdown begins links, pictures and HTML.
_ACTIVE: Final = re.compile(r"[<\[\]!]")


def code(text: str) -> str:
    """Return *text* as code in one line of Markdown. A long text is cut."""
    shown = escape_controls(shortened(text, _MAX_CODE), one_line=True)
    if "`" in shown:
        return f"`` {shown.replace('``', '` `')} ``"
    return f"`{shown}`" if shown else "`''`"


def prose(text: str) -> str:
    """Return a description as Markdown without links, pictures and HTML. A long text is cut."""
    shown = text if len(text) <= _MAX_DESCRIPTION else text[:_MAX_DESCRIPTION] + "…"
    pieces = _CODE.split(shown)
    pieces[::2] = [_ACTIVE.sub(lambda match: f"\\{match[0]}", piece) for piece in pieces[::2]]
    return "".join(pieces)


def type_name(value_type: ValueType) -> str:
    """Return the name of a type without the C++ namespaces."""
    return value_type.name.replace("BT::", "").replace("std::", "")


def is_mandatory(manifest: Manifest, port: Port) -> bool:
    """Return whether a node of *manifest* cannot be loaded, or raises, without *port*."""
    # In a mock node, node_models has marked the ports that the node works without as optional.
    if port.role in LOAD_TIME_ROLES or is_mock(manifest.cls):
        return port.default is None and not port.optional
    return is_required(manifest, port)


def port_signature(port: Port) -> str:
    """Return the direction, the type and the default of a port in one line of text."""
    text = f"{ARROWS[port.direction]} {type_name(port.type)}"
    return f"{text} = {_default(port)}" if port.default else text


def port_markdown(manifest: Manifest, port: Port) -> str:
    """Return the specification of a port."""
    lines = [f"**{port.name}** — {_port_facts(manifest, port)}"]
    if port.description:
        lines += ["", prose(port.description)]
    members = literals_of(port.type)
    if members:
        lines += ["", "Values: " + ", ".join(map(code, members[:_MAX_PORTS]))]
    return "\n".join(lines)


def node_markdown(manifest: Manifest) -> str:
    """Return the specification of a node: what it does, and its ports."""
    facts = [manifest.type.name.lower()]
    if manifest.type in (NodeType.CONTROL, NodeType.DECORATOR) and not is_mock(manifest.cls):
        facts.append(_children(manifest))
    facts.append(f"from {code(manifest.library)}")
    lines = [f"**{manifest.id}** — {', '.join(facts)}", "", prose(manifest.description)]
    ports = list(manifest.ports.values())
    if ports:
        lines += ["", "| port | | |", "|---|---|---|"]
        for port in ports[:_MAX_PORTS]:
            about = " ".join(prose(port.description).split()).replace("|", "\\|")
            lines.append(f"| {code(port.name)} | {_port_facts(manifest, port)} | {about} |")
        if len(ports) > _MAX_PORTS:
            lines.append(f"| … | {len(ports) - _MAX_PORTS} more ports | |")
    url = node_url(manifest.id, manifest.library)
    if url is not None:
        lines += ["", f"[Documentation]({url})"]
    return "\n".join(lines)


def _port_facts(manifest: Manifest, port: Port) -> str:
    text = f"{ARROWS[port.direction]} {code(type_name(port.type))}"
    if port.default:
        return f"{text}, default {code(_default(port))}"
    if port.default is None:
        return f"{text}, {'required' if is_mandatory(manifest, port) else 'optional'}"
    return text


def _default(port: Port) -> str:
    default = port.default or ""
    try:
        return f"{float(default):g}" if port.type is DOUBLE else default
    except ValueError:
        return default  # a key


def _children(manifest: Manifest) -> str:
    low, high = manifest.spec.child_count
    count = f"{low}" if low == high else f"{low} or more" if high is None else f"{low} to {high}"
    roles = manifest.spec.child_roles
    text = f"{count} {'child' if high == 1 else 'children'}"
    return f"{text} ({roles})" if roles else text
