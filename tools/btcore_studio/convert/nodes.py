"""Convert the IDs and ports of nodes, and report how nodes behave differently in format 4."""

import re
from collections.abc import Callable, Mapping
from typing import Final

from btcore.blackboard.ports import Direction, Port, remapped_key
from btcore.diagnostic_codes import (
    ATTRIBUTE_RENAMED,
    CHECKED_ONCE,
    EMPTY_ATTRIBUTE_REMOVED,
    ENTRY_TYPE_KEPT,
    MANUAL_STEP,
    NODE_RENAMED,
    ONE_CYCLE_PER_TICK,
    PARALLEL_THRESHOLDS,
    SEQUENCE_MEMORY,
    SWITCH_COMPARISON,
    TAG_MADE_COMPACT,
    TEXT_REINTERPRETED,
    TEXT_REWRITTEN,
)
from btcore.errors import ConversionError
from btcore.script.lexer import NAME, tokenize
from btcore.values import BOOL, DOUBLE, INT, STRING, ValueType
from btcore.xml.read.element import Element
from btcore.xml.read.tags import EXPLICIT_TAGS, NODE_REPLACEMENTS
from btcore_studio.convert.changes import ConversionChanges

_TAG: Final = re.compile(r"[A-Za-z_][\w.-]*\Z", re.ASCII)

# Texts that std::from_chars may read as a number: two cases of a Switch can be equal as numbers although
# their texts differ.
_NUMBER: Final = re.compile(r"-?(?:[0-9.]|inf|nan)", re.I)
_CHECKED_TYPES: Final[Mapping[str, ValueType]] = {
    "BlackboardCheckInt": INT,
    "BlackboardCheckDouble": DOUBLE,
    "BlackboardCheckBool": BOOL,
    "BlackboardCheckString": STRING,
}
_NO_PORTS: Final = ("name", "ID", "_description")
_RENAMED_PORTS: Final = {"success_threshold": "success_count", "failure_threshold": "failure_count"}


def convert_node(changes: ConversionChanges, element: Element, parent: Element) -> None:
    """Convert a node with its ports, and report how its behavior differs in format 4."""
    tag = element.tag
    id = (element.get("ID") or "") if tag in EXPLICIT_TAGS else tag
    new = _convert_behavior(changes, element, id)
    if new != id:
        changes.note(NODE_RENAMED, f"<{id}> becomes <{new}>", element)
    # The attributes of a BlackboardCheck were converted together with the node.
    if new != "Precondition" or id == new:
        _convert_ports(changes, element, id, new)
    if tag not in EXPLICIT_TAGS:
        if new != id:
            changes.rename_element(element, new)
    elif "ReactiveSequence" in (parent.tag, parent.get("ID")) and _TAG.match(new):
        changes.rename_element(element, new)
        changes.remove_attribute(element, "ID")
        reason = f"BehaviorTree.CPP 4 rejects <{tag}> in a ReactiveSequence"
        message = f'<{tag} ID="{new}"> becomes <{new}>: {reason}'
        changes.note(TAG_MADE_COMPACT, message, element)
    elif new != id:
        changes.set_attribute(element, "ID", new)


def _convert_behavior(changes: ConversionChanges, element: Element, id: str) -> str:
    """Apply the rule for nodes with the ID *id*, if there is a rule. Return the node's ID in format 4."""
    new = NODE_REPLACEMENTS.get(id, id)
    if id in _CHECKED_TYPES:
        return new if _convert_check(changes, element, id) else id
    rule = _RULES.get(id)
    if rule is not None:
        rule(changes, element, id)
    elif new == id and changes.registry.get(id, 3) is None:
        taken = changes.registry.get(id, 4)
        if taken is not None and taken.library == "btcore":
            message = f"<{id}> is the name of a built-in node in format 4"
            changes.note(MANUAL_STEP, message, element, hint="give your node another ID")
    return new


def _convert_sequence_star(changes: ConversionChanges, element: Element, id: str) -> None:
    if len(element.node_children()) < 2:
        return
    message = (
        "<SequenceWithMemory> returns RUNNING after a child that succeeds immediately, and resumes at the "
        "same child after a halt; <SequenceStar> does neither"
    )
    changes.note(SEQUENCE_MEMORY, message, element)


def _convert_loop(changes: ConversionChanges, element: Element, id: str) -> None:
    port, repeated_if = ("num_cycles", "succeeds") if id == "Repeat" else ("num_attempts", "fails")
    limit = element.attributes.get(port, "")
    if limit in ("0", "1"):
        return  # without a second cycle there is no difference
    name = NODE_REPLACEMENTS.get(id, id)
    message = f"a child of <{name}> that {repeated_if} immediately is ticked again only in the next tick"
    hint = "format 3 ticks it again in the same tick; tick_once() ticks the whole tree again without a pause"
    changes.note(ONE_CYCLE_PER_TICK, message, element, hint=hint)


def _convert_parallel(changes: ConversionChanges, element: Element, id: str) -> None:
    attributes = element.attributes
    message = (
        "<Parallel> is RUNNING before its children are ticked, in format 3 only afterwards: observers see it"
    )
    changes.note(PARALLEL_THRESHOLDS, message, element)
    for old, new in _RENAMED_PORTS.items():
        if old not in attributes:
            continue
        changes.rename_attribute(element, old, new)
        changes.note(ATTRIBUTE_RENAMED, f"'{old}' becomes '{new}'", element, old, part="name")
        if attributes[old].strip() == "0" or remapped_key(attributes[old], old, 3) is not None:
            message = (
                f'{new}="0" is reached with the first result of a child; in format 3 it is never reached'
            )
            changes.note(PARALLEL_THRESHOLDS, message, element, old)
    if "success_threshold" not in attributes:
        message = "without a 'success_count' all children have to succeed; format 3 fails without the port"
        changes.note(PARALLEL_THRESHOLDS, message, element)


def _convert_switch(changes: ConversionChanges, element: Element, id: str) -> None:
    enums = changes.registry.types.enums
    for name, text in element.attributes.items():
        if not name.startswith("case_"):
            continue
        if remapped_key(text, name, 3) is not None or _NUMBER.match(text) or text in enums:
            message = f'{name}="{text}" is compared as a number too, where format 3 compares texts'
            changes.note(SWITCH_COMPARISON, message, element, name)


def _convert_set_blackboard(changes: ConversionChanges, element: Element, id: str) -> None:
    value = element.attributes.get("value", "")
    if remapped_key(value, "value", 3) is not None:
        message = f"<SetBlackboard> fails if the entry {value} is empty; format 3 copies an empty entry"
    else:
        message = (
            f"'{value}' is converted to the type of the entry, or is an error, and a second write makes the "
            "entry a text permanently; format 3 always stores the text"
        )
    changes.note(ENTRY_TYPE_KEPT, message, element, "value")


def _convert_check(changes: ConversionChanges, element: Element, id: str) -> bool:
    """Convert a BlackboardCheck to a Precondition. Return False if that is not possible."""
    attributes = element.attributes
    script = _comparison(attributes, _CHECKED_TYPES[id])
    if script is None:
        message = (
            f"<{id}> is not converted: format 4 lacks the node, and a script can't express the comparison"
        )
        hint = "in a script, entry names have letters, digits and '_' only, and texts have no quotes"
        changes.note(MANUAL_STEP, message, element, hint=hint)
        return False
    first, second = (name for name in attributes if name in ("value_A", "value_B"))
    changes.rename_attribute(element, first, "if")
    changes.set_attribute(element, first, script)
    changes.remove_attribute(element, second)
    if "return_on_mismatch" in attributes:
        changes.rename_attribute(element, "return_on_mismatch", "else")
    message = (
        "<Precondition> checks before the child starts, not while it runs, and a missing entry is an error; "
        f"<{id}> checks on every tick, and a missing entry is a mismatch"
    )
    hint = f'to check on every tick: a <ReactiveSequence> of <ScriptCondition code="{script}"/> and the child'
    changes.note(CHECKED_ONCE, message, element, hint=hint)
    return True


def _comparison(attributes: Mapping[str, str], value_type: ValueType) -> str | None:
    """Return `value_A == value_B` as a script, or None if a script can't express it."""
    sides: list[str] = []
    for name in ("value_A", "value_B"):
        text = attributes.get(name)
        if text is None:
            return None
        key = remapped_key(text, name, 3)
        side = _literal(text, value_type) if key is None else key if _is_name(key) else None
        if side is None:
            return None
        sides.append(side)
    return " == ".join(sides)


def _is_name(key: str) -> bool:
    # The second token marks the end of the script.
    types = [token.type for token in tokenize(key)]
    return len(types) == 2 and types[0] == NAME and not key.startswith("@")


def _literal(text: str, value_type: ValueType) -> str | None:
    """Return the script literal for *text*, read as *value_type*, or None if there is none."""
    try:
        value = value_type.from_text(text, 3)
    except ConversionError:
        return None
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return None if "'" in value else f"'{value}'"
    # A script has no literals for infinity and NaN.
    shown = repr(value)
    return shown if shown not in ("inf", "-inf", "nan") else None


def _convert_ports(changes: ConversionChanges, element: Element, id: str, new_id: str) -> None:
    """Rewrite the port texts of a node. In unknown nodes, rewrite only texts that name a blackboard entry."""
    old = changes.registry.get(id, 3)
    new = changes.registry.get(new_id, 4)
    for name, text in element.attributes.items():
        if name in _NO_PORTS:
            continue
        port = old.ports.get(name) if old is not None else None
        new_name = _RENAMED_PORTS.get(name, name) if id == "Parallel" else name
        target = new.ports.get(new_name) if new is not None else None
        _convert_port(changes, element, name, text, port, target)


def _convert_port(
    changes: ConversionChanges, element: Element, name: str, text: str, old: Port | None, new: Port | None
) -> None:
    key = remapped_key(text, name, 3)
    # In format 3 an output port accepts the key without braces.
    if key is None and old is not None and old.direction is Direction.OUT:
        key = text or None
    if key is not None:
        _convert_pointer(changes, element, name, text, key)
    elif remapped_key(text, name, 4) is not None:
        message = f"'{name}' is the text '{text}' in format 3, and an entry of the blackboard in format 4"
        changes.note(TEXT_REINTERPRETED, message, element, name)
    elif new is not None and new.type.strong and new.type is not STRING:
        _convert_literal(changes, element, name, text, new)


def _convert_pointer(changes: ConversionChanges, element: Element, name: str, text: str, key: str) -> None:
    if key == "=" and text != "=":
        message = f"'{name}' is the entry '=' in format 3, and the entry '{name}' in format 4"
        changes.note(TEXT_REINTERPRETED, message, element, name)
        return
    new_text = "{=}" if text == "=" else f"{{{key}}}"
    if text != new_text:
        changes.set_attribute(element, name, new_text)
        changes.note(TEXT_REWRITTEN, f'{name}="{text}" becomes {name}="{new_text}"', element, name)


def _convert_literal(changes: ConversionChanges, element: Element, name: str, text: str, port: Port) -> None:
    if not text:
        changes.remove_attribute(element, name)
        effect = "the default is used" if port.default is not None else "reading the port raises an error"
        message = f"the empty '{name}' is removed: in format 4 it is not a valid {port.type.name}; {effect}"
        changes.note(EMPTY_ATTRIBUTE_REMOVED, message, element, name)
        return
    if not port.type.converts:
        return
    try:
        value = port.type.from_text(text, 3)
    except ConversionError:
        return
    try:
        same = port.type.from_text(text, 4) == value
    except ConversionError:
        same = False
    if same or not isinstance(value, (int, float)):
        return
    new_text = str(value).lower() if isinstance(value, bool) else repr(value)
    changes.set_attribute(element, name, new_text)
    message = f'{name}="{text}" becomes {name}="{new_text}", as format 3 reads it'
    changes.note(TEXT_REWRITTEN, message, element, name)


_RULES: Final[dict[str, Callable[[ConversionChanges, Element, str], None]]] = {
    "SequenceStar": _convert_sequence_star,
    "Repeat": _convert_loop,
    "RetryUntilSuccessful": _convert_loop,
    "RetryUntilSuccesful": _convert_loop,
    "Parallel": _convert_parallel,
    **{f"Switch{number}": _convert_switch for number in range(2, 7)},
    "SetBlackboard": _convert_set_blackboard,
}
