"""The cost of a node's features in a tick: ports, scripts, conditions and subtrees.

    python benchmarks/features.py [--pairs 9] [--quick] [--json]

Each tree is a Sequence of 100 children, and is compared with the same tree without the feature: the ratio is
the time for a child with the feature divided by the time without it. The leaves are classes written in
Python; instead of a port, the leaf without the feature reads or writes a plain attribute. The leaves of
py_trees access py_trees' own blackboard by a client. A script is compared with Python's ``eval`` of the
compiled expression.
"""

from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec

import btcore
from btcore import In, Out, Registry, Status, SyncAction, action
from btcore.tree.tree import Tree
from measure.benchmark_trees import SUCCESS, Succeed
from measure.paired_timing import SLICE, Work, measure
from measure.report import NO_PY_TREES, Report, create_parser, in_short

py_trees_trees = import_module("measure.py_trees_trees") if find_spec("py_trees") else None

WIDTH = 100
ENTRIES = {"pace": 0.5, "n": 1, "far": 0.5}


class HasAttribute(SyncAction):
    """Reads an attribute."""

    def __init__(self) -> None:
        self.speed = 0.5

    def tick(self) -> Status:
        self.speed  # noqa: B018 - the access is the work
        return SUCCESS


class HasInput(SyncAction):
    """Reads a port."""

    speed: In[float]

    def tick(self) -> Status:
        self.speed  # noqa: B018
        return SUCCESS


class SetsAttribute(SyncAction):
    """Writes an attribute."""

    def __init__(self) -> None:
        self.distance = 0.0

    def tick(self) -> Status:
        self.distance = 0.5
        return SUCCESS


class HasOutput(SyncAction):
    """Writes a port."""

    distance: Out[float]

    def tick(self) -> Status:
        self.distance = 0.5
        return SUCCESS


@action
def without() -> bool:
    return True


@action
def with_input(speed: In[float]) -> bool:
    return True


TREES = {
    "nothing": "<Succeed/>",
    "attribute read": "<HasAttribute/>",
    "port, a literal": '<HasInput speed="0.5"/>',
    "port, an entry": '<HasInput speed="{pace}"/>',
    "attribute written": "<SetsAttribute/>",
    "port written": '<HasOutput distance="{far}"/>',
    "function": "<Without/>",
    "function with a port": '<WithInput speed="{pace}"/>',
    "built-in": "<AlwaysSuccess/>",
    "script": '<Script code="n := n + 1"/>',
    "pre-condition": '<Succeed _failureIf="n &lt; 0"/>',
    "post-condition": '<Succeed _onSuccess="far := 0.5"/>',
    "decorator": "<ForceSuccess><Succeed/></ForceSuccess>",
    "subtree": '<SubTree ID="Plain"/>',
    "port below a decorator": '<ForceSuccess><HasInput speed="{pace}"/></ForceSuccess>',
    "port remapped twice": '<SubTree ID="Outer" speed="{pace}"/>',
}
SUBTREES = """<BehaviorTree ID="Plain"><Succeed/></BehaviorTree>
<BehaviorTree ID="Outer"><SubTree ID="Inner" pace="{speed}"/></BehaviorTree>
<BehaviorTree ID="Inner"><HasInput speed="{pace}"/></BehaviorTree>"""
COMPARISONS = [
    ("an input port, a literal / an attribute", "port, a literal", "attribute read"),
    ("an input port, an entry / an attribute", "port, an entry", "attribute read"),
    ("an output port / an attribute", "port written", "attribute written"),
    ("a function with an input port / without", "function with a port", "function"),
    ("a leaf with _failureIf / without", "pre-condition", "nothing"),
    ("a leaf with _onSuccess / without", "post-condition", "nothing"),
    ("a leaf in a SubTree / in a decorator", "subtree", "decorator"),
    ("a port through two SubTrees / through a decorator", "port remapped twice", "port below a decorator"),
    ("<Script code='n := n + 1'/> / AlwaysSuccess", "script", "built-in"),
    ("<Script code='n := n + 1'/> / Python's eval", "script", "eval"),
    ("py_trees, reading an entry / an input port", "py_trees reads", "port, an entry"),
    ("py_trees, writing an entry / an output port", "py_trees writes", "port written"),
]
"""The text of each row, and the names of the two trees whose times are divided."""


def create_tree(child: str) -> Tree:
    """Return a tree that is a Sequence of WIDTH copies of the XML element *child*."""
    nodes = Registry.standard()
    nodes.add(Succeed, HasAttribute, HasInput, SetsAttribute, HasOutput, without, with_input)
    main = f'<BehaviorTree ID="Main"><Sequence>{child * WIDTH}</Sequence></BehaviorTree>'
    text = f'<root BTCPP_format="4" main_tree_to_execute="Main">{main}{SUBTREES}</root>'
    tree = btcore.loads(text, nodes=nodes)
    for key, value in ENTRIES.items():
        tree.blackboard[key] = value
    return tree


def evaluation() -> Work:
    """Return a function that does the same as WIDTH scripts ``n := n + 1``, with Python's ``eval``."""
    code = compile("n + 1", "script", "eval")
    names: dict[str, object] = {"__builtins__": {}, "n": 1}
    evaluate: Callable[..., object] = eval

    def loop() -> None:
        for _ in range(WIDTH):
            names["n"] = evaluate(code, names)

    return loop


def main() -> None:
    """Run the benchmark."""
    options = create_parser(__doc__ or "").parse_args()
    report = Report("features", "The cost of a node's ports, scripts, conditions and subtrees", options.pairs)
    works: dict[str, Work] = {name: create_tree(child).tick_once for name, child in TREES.items()}
    works["eval"] = evaluation()
    if py_trees_trees is None:
        report.remarks.append(NO_PY_TREES)
    else:
        works["py_trees reads"] = py_trees_trees.row_of(py_trees_trees.Reads, WIDTH).tick_once
        works["py_trees writes"] = py_trees_trees.row_of(py_trees_trees.Writes, WIDTH).tick_once
    measured = measure(works, report.pairs, slice_ns=1 if options.quick else SLICE)
    for label, dividend, divisor in COMPARISONS:
        if dividend in works and divisor in works:
            own, peer = (in_short(measured.time(name).median / WIDTH) for name in (dividend, divisor))
            report.add(label, measured.ratio(dividend, divisor), figures={"ns": own, "beside": peer})
    report.output(options.json)


if __name__ == "__main__":
    main()
