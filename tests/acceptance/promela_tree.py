"""Trees as promela.py reads them from XML: nodes, models of leaves, blackboard entries and scripts."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from lxml import etree

IDLE, RUNNING, SUCCESS, FAILURE, SKIPPED = "IDLE", "RUNNING", "SUCCESS", "FAILURE", "SKIPPED"
FIRST_TEXT: Final = 1000
"""The number of the first text."""
_SCRIPT_TOKEN: Final = re.compile(
    r"\s*(?:(?P<text>'[^']*')|(?P<number>\d+)|(?P<name>@?[A-Za-z_]\w*)"
    r"|(?P<sign>:=|\+=|-=|\*=|==|!=|<=|>=|&&|\|\||[-+*<>=!();]))"
)
_LEVELS: Final = (("||",), ("&&",), ("==", "!=", "<", ">", "<=", ">="), ("+", "-"), ("*",))
"""The binary operators of scripts, the weakest first."""


class UntranslatableError(Exception):
    """The tree uses something that the translator does not know."""


@dataclass
class Scope:
    """The blackboard of a tree or subtree: which variable stands for a key."""

    number: int
    parent: "Scope | None" = None
    remapped: dict[str, str] = field(default_factory=dict)
    constants: set[str] = field(default_factory=set)
    autoremap: bool = False

    def variable(self, key: str) -> str:
        """Return the Promela variable of the entry *key*."""
        if key.startswith("@"):
            scope = self
            while scope.parent is not None:
                scope = scope.parent
            return scope.variable(key[1:])
        if self.parent is not None and key not in self.constants:
            if key in self.remapped:
                return self.parent.variable(self.remapped[key])
            if self.autoremap and not key.startswith("_"):
                return self.parent.variable(key)
        return f"entry_{self.number}_{key}"


@dataclass(frozen=True)
class LeafModel:
    """What a leaf with code may do: its declaration for proofs, and the ports of its model."""

    is_condition: bool
    inputs: frozenset[str]
    outputs: tuple[str, ...]
    results: Sequence[str]
    lasts: bool
    at_once: bool
    endless: bool
    uses: frozenset[str]


@dataclass
class Node:
    """An element of the tree. *model* is None for a node that is built in."""

    number: int
    tag: str
    attributes: dict[str, str]
    scope: Scope
    model: LeafModel | None
    children: list["Node"] = field(default_factory=list)

    @property
    def name(self) -> str:
        """Return the name that questions use."""
        return self.attributes.get("name") or self.attributes.get("ID") or self.tag

    @property
    def duration(self) -> int | None:
        """Return the duration of the node's timer (ms), or None if the node has no timer."""
        port = {"Delay": "delay_msec", "Timeout": "msec", "Sleep": "msec"}.get(self.tag)
        return int(self.attributes[port]) if port is not None else None


class Entries:
    """The blackboard entries of all scopes, as Promela variables that hold numbers."""

    def __init__(self) -> None:
        self._texts: dict[str, int] = {}
        self._values: dict[str, str] = {}

    def variable(self, scope: Scope, key: str, value: str = "UNSET") -> str:
        """Return the variable of an entry; its first use decides the value at the start."""
        name = scope.variable(key)
        self._values.setdefault(name, value)
        return name

    def number(self, text: str) -> str:
        """Return the number that stands for a value."""
        if re.fullmatch(r"-?\d+", text):
            return text
        return str(FIRST_TEXT + self._texts.setdefault(text, len(self._texts)))

    def declarations(self) -> list[str]:
        """Return the declarations of the variables."""
        return [f"short {name} = {value};" for name, value in self._values.items()]


def leaf_models(xml: "etree._Element", declared: Mapping[str, Mapping[str, Any]]) -> dict[str, LeafModel]:
    """Return the models of the leaves that the TreeNodesModel of *xml* lists, by ID.

    Args:
        xml: The element `root`.
        declared: The declarations of leaves, by ID, with the keys of LeafModel.
    """
    models: dict[str, LeafModel] = {}
    for element in xml.iterfind("TreeNodesModel/*"):
        ID = element.get("ID", "")
        keys = declared.get(ID, {})
        models[ID] = LeafModel(
            element.tag == "Condition",
            frozenset(port.get("name", "") for port in element.iterfind("input_port")),
            tuple(port.get("name", "") for port in element.iterfind("output_port")),
            keys.get("results", (SUCCESS, FAILURE)),
            keys.get("lasts", element.tag == "Action"),
            keys.get("at_once", True),
            keys.get("endless", False),
            frozenset(keys.get("uses", ())),
        )
    return models


def read_nodes(xml: "etree._Element", models: Mapping[str, LeafModel], entries: Entries) -> list[Node]:
    """Return the nodes of the main tree and its subtrees; each parent comes before its children."""
    trees = {tree.get("ID", ""): tree for tree in xml.iterfind("BehaviorTree")}
    nodes: list[Node] = []
    scopes = 0

    def read(element: "etree._Element", scope: Scope) -> Node:
        nonlocal scopes
        tag, attributes = str(element.tag), {str(key): str(value) for key, value in element.items()}
        node = Node(len(nodes), tag, attributes, scope, models.get(tag))
        nodes.append(node)
        if tag == "SubTree":
            scopes += 1
            inner = _inner_scope(scopes, node, entries)
            node.children = [read(trees[attributes["ID"]][0], inner)]
        else:
            children: Iterator[etree._Element] = element.iterchildren(tag=etree.Element)
            node.children = [read(child, scope) for child in children]
        return node

    main = xml.get("main_tree_to_execute") or next(iter(trees))
    read(trees[main][0], Scope(0))
    return nodes


def _inner_scope(number: int, subtree: Node, entries: Entries) -> Scope:
    """Return the scope of a SubTree element, with its remapped keys and constants."""
    inner = Scope(number, subtree.scope, autoremap=subtree.attributes.get("_autoremap") == "true")
    for key, value in subtree.attributes.items():
        if key in ("ID", "name") or key.startswith("_"):
            continue
        if value.startswith("{"):
            inner.remapped[key] = key if value == "{=}" else value[1:-1]
        else:
            inner.constants.add(key)
            entries.variable(inner, key, entries.number(value))
    return inner


class Script:
    """Translates one script to Promela statements and an expression."""

    def __init__(self, text: str, scope: Scope, entries: Entries) -> None:
        self._text = text
        self._scope = scope
        self._entries = entries
        self._tokens: list[tuple[str, str]] = []
        self._read: list[str] = []
        place = 0
        while text[place:].strip():
            match = _SCRIPT_TOKEN.match(text, place)
            if match is None:
                raise UntranslatableError(f"script '{text}' at '{text[place:]}'")
            self._tokens.append((str(match.lastgroup), match[str(match.lastgroup)]))
            place = match.end()

    def condition(self) -> tuple[list[str], str]:
        """Return statements that raise for unset entries, and the expression."""
        expression = self._binary(0)
        if self._tokens:
            raise UntranslatableError(f"script '{self._text}'")
        return self._checks(), expression

    def statements(self) -> list[str]:
        """Return the statements of a script that only assigns."""
        lines: list[str] = []
        while self._tokens:
            if self._tokens[0][1] == ";":
                self._tokens.pop(0)
                continue
            kind, name = self._tokens.pop(0)
            sign = self._tokens.pop(0)[1] if self._tokens else ""
            if kind != "name" or sign not in (":=", "=", "+=", "-=", "*="):
                raise UntranslatableError(f"script '{self._text}'")
            variable = self._entries.variable(self._scope, name)
            value = self._binary(0)
            if sign != ":=":
                # The entry must exist.
                self._read.append(variable)
            lines += self._checks()
            lines.append(
                f"{variable} = {value if sign in (':=', '=') else f'{variable} {sign[0]} ({value})'};"
            )
        return lines

    def _checks(self) -> list[str]:
        names = list(dict.fromkeys(self._read))
        self._read.clear()
        if not names:
            return []
        unset = " || ".join(f"{name} == UNSET" for name in names)
        return [f"if :: ({unset}) -> error = RAISED; goto finish :: else fi;"]

    def _binary(self, level: int) -> str:
        if level == len(_LEVELS):
            return self._unary()
        left = self._binary(level + 1)
        while self._tokens and self._tokens[0][1] in _LEVELS[level]:
            sign = self._tokens.pop(0)[1]
            left = f"({left} {sign} {self._binary(level + 1)})"
            if level == 2 and self._tokens and self._tokens[0][1] in _LEVELS[level]:
                raise UntranslatableError(f"chained comparison in '{self._text}'")
        return left

    def _unary(self) -> str:
        kind, token = self._tokens.pop(0)
        if token in ("!", "-"):
            return f"({token}{self._unary()})"
        if token == "(":
            inner = self._binary(0)
            self._tokens.pop(0)
            return inner
        if kind == "number":
            return token
        if kind == "text":
            return self._entries.number(token[1:-1])
        if kind != "name":
            raise UntranslatableError(f"script '{self._text}'")
        if token in ("true", "false"):
            return str(int(token == "true"))
        variable = self._entries.variable(self._scope, token)
        self._read.append(variable)
        return variable
