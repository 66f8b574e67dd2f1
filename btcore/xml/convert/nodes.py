"""Nodes that format 4 calls otherwise, or that do something else there."""

import re
from collections.abc import Callable, Mapping
from typing import Final

from btcore.blackboard.ports import remapped_key
from btcore.diagnostic_codes import (
    ATTRIBUTE_RENAMED,
    CHECKED_ONCE,
    ENTRY_TYPE_KEPT,
    LOOP_YIELDS,
    MANUAL_STEP,
    PARALLEL_THRESHOLDS,
    SEQUENCE_MEMORY,
    SWITCH_COMPARISON,
)
from btcore.errors import ConversionError
from btcore.script.lexer import NAME, tokenize
from btcore.values import (
    BOOL,
    DOUBLE,
    INT,
    STRING,
    ValueType,
)
from btcore.xml.convert.changes import ConversionContext
from btcore.xml.plan.structure_checks import element_children
from btcore.xml.read.dialect import NODE_REPLACEMENTS
from btcore.xml.read.element import Element

# What std::from_chars reads as a number, or nearly so: such cases may be equal without being the same text.
_NUMBER: Final = re.compile(r"-?(?:[0-9.]|inf|nan)", re.I)
_ELEMENT: Final[Mapping[str, ValueType]] = {
    "BlackboardCheckInt": INT,
    "BlackboardCheckDouble": DOUBLE,
    "BlackboardCheckBool": BOOL,
    "BlackboardCheckString": STRING,
}


def convert_node(changes: ConversionContext, element: Element, id: str) -> str:
    """What format 4 calls the node *id*; notes what is different about it there."""
    new = NODE_REPLACEMENTS.get(id, id)
    if id in _ELEMENT:
        return new if _check(changes, element, id) else id
    rule = _RULES.get(id)
    if rule is not None:
        rule(changes, element, id)
    elif new == id and changes.registry.get(id, 3) is None:
        taken = changes.registry.get(id, 4)
        if taken is not None and taken.distribution == "btcore":
            message = f"format 4 has a node of its own that is called <{id}>"
            changes.note(MANUAL_STEP, message, element, hint="give yours another ID")
    return new


def _star(changes: ConversionContext, element: Element, id: str) -> None:
    if len(element_children(element)) < 2:
        return
    message = (
        "<SequenceWithMemory> yields after a child that succeeds at once, and goes on at the same child "
        "after a halt; <SequenceStar> does neither"
    )
    changes.note(SEQUENCE_MEMORY, message, element)


def _repeated(changes: ConversionContext, element: Element, id: str) -> None:
    port, again = ("num_cycles", "succeeds") if id == "Repeat" else ("num_attempts", "fails")
    limit = element.attributes.get(port, "")
    if limit in ("0", "1"):
        return
    name = NODE_REPLACEMENTS.get(id, id)
    message = f"<{name}> yields: a child that {again} at once is ticked again in the next tick"
    hint = "format 3 ticks it again in the same one; tick_once() ticks the whole tree again without a pause"
    changes.note(LOOP_YIELDS, message, element, hint=hint)


def _parallel(changes: ConversionContext, element: Element, id: str) -> None:
    given = element.attributes
    message = "<Parallel> is RUNNING before its children are ticked, in format 3 only after: observers see it"
    changes.note(PARALLEL_THRESHOLDS, message, element)
    for old, new in (("success_threshold", "success_count"), ("failure_threshold", "failure_count")):
        if old not in given:
            continue
        changes.rewriter.rename_attribute(element, old, new)
        changes.note(ATTRIBUTE_RENAMED, f"'{old}' becomes '{new}'", element, old, part="name")
        if given[old].strip() == "0" or remapped_key(given[old], old, 3) is not None:
            message = f'{new}="0" is reached with the first child\'s result; in format 3 it is never reached'
            changes.note(PARALLEL_THRESHOLDS, message, element, old)
    if "success_threshold" not in given:
        message = "without a 'success_count' all children have to succeed; format 3 fails without the port"
        changes.note(PARALLEL_THRESHOLDS, message, element)


def _switch(changes: ConversionContext, element: Element, id: str) -> None:
    enums = changes.registry.types.enums
    for name, text in element.attributes.items():
        if not name.startswith("case_"):
            continue
        if remapped_key(text, name, 3) is not None or _NUMBER.match(text) or text in enums:
            message = f'{name}="{text}" is compared as a number too, where format 3 compares texts'
            changes.note(SWITCH_COMPARISON, message, element, name)


def _store(changes: ConversionContext, element: Element, id: str) -> None:
    value = element.attributes.get("value", "")
    if remapped_key(value, "value", 3) is not None:
        message = f"<SetBlackboard> fails when the entry of {value} is empty, where format 3 copies that too"
    else:
        message = (
            f"'{value}' is converted to the type that the entry has, or refused, and a second write makes "
            "the entry a text for good; format 3 stores the text"
        )
    changes.note(ENTRY_TYPE_KEPT, message, element, "value")


def _check(changes: ConversionContext, element: Element, id: str) -> bool:
    """Make a Precondition of a BlackboardCheck; whether it can be one."""
    given = element.attributes
    script = _comparison(given, _ELEMENT[id])
    if script is None:
        message = f"what <{id}> compares can't be said in a script; format 4 has no such node, and it is left"
        hint = "an entry of a script has a name of letters, digits and '_'; a text holds no quote"
        changes.note(MANUAL_STEP, message, element, hint=hint)
        return False
    first, second = (name for name in given if name in ("value_A", "value_B"))
    rewriter = changes.rewriter
    rewriter.rename_attribute(element, first, "if")
    rewriter.set_attribute(element, first, script)
    rewriter.remove_attribute(element, second)
    if "return_on_mismatch" in given:
        rewriter.rename_attribute(element, "return_on_mismatch", "else")
    message = (
        "<Precondition> asks before the child starts, and not while it runs; an entry that is missing is an "
        f"error; <{id}> asks on every tick, and takes it for a mismatch"
    )
    hint = f'to ask on every tick: a <ReactiveSequence> of <ScriptCondition code="{script}"/> and the child'
    changes.note(CHECKED_ONCE, message, element, hint=hint)
    return True


def _comparison(given: Mapping[str, str], kind: ValueType) -> str | None:
    """``value_A == value_B`` as a script, or None."""
    sides: list[str] = []
    for name in ("value_A", "value_B"):
        text = given.get(name)
        if text is None:
            return None
        key = remapped_key(text, name, 3)
        side = _literal(text, kind) if key is None else key if _is_name(key) else None
        if side is None:
            return None
        sides.append(side)
    return " == ".join(sides)


def _is_name(key: str) -> bool:
    kinds = [token.kind for token in tokenize(key)]
    return len(kinds) == 2 and kinds[0] == NAME and not key.startswith("@")


def _literal(text: str, kind: ValueType) -> str | None:
    """*text*, read as *kind*, as a script writes it; None where it can't."""
    try:
        value = kind.from_text(text, 3)
    except ConversionError:
        return None
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return None if "'" in value else f"'{value}'"
    shown = repr(value)
    return shown if shown not in ("inf", "-inf", "nan") else None


_RULES: Final[dict[str, Callable[[ConversionContext, Element, str], None]]] = {
    "SequenceStar": _star,
    "Repeat": _repeated,
    "RetryUntilSuccessful": _repeated,
    "RetryUntilSuccesful": _repeated,
    "Parallel": _parallel,
    **{f"Switch{number}": _switch for number in range(2, 7)},
    "SetBlackboard": _store,
}
