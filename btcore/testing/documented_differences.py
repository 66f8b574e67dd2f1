"""The differences of docs/reference/differences.md by which recorded cases differ, and how to recognise them.

Most rules are recognised by running a case with the behaviour of BehaviorTree.CPP: if the results are equal
then, the rule is the only reason for the difference.
"""

import re
from collections.abc import Mapping
from typing import Any, Final

from btcore.diagnostic_codes import CONTROL_CHARACTER_IN_NAME, NOT_XML
from btcore.errors import BlackboardError
from btcore.nodes.blackboard_actions import SetBlackboard
from btcore.registry.registry import Registry
from btcore.values import ANY_VALUE
from btcore.xml.read.dialect import EXPLICIT_TAGS
from btcore.xml.read.tinyxml2_compat import find_attribute, iter_attributes, iter_start_tags

EXPLICIT_TAGS_RULE: Final = "explicit tags below ReactiveSequence"
UNTYPED_TEXT_RULE: Final = "SetBlackboard of a text to an entry without a type"
PORT_ORDER_RULE: Final = "order in which a node's ports create entries"
WIDER_TYPE_RULE: Final = "integer written by user code"
HALT_RULE: Final = "exception while nodes are halted"
NAME_RULE: Final = "line break or tab in a node's name"
ZERO_CHARACTER_RULE: Final = "&#0;, &#; and references to surrogates (&#xD800;)"

_UNKNOWN_TAG: Final = re.compile(rf"Unknown node type: ({'|'.join(EXPLICIT_TAGS)})$")
_WIDER_TYPE: Final = re.compile(
    r"created with type \[(?:int|long)\] and, later type \[(?:long|float|double)\]"
)
_ERROR_CODE: Final = re.compile(r" (E\d{3}) ")


class EmptyingSetBlackboard(SetBlackboard):
    """SetBlackboard as in BehaviorTree.CPP 4.10, which empties an entry without a type."""

    def put_text(self, key: str, text: str) -> None:
        """Write *text*, which needs a converter of the entry's type. The type BT::Any has none."""
        entry = self.blackboard.find(key)
        if entry is None or entry.declared.strong:
            super().put_text(key, text)
            return
        if entry.declared is ANY_VALUE:
            raise BlackboardError(f"no conversion from text for the entry '{key}' of type BT::Any")
        board = self.blackboard.root if key.startswith("@") else self.blackboard
        if board.local_entries().get(key.lstrip("@")) is entry:
            entry.declared = ANY_VALUE
        entry.put(None, board.now())


def rearranged_ports(xml: str, nodes: Registry) -> str:
    """Return *xml* with the ports of each node in the order in which BehaviorTree.CPP creates their entries.

    This is the order of a hash table, in which ports that were declared later come first.
    """
    pieces: list[str] = []
    done = 0
    for tag in iter_start_tags(xml):
        id = find_attribute(tag, "ID") if tag[1] in EXPLICIT_TAGS else None
        manifest = nodes.get(tag[1] if id is None else id[2] or "")
        if manifest is None or len(manifest.ports) < 2:
            continue
        order = {name: index for index, name in enumerate(reversed(manifest.ports))}
        written = list(iter_attributes(tag))
        arranged = sorted(written, key=lambda attribute: order.get(attribute[1], -1))
        for old, new in zip(written, arranged, strict=True):
            pieces += (xml[done : old.start()], new[0])
            done = old.end()
    return "".join((*pieces, xml[done:]))


def load_rule(xml: str, expected: Mapping[str, Any], actual: Mapping[str, Any]) -> str | None:
    """Return the rule that explains why only one of the two engines rejects a tree, or None.

    Args:
        xml: The tree.
        expected: The recorded result.
        actual: The result of this engine.
    """
    refused, ours = expected.get("load_error"), actual.get("load_error")
    if refused is not None and ours is None:
        if _UNKNOWN_TAG.search(refused) is not None and "<ReactiveSequence" in xml:
            return EXPLICIT_TAGS_RULE
        return WIDER_TYPE_RULE if _WIDER_TYPE.search(refused) is not None else None
    if refused is None and ours is not None:
        codes = set(_ERROR_CODE.findall(ours))
        if codes == {CONTROL_CHARACTER_IN_NAME}:
            return NAME_RULE
        return ZERO_CHARACTER_RULE if codes == {NOT_XML} and " is not a character" in ours else None
    return None


def halts_further(before: Mapping[str, Any], now: Mapping[str, Any]) -> bool:
    """Return whether an exception ended the halt of nodes in the recorded tick *before*, and not in *now*."""
    if "exception" not in before or "exception" not in now:
        return False
    events, calls = before["events"], before["calls"]
    more = now["events"][len(events) :]
    return (
        now["events"][: len(events)] == events
        and now["calls"][: len(calls)] == calls
        and bool(more)
        and more[-1][2] == "IDLE"
        and all(now["nodes"].get(name) in (status, "IDLE") for name, status in before["nodes"].items())
    )
