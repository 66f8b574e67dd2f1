"""What each thing that a node may have adds to its tick: ports, scripts, conditions, subtrees.

    python benchmarks/features.py [--pairs 9] [--json]

Each tree is a Sequence of 100 children, and is ticked beside the same tree without the thing: the ratio is
what one child takes with it over what it takes without. Leaves are classes, written in Python; where a port
is read or written, the leaf without it reads or writes a plain attribute. py_trees' leaves read and write
its blackboard by a client. A script's peer is Python's own ``eval`` of the compiled expression.
"""

from collections.abc import Callable

import btcore
from btcore import In, Out, Registry, Status, SyncAction, action
from btcore.tree.tree import Tree
from measure.benchmark_trees import SUCCESS, Succeed
from measure.paired_timing import SLICE, Spread, Work, measure
from measure.report import Report, arguments, in_short

try:
    from measure import py_trees_leaves
except ModuleNotFoundError as missing:
    if missing.name != "py_trees":
        raise
    py_trees_leaves = None

WIDTH = 100
ENTRIES = {"pace": 0.5, "n": 1, "far": 0.5}


class HasAttribute(SyncAction):
    """Reads an attribute."""

    def __init__(self) -> None:
        self.speed = 0.5

    def tick(self) -> Status:
        self.speed  # noqa: B018 - reading it is the work
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
    (
        "a port through two SubTrees / through a decorator",
        "port remapped twice",
        "port below a decorator",
    ),
    ("<Script code='n := n + 1'/> / AlwaysSuccess", "script", "built-in"),
    ("<Script code='n := n + 1'/> / Python's eval", "script", "eval"),
    ("py_trees, reading an entry / an input port", "py_trees reads", "port, an entry"),
    ("py_trees, writing an entry / an output port", "py_trees writes", "port written"),
]
"""What is printed: the words, and the two whose ratio it is."""


def grow(child: str) -> Tree:
    """A Sequence of WIDTH times *child*."""
    nodes = Registry.standard()
    nodes.add(Succeed, HasAttribute, HasInput, SetsAttribute, HasOutput, without, with_input)
    main = f'<BehaviorTree ID="Main"><Sequence>{child * WIDTH}</Sequence></BehaviorTree>'
    text = f'<root BTCPP_format="4" main_tree_to_execute="Main">{main}{SUBTREES}</root>'
    tree = btcore.loads(text, nodes=nodes)
    for key, value in ENTRIES.items():
        tree.blackboard[key] = value
    return tree


def evaluating() -> Work:
    """What a script does, by Python's own means: WIDTH times an expression, and a name that takes it."""
    code = compile("n + 1", "script", "eval")
    names: dict[str, object] = {"__builtins__": {}, "n": 1}
    evaluate: Callable[..., object] = eval

    def loop() -> None:
        for _ in range(WIDTH):
            names["n"] = evaluate(code, names)

    return loop


def main() -> None:
    """Measure and print."""
    given = arguments(__doc__ or "").parse_args()
    report = Report("features", "What a node's ports, scripts, conditions and subtrees cost", given.pairs)
    works: dict[str, Work] = {name: grow(child).tick_once for name, child in TREES.items()}
    works["eval"] = evaluating()
    if py_trees_leaves is None:
        report.remarks.append("py_trees isn't installed; you can have it: pip install 'btcore[bench]'")
    else:
        works["py_trees reads"] = py_trees_leaves.grow(py_trees_leaves.Reads, WIDTH).tick_once
        works["py_trees writes"] = py_trees_leaves.grow(py_trees_leaves.Writes, WIDTH).tick_once
    taken = measure(works, report.pairs, slice_ns=1 if given.quick else SLICE)
    for what, dividend, divisor in COMPARISONS:
        if dividend in works and divisor in works:
            ratio: Spread = taken.ratio(dividend, divisor)
            one, other = (taken.time(name).median / WIDTH for name in (dividend, divisor))
            report.add(what, ratio, figures={"ns": in_short(one), "beside": in_short(other)})
    report.output(given.json)


if __name__ == "__main__":
    main()
