"""Run recorded conformance cases: `python tests/conformance/recorded_cases.py FILE.jsonl.gz …`.

A case contains a tree, a script or a text to convert, and the result that BehaviorTree.CPP returned. The
program prints `N passed, M failed` and the first differences, and exits with 1 if there is a difference.
Differences that docs/reference/differences.md describes are counted separately, and are no failures.

The leaves and `CallLog`, which many tests import, are in this file because the program runs alone: to test an
installed btcore, its path must not contain the repository, and therefore not the package `tests`.
"""

import gzip
import math
import re
import sys
import zlib
from collections.abc import Callable, Iterator, Mapping
from enum import Enum, IntEnum
from pathlib import Path
from typing import Any, Final

from btcore import values
from btcore.blackboard.blackboard import Blackboard
from btcore.blackboard.format3 import Format3Blackboard
from btcore.blackboard.ports import Direction, Port
from btcore.clock import SimClock
from btcore.diagnostic_codes import CONTROL_CHARACTER_IN_NAME, NOT_XML
from btcore.engine.leaf import SyncAction
from btcore.engine.node import TreeNode
from btcore.engine.node_spec import NodeSpec
from btcore.engine.observers import Observer
from btcore.engine.signature import In
from btcore.errors import BlackboardError, BtcoreError, ConversionError, NodeError, NodeExecutionError
from btcore.escaping import escape_controls
from btcore.json_text import load_json
from btcore.loading.load import loads
from btcore.nodes.blackboard_actions import SetBlackboard
from btcore.registry.registry import Registry
from btcore.script.program import compile_script
from btcore.status import FAILURE, SUCCESS, NodeType, Status, Transition
from btcore.testing.leaf_replacement import Act, Ask
from btcore.tree.tree import Tree
from btcore.values import ANY_VALUE, INT
from btcore.xml.read.scan import scan
from btcore.xml.read.tags import EXPLICIT_TAGS

MAX_DIFFERENCES = 10  # that are printed
KINDS = {"xml", "script", "convert"}

ENUMS: Final[Mapping[str, int]] = {"RED": 1, "GREEN": 2, "BLUE": 3}
"""The enums of the recorded scripts."""

RECORDED_TYPES: Final[Mapping[str, values.ValueType]] = {
    "bool": values.BOOL,
    "string": values.STRING,
    "int": values.INT,
    "int8": values.INT8,
    "int16": values.INT16,
    "int32": values.INT,
    "int64": values.INT64,
    "unsigned": values.UINT,
    "uint8": values.UINT8,
    "uint16": values.UINT16,
    "uint32": values.UINT,
    "uint64": values.UINT64,
    "float": values.FLOAT,
    "double": values.DOUBLE,
    "NodeStatus": values.NODE_STATUS,
    "PortDirection": values.PORT_DIRECTION,
    "vector<bool>": values.VECTOR_BOOL,
    "vector<int>": values.VECTOR_INT,
    "vector<double>": values.VECTOR_DOUBLE,
    "vector<string>": values.VECTOR_STRING,
}
"""The types of the conversion cases, by their name in the cases."""

# The rules of docs/reference/differences.md by which recorded cases differ.
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


def read_cases(path: Path) -> Iterator[dict[str, Any]]:
    """Yield the cases in a file, which contains a JSON object in each line and may be compressed with gzip.

    Raises:
        ValueError: A line is not a case.
    """
    with (
        gzip.open(path, "rt", encoding="utf-8")
        if path.suffix == ".gz"
        else path.open(encoding="utf-8") as lines
    ):
        for number, line in enumerate(lines, start=1):
            if line.strip():
                case = load_json(line)
                if not isinstance(case, dict) or "expect" not in case or not KINDS & case.keys():
                    raise ValueError(f"line {number} is not a case")
                yield case


def compare_case(case: dict[str, Any], nodes: Registry) -> str | None:
    """Run a case of any kind, and return the first difference, or None. An exception is a difference, too."""
    try:
        if "convert" in case:
            return compare_conversion_case(case)
        if "script" in case:
            return compare_script_case(case)
        return compare_tree_case(case, nodes)
    except Exception as error:  # an error of the engine must not end the comparison of the other cases
        return f"running the case raised {type(error).__name__}: {error}"


def main(arguments: list[str]) -> int:
    """Run the cases in the files *arguments*, and return the exit code."""
    if not arguments or arguments[0] in ("-h", "--help"):
        print(__doc__)
        return 2
    nodes = conformance_registry()
    passed = documented = 0
    differences: list[str] = []
    for name in arguments:
        try:
            for case in read_cases(Path(name)):
                difference = compare_case(case, nodes)
                if difference is None:
                    passed += 1
                elif documented_difference(case, nodes) is not None:
                    documented += 1
                else:
                    differences.append(f"{name}: {case.get('id', '?')}: {difference}")
        except (OSError, ValueError, EOFError, zlib.error) as error:
            print(f"{name}: cannot read the file as recorded cases: {error}", file=sys.stderr)
            return 2
    counts = f"{passed} passed, {len(differences)} failed"
    if documented:
        counts += f", {documented} differ as documented"
    print(escape_controls("\n".join([counts, *differences[:MAX_DIFFERENCES]])))
    return 1 if differences else 0


def conformance_registry() -> Registry:
    """Return the standard registry with the leaves of the recorded cases."""
    nodes = Registry.standard()
    nodes.add(PlanAction, PlanCondition, PlanSync, Inc)
    nodes.add(RecordedAct, ID="Act")
    nodes.add(RecordedAsk, ID="Ask")
    return nodes


class CallLog(list[str]):
    """The calls of leaves so far, in order. An entry is `NAME:CALL`, for example `n3:start`."""

    def record(self, name: str, call: str) -> None:
        """Record a call of the leaf *name*: `start`, `running`, `halted` or `tick`."""
        self.append(f"{name}:{call}")

    def take(self) -> list[str]:
        """Return the calls since the last call of this method."""
        taken = list(self)
        self.clear()
        return taken


class RecordedAct(Act):
    """A mock action that records its calls."""

    spec = NodeSpec(state_fields=())
    calls: CallLog

    def on_start(self) -> Status:
        """Record the call, unless the outcomes cannot be read."""
        self.own_outcomes()
        self.calls.record(self.name, "start")
        return super().on_start()

    def on_running(self) -> Status:
        """Record the call."""
        self.calls.record(self.name, "running")
        return super().on_running()

    def on_halted(self) -> None:
        """Record the call."""
        self.calls.record(self.name, "halted")


class RecordedAsk(Ask):
    """A mock condition that records its calls."""

    spec = NodeSpec(state_fields=())
    calls: CallLog

    def tick(self) -> Status:
        """Record the call."""
        self.calls.record(self.name, "tick")
        return super().tick()


def recorded_outcomes(leaf: TreeNode) -> str:
    """Return the outcomes in the port `plan`. In the recordings, all letters but R, S, F and K raise."""
    return re.sub("[^RSFK|]", "X", str(leaf.get_input("plan")))


class PlanAction(RecordedAct):
    """The action of the recorded cases, whose outcomes are in the port `plan`."""

    plan: In[str]
    own_outcomes = recorded_outcomes


class PlanCondition(RecordedAsk):
    """The condition of the recorded cases."""

    plan: In[str]
    own_outcomes = recorded_outcomes


class PlanSync(PlanCondition):
    """The action of the recorded cases that completes within a tick."""

    spec = NodeSpec(node_type=NodeType.ACTION, must_complete=True)


class Inc(SyncAction):
    """An action that writes `in` + 1 to `out`, and fails if `in` cannot be read. `tick` is recorded."""

    spec = NodeSpec(state_fields=())

    def __init__(self, calls: CallLog) -> None:
        self.calls = calls

    @staticmethod
    def provided_ports() -> list[Port]:
        """Return the ports."""
        return [Port("in", type=INT), Port("out", Direction.OUT, type=INT)]

    def tick(self) -> Status:
        """Add 1."""
        self.calls.record(self.name, "tick")
        try:
            value = self.get_input("in")
        except (NodeError, BlackboardError, ConversionError):
            return FAILURE
        port = self.config.outputs.get("out")
        # Without a blackboard key there is nothing to write, which is not an error.
        if port is not None and port.key is not None and isinstance(value, int):
            port.write(value + 1)
        return SUCCESS


class TickRecorder(Observer):
    """Records the status changes since the last snapshot, and the state of the tree when a node raises."""

    def __init__(self, tree: Tree, calls: CallLog) -> None:
        self.tree = tree
        self.calls = calls
        self.names = {node.config.uid: node.name for node in tree}
        self.events: list[list[str]] = []
        self.at_error: dict[str, Any] | None = None

    def transition(self, change: Transition) -> None:
        """Record the transition."""
        self.events.append([self.names[change.uid], change.previous.name, change.status.name])

    def raised(self, error: NodeExecutionError, stamp: int) -> None:
        """Record the state of the tree before it is halted."""
        self.at_error = {"exception": str(error), **self.snapshot()}

    def snapshot(self) -> dict[str, Any]:
        """Return the state of the tree and the events, in the form of the recorded cases."""
        events, self.events = self.events, []
        return {
            "bb": recorded_blackboard(self.tree.blackboard),
            "calls": self.calls.take(),
            "events": events,
            "nodes": {node.name: node._status.name for node in self.tree},
        }


def run_case(case: dict[str, Any], nodes: Registry) -> dict[str, Any]:
    """Run the tree of a case with this engine, and return the result in the form of the case's `expect`."""
    calls = CallLog()
    board = Format3Blackboard() if case["format"] == 3 else Blackboard()
    for key, value in case.get("bb", {}).items():
        board.set(key, value)
    try:
        tree = loads(
            case["xml"],
            nodes=nodes,
            resources=[calls],
            tree=case.get("tree"),
            blackboard=board,
            format=case["format"],
            clock=SimClock(),
        )
    except BtcoreError as error:
        return {"load_error": str(error)}
    recorder = TickRecorder(tree, calls)
    tree.subscribe(recorder)
    step: Callable[[], Status] = tree.tick_once if case.get("tick") == "once" else tree.tick_exactly_once
    ticks: list[dict[str, Any]] = []
    for _ in range(case["ticks"]):
        try:
            status = step()
        except NodeExecutionError:
            ticks.append(recorder.at_error or {})
            break
        ticks.append({"status": status.name, **recorder.snapshot()})
    return {"ticks": ticks}


def compare_tree_case(case: dict[str, Any], nodes: Registry) -> str | None:
    """Return the first difference between this engine and the recorded result of a tree, or None."""
    expected = case["expect"]
    actual = run_case(case, nodes)
    if "load_error" in expected:
        return None if "load_error" in actual else "the tree should be rejected, but it loads"
    if "load_error" in actual:
        return f"the tree should load, but it is rejected: {actual['load_error']}"
    for number, (before, now) in enumerate(zip(expected["ticks"], actual["ticks"], strict=False), start=1):
        if ("exception" in before) != ("exception" in now):
            return f"tick {number}: expected {_result(before)}, got {_result(now)}"
        for key in ("status", "calls", "events", "nodes", "bb"):
            if before.get(key) != now.get(key):
                return f"tick {number}: {key}: expected {before.get(key)}, got {now.get(key)}"
    if len(expected["ticks"]) != len(actual["ticks"]):
        return f"expected {len(expected['ticks'])} ticks, got {len(actual['ticks'])}"
    return None


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
    for element in scan(xml).elements:
        id = element.get("ID") if element.tag in EXPLICIT_TAGS else None
        manifest = nodes.get(element.tag if id is None else id)
        if manifest is None or len(manifest.ports) < 2:
            continue
        order = {name: index for index, name in enumerate(reversed(manifest.ports))}
        written = element.attributes
        arranged = sorted(written, key=lambda attribute: order.get(attribute.name, -1))
        for old, new in zip(written, arranged, strict=True):
            pieces += (xml[done : old.start], xml[new.start : new.end])
            done = old.end
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


def documented_difference(case: dict[str, Any], nodes: Registry) -> str | None:
    """Return the rule of docs/reference/differences.md that explains why *case* differs, or None.

    Args:
        case: A case for which `compare_case` has returned a difference.
        nodes: The registry of the cases.
    """
    if case.get("format") != 4 or "xml" not in case:
        return None
    rule = load_rule(case["xml"], case["expect"], run_case(case, nodes))
    rearranged = {**case, "xml": rearranged_ports(case["xml"], nodes)}
    if rule is not None:
        return rule
    if "load_error" in case["expect"]:
        return PORT_ORDER_RULE if compare_tree_case(rearranged, nodes) is None else None
    emptying = nodes.copy()
    emptying.replace(SetBlackboard=EmptyingSetBlackboard)
    for rule, variant, registry in (
        (HALT_RULE, case, nodes),
        (UNTYPED_TEXT_RULE, case, emptying),
        (PORT_ORDER_RULE, rearranged, nodes),
        (PORT_ORDER_RULE, rearranged, emptying),
    ):
        if _is_equal_until_halt(variant, registry):
            return rule
    return None


def _is_equal_until_halt(case: dict[str, Any], nodes: Registry) -> bool:
    """Return whether the result is the recorded one, except for an exception that ended a halt there."""
    if compare_tree_case(case, nodes) is None:
        return True
    before, now = case["expect"]["ticks"], run_case(case, nodes).get("ticks", [])
    if len(before) != len(now) or not before or not halts_further(before[-1], now[-1]):
        return False
    earlier = {**case, "ticks": len(before) - 1, "expect": {"ticks": before[:-1]}}
    return compare_tree_case(earlier, nodes) is None


def _result(tick: dict[str, Any]) -> str:
    return f"an exception ({tick['exception']})" if "exception" in tick else str(tick.get("status"))


def recorded_value(value: object) -> object:
    """Return a value in the form of the recorded cases.

    Numbers are floats, strings and None stay the same, and any other value is "?". Infinity and NaN are None,
    since JSON does not support them.
    """
    if value is None or isinstance(value, str):
        return value
    number = values.number_of(value)
    if number is None:
        return "?"
    return float(number) if math.isfinite(number) else None


def recorded_blackboard(board: Blackboard) -> dict[str, object]:
    """Return the entries of a blackboard in the form of the recorded cases.

    Each value is the value that a node reads by the key. So the value for the key `@x` is the value of
    `x` in the root's blackboard.
    """
    entries = {key: board.find(key) for key in sorted(board.local_entries())}
    return {key: None if entry is None else recorded_value(entry.value) for key, entry in entries.items()}


def compare_script_case(case: Mapping[str, Any]) -> str | None:
    """Return the first difference in the value, the error or the blackboard of a script, or None."""
    board = Blackboard()
    for key, value in case["bb"].items():
        board.set(key, value)
    expected: Mapping[str, Any] = case["expect"]
    try:
        value = recorded_value(compile_script(case["script"], ENUMS).run(board))
    except BtcoreError as error:
        if "error" not in expected:
            return f"raised ({error}), but the original returned {expected.get('value')!r}"
    else:
        if difference := _compare_values(value, value, expected):
            return difference
    actual = recorded_blackboard(board)
    recorded: Mapping[str, Any] = expected["bb"]
    if actual.keys() != recorded.keys() or not all(_equal(actual[key], recorded[key]) for key in recorded):
        return f"the blackboard contains {actual}, but in the original {dict(recorded)}"
    return None


def compare_conversion_case(case: Mapping[str, Any]) -> str | None:
    """Return the difference between this engine and the recorded conversion of a text, or None."""
    kind = RECORDED_TYPES.get(case["convert"])
    if kind is None:
        return f"unknown type {case['convert']}"
    expected: Mapping[str, Any] = case["expect"]
    try:
        value = kind.from_text(case["text"])
    except BtcoreError as error:
        if "error" not in expected:
            return f"raised ({error}), but the original returned {expected['value']!r}"
        return None
    # Some types are recorded as numbers, others by name.
    if isinstance(value, IntEnum) and isinstance(expected.get("value"), int):
        return _compare_values(value, int(value), expected)
    return _compare_values(value, _as_json(value), expected)


def _compare_values(value: object, comparable: object, expected: Mapping[str, Any]) -> str | None:
    """Return the difference between a value and the recorded result, which may be an error, or None.

    Args:
        value: The value.
        comparable: The value in the form of the recorded cases.
        expected: The recorded result.
    """
    if "error" in expected:
        return f"returned {value!r}, but the original raised: {expected['error']}"
    if not _equal(comparable, expected.get("value")):
        return f"returned {value!r}, but the original returned {expected.get('value')!r}"
    return None


def _as_json(value: object) -> object:
    """Return a value in the form of a conversion case: enums, infinity and NaN by their names."""
    if isinstance(value, list):
        return [_as_json(item) for item in value]
    if isinstance(value, Enum):
        return values.to_text(value)
    if isinstance(value, float) and not math.isfinite(value):
        return "nan" if math.isnan(value) else ("inf" if value > 0 else "-inf")
    return value


def _equal(actual: object, expected: object) -> bool:
    """Return whether two values are equal and of the same type: True is not 1, and 1 is not 1.0."""
    if isinstance(actual, list) and isinstance(expected, list):
        return len(actual) == len(expected) and all(map(_equal, actual, expected))
    return type(actual) is type(expected) and actual == expected


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
