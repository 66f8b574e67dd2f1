"""The declared state of the nodes is complete: a restored tree has the same future as the saved tree."""

import inspect
from collections import deque
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from btcore import (
    Blackboard,
    BtcoreError,
    NodeError,
    NodeExecutionError,
    NodeSpec,
    Registry,
    SimClock,
    StatefulAction,
    Status,
    Tree,
    TreeNode,
    action,
    loads,
    running,
)
from btcore.blackboard.format3 import Format3Blackboard
from btcore.clock import NS_PER_MS
from btcore.nodes.builtin_nodes import BUILTIN_NODES
from btcore.nodes.manual_selector import Prompt
from btcore.testing import xml_documents
from btcore.testing.tree_generator import BUILTIN_MANIFESTS, SCRIPT_KEYS
from btcore_proof.tree_state import state_fields_of
from tests.conformance.recorded_cases import CallLog, conformance_registry
from tests.saved_state import SavedState, restore_state, save_state

NODES = conformance_registry()
# Attributes of a node that belong to the engine; saved_state saves statuses and blackboards itself.
ENGINE_OWNED = {"_blackboard", "_configs", "_status", "_status_before_reset"}

COMMON_NODES = """<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence>
    <Script code="turn = turn + 1; a = turn"/>
    <ParallelAll max_failures="-1">
      <IfThenElse><Ask outcomes="SF"/><Act outcomes="RRS"/><Act outcomes="RF"/></IfThenElse>
      <Sequence><Act outcomes="K"/><Act outcomes="RRK"/></Sequence>
      <Parallel success_count="2" failure_count="2">
        <Act outcomes="RS"/><Act outcomes="RRF"/><Act outcomes="RRRRS"/>
      </Parallel>
      <Parallel success_count="2" failure_count="2">
        <Act outcomes="RF"/><Act outcomes="RRS"/><Act outcomes="RRRRF"/>
      </Parallel>
      <ParallelAll max_failures="1"><Act outcomes="RF"/><Act outcomes="RRRS"/></ParallelAll>
      <RetryUntilSuccessful num_attempts="3"><Act outcomes="RF|F|RS|F|RF|F"/></RetryUntilSuccessful>
      <RunOnce then_skip="false"><Act outcomes="RF|RS"/></RunOnce>
      <Precondition if="a &gt; 0"><Act outcomes="RRRS"/></Precondition>
      <Timeout msec="35"><Act outcomes="RRRRRRS"/></Timeout>
      <Delay delay_msec="25"><Act outcomes="RS"/></Delay>
      <Sleep msec="25"/>
      <TryCatch><Act outcomes="S"/><Act outcomes="RRS"/><Act outcomes="S"/></TryCatch>
      <TryCatch><Act outcomes="K"/><Act outcomes="RRK"/><Act outcomes="S"/></TryCatch>
      <TryCatch><Act outcomes="RF"/><Act outcomes="RRS"/></TryCatch>
      <Sequence><Act outcomes="RS"/><Script code="a = 0"/></Sequence>
    </ParallelAll></Sequence></BehaviorTree></root>"""
# The nodes that random trees lack, because they need certain texts or entries.
OTHER_NODES = {
    4: """<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence>
        <Script code="turn = turn + 1; a = turn > 2 ? 0 : turn"/>
        <SetBlackboard value="{turn}" output_key="copy"/>
        <ParallelAll max_failures="-1">
          <WasEntryUpdated entry="doubles" _onSuccess="updates = updates + 1"/>
          <SkipUnlessUpdated entry="doubles"><Script code="updates = updates + 10"/></SkipUnlessUpdated>
          <AlwaysSuccess/>
        </ParallelAll>
        <ParallelAll max_failures="-1">
          <LoopInt queue="3;1;2" value="{i}"><Act outcomes="RS|S"/></LoopInt>
          <LoopDouble queue="{doubles}" value="{d}"><Act outcomes="S|RRS"/></LoopDouble>
          <LoopString queue="{shared}" value="{s}"><Act outcomes="RS"/></LoopString>
          <LoopBool queue="true;false" if_empty="FAILURE"><Act outcomes="S|RS"/></LoopBool>
          <SkipUnlessUpdated entry="{often}"><Act outcomes="RRS"/></SkipUnlessUpdated>
          <WaitValueUpdate entry="{a}"><Act outcomes="RS"/></WaitValueUpdate>
          <WasEntryUpdated entry="often" _onSuccess="updates = updates + 1"/>
          <Switch2 variable="{word}" case_1="1" case_2="2">
            <Act outcomes="RRS"/><Act outcomes="RF"/><Act outcomes="RRRS"/>
          </Switch2>
          <Switch3 variable="{word}" case_1="1" case_2="2" case_3="0">
            <Act outcomes="RRS"/><Act outcomes="RF"/><Act outcomes="RRRS"/><Act outcomes="S"/>
          </Switch3>
          <Sequence>
            <Act outcomes="RRRRS"/><Script code="often := turn"/><UnsetBlackboard key="often"/>
            <Act outcomes="RS"/><Script code="often := turn"/>
          </Sequence>
        </ParallelAll></Sequence></BehaviorTree></root>""",
    3: """<root main_tree_to_execute="Main"><BehaviorTree ID="Main"><Sequence>
        <SetBlackboard value="{turn}" output_key="copy"/>
        <Parallel success_threshold="5" failure_threshold="4">
          <ManualSelector repeat_last_selection="true">
            <Act outcomes="RS"/><Act outcomes="F"/>
          </ManualSelector>
          <Switch2 variable="{word}" case_1="1" case_2="2">
            <Act outcomes="RRS"/><Act outcomes="RF"/><Act outcomes="RRRS"/>
          </Switch2>
          <BlackboardCheckInt value_A="{turn}" value_B="2">
            <Act outcomes="RRS"/>
          </BlackboardCheckInt>
          <BlackboardCheckDouble value_A="{turn}" value_B="2.0">
            <Act outcomes="RRS"/>
          </BlackboardCheckDouble>
          <BlackboardCheckString value_A="{text}" value_B="x">
            <Act outcomes="RRS"/>
          </BlackboardCheckString>
          <BlackboardCheckBool value_A="{once}" value_B="true">
            <Act outcomes="RRS"/>
          </BlackboardCheckBool>
          <SubTreePlus ID="Inner" number="{turn}"/>
        </Parallel></Sequence></BehaviorTree>
      <BehaviorTree ID="Inner"><Sequence>
        <Inc in="{number}" out="{number}"/><Act outcomes="RRS|RF"/>
      </Sequence></BehaviorTree></root>""",
}


class ByTime(Prompt):
    """Chooses another option every 10 ms."""

    def __init__(self, clock: SimClock) -> None:
        self.clock = clock

    def choose(self, question: str, options: list[str]) -> int:
        return self.clock.now() // (10 * NS_PER_MS) % len(options)


def new_tree(text: str, format: int, now: int = 0) -> Tree:
    """Return a new tree on a simulated clock that shows *now* (ns)."""
    clock = SimClock(now)
    board = Blackboard(clock=clock) if format == 4 else Format3Blackboard(clock=clock)
    queue = deque(["x", "y", "z"])
    numbers = dict.fromkeys([*SCRIPT_KEYS, "turn", "often", "updates"], 0)
    others = {"doubles": [0.5, 1.5], "shared": queue, "alias": queue, "once": True, "text": "x", "word": "0"}
    for key, value in {**numbers, **others}.items():
        board[key] = value
    resources = [CallLog(), ByTime(clock)]
    return loads(text, nodes=NODES, resources=resources, blackboard=board, clock=clock, format=format)


def tick_result(tree: Tree) -> object:
    """Return the result of a tick, or the text of its exception."""
    try:
        return tree.tick_exactly_once()
    except NodeExecutionError as error:
        return str(error)


def visible_state(tree: Tree) -> list[object]:
    """Return the state of *tree* that is visible_state from outside."""
    scopes = [
        {
            key: (entry.value, entry.declared.name, entry.sequence_id, entry.stamp)
            for key, entry in entries.items()
        }
        for entries in (subtree.blackboard.local_entries() for subtree in tree.subtrees)
    ]
    context = tree.context
    return [
        [node.status for node in tree],
        scopes,
        context.deadlines,
        context.is_woken,
        tree.ticks,
        tree.status,
    ]


def advance(tree: Tree, milliseconds: int) -> None:
    """Advance the time and write an entry; a negative time halts the tree instead."""
    tree.blackboard["word"] = str(tree.ticks % 3)
    if milliseconds < 0:
        tree.halt()
    else:
        tree.sleep(milliseconds / 1000)


def assert_same_future(
    text: str, format: int, before: list[int], after: list[int], raising: bool = False
) -> None:
    """Save a tree after the steps *before*, restore it, and take the steps *after* with both trees."""
    original = new_tree(text, format)
    for step in before:
        tick_result(original)
        advance(original, step)
    saved = save_state(original)
    copies = []
    for _ in range(2):
        restored = new_tree(text, format, original.clock.now())
        restore_state(restored, saved)
        assert visible_state(restored) == visible_state(original)
        copies.append(restored)
    # The trees run one after the other, so that shared state would show.
    futures = [list(future(tree, after)) for tree in (original, *copies)]
    assert raising or "raised while" not in str(futures[0])
    assert futures[1] == futures[0]
    assert futures[2] == futures[0]


def future(tree: Tree, steps: list[int]) -> Iterator[str]:
    for step in steps:
        yield repr((tick_result(tree), visible_state(tree)))
        advance(tree, step)


milliseconds = st.one_of(st.integers(0, 30), st.just(-1))
steps = st.lists(milliseconds, max_size=8)


@given(
    st.one_of(
        xml_documents(timed=True, subtrees=2, conditions=True, scripts=True).map(lambda text: (text, 4)),
        xml_documents(timed=True, subtrees=2, format=3).map(lambda text: (text, 3)),
    ),
    steps,
    st.lists(milliseconds, min_size=1, max_size=8),
)
def test_restored_random_tree_does_the_same_as_the_saved_tree(
    document: tuple[str, int], before: list[int], after: list[int]
) -> None:
    assert_same_future(*document, before, after, raising=True)


@pytest.mark.parametrize("count", range(12))
@pytest.mark.parametrize(
    ("text", "format"),
    [(COMMON_NODES, 4), (OTHER_NODES[4], 4), (OTHER_NODES[3], 3)],
    ids=["common", "4", "3"],
)
def test_restored_tree_does_the_same_as_the_saved_tree(text: str, format: int, count: int) -> None:
    assert_same_future(text, format, [10] * count, [10] * 12)
    assert_same_future(text, format, [10] * count + [-1], [10] * 12)


# --- every attribute that changes is declared


def attributes(node: TreeNode) -> dict[str, str]:
    """Return the attributes of *node* and their values as texts, also for compiled classes."""
    names = set(getattr(node, "__dict__", ()))
    for cls in type(node).__mro__:
        names |= {*inspect.get_annotations(cls), *vars(cls).get("__mypyc_attrs__", ())}
    return {name: text_of(getattr(node, name)) for name in names if hasattr(node, name)}


def text_of(value: object) -> str:
    """Return *value* as a text; a node is written as its path, without its status."""
    if isinstance(value, list):
        return str([text_of(item) for item in value])
    return value.path if isinstance(value, TreeNode) else repr(value)


def changed_attributes(tree: Tree, steps: list[int]) -> set[tuple[type, str]]:
    """Return the attributes that change while *tree* takes *steps*."""
    found = set()
    for step in steps:
        before = [attributes(node) for node in tree]
        tick_result(tree)
        advance(tree, step)
        for node, held in zip(tree, before, strict=True):
            now = attributes(node)
            found |= {(type(node), name) for name in now if now[name] != held.get(name)}
    return found


def is_declared(cls: type[TreeNode], name: str) -> bool:
    return name in state_fields_of(cls) or name in ENGINE_OWNED


@given(
    xml_documents(timed=True, subtrees=2, conditions=True, scripts=True),
    st.lists(milliseconds, min_size=1, max_size=8),
)
def test_every_attribute_that_ticks_change_is_declared_as_state(text: str, steps: list[int]) -> None:
    for cls, name in changed_attributes(new_tree(text, 4), steps):
        assert is_declared(cls, name), f"{cls.__name__}.{name}"


@pytest.mark.parametrize("format", [3, 4])
def test_every_attribute_of_the_other_nodes_that_ticks_change_is_declared_as_state(format: int) -> None:
    changed = changed_attributes(new_tree(OTHER_NODES[format], format), [10] * 12 + [-1] + [10] * 5)
    assert {(cls.__name__, name) for cls, name in changed if not is_declared(cls, name)} == set()
    # A declared attribute that never changes here is needless, or not tested.
    declared = {
        (type(node), name)
        for node in new_tree(OTHER_NODES[format], format)
        if BUILTIN_NODES[format].get(node.id) is type(node) and node.id not in BUILTIN_MANIFESTS[format]
        for name in state_fields_of(type(node))
    }
    assert {(cls.__name__, name) for cls, name in declared - changed} == set()


@pytest.mark.parametrize("format", [3, 4])
def test_these_tests_cover_every_built_in_node_with_state(format: int) -> None:
    tried = {node.id for node in new_tree(OTHER_NODES[format], format)} | BUILTIN_MANIFESTS[format].keys()
    # One of the five Switch classes stands for all: they differ in the number of cases.
    alike = {"Switch2": {"Switch3", "Switch4", "Switch5", "Switch6"}}
    tried |= {other for id in tried for other in alike.get(id, ())}
    assert {id for id, cls in BUILTIN_NODES[format].items() if state_fields_of(cls)} - tried == set()


# --- trees that cannot be saved or restored


def test_the_state_of_another_tree_is_refused() -> None:
    text = '<root BTCPP_format="4"><BehaviorTree ID="T"><AlwaysSuccess name="{}"/></BehaviorTree></root>'
    saved = save_state(loads(text.format("one")))
    with pytest.raises(BtcoreError, match="the saved state is of another tree than 'T'"):
        restore_state(loads(text.format("two")), saved)


def test_coroutine_can_be_saved_only_while_it_is_not_running() -> None:
    @action
    async def twice() -> bool:
        await running()
        return True

    text = '<root BTCPP_format="4"><BehaviorTree ID="T"><Twice name="n"/></BehaviorTree></root>'
    nodes = Registry.standard()
    nodes.add(twice)
    tree = loads(text, nodes=nodes)
    assert isinstance(save_state(tree), SavedState)
    assert tree.tick_exactly_once() is Status.RUNNING
    with pytest.raises(NodeError, match="the state of 'n' <Twice> cannot be saved while it is RUNNING"):
        save_state(tree)


class Count(StatefulAction):
    def on_start(self) -> Status:
        self.left = 3
        return Status.RUNNING

    def on_running(self) -> Status:
        self.left -= 1
        return Status.RUNNING if self.left else Status.SUCCESS


class DeclaredCount(Count):
    spec = NodeSpec(state_fields=("left",))


def tree_of(cls: type[TreeNode]) -> Tree:
    nodes = Registry.standard()
    nodes.add(cls)
    name = cls.__name__
    return loads(f'<root BTCPP_format="4"><BehaviorTree ID="T"><{name}/></BehaviorTree></root>', nodes=nodes)


def test_node_with_attributes_must_declare_its_state() -> None:
    tree = tree_of(Count)
    tree.tick_once()
    message = (
        r"the state of 'Count::1' <Count> cannot be saved: Count does not declare .* \(left\): write for"
    )
    with pytest.raises(NodeError, match=message):
        save_state(tree)


def test_declared_attributes_of_a_users_class_are_restored() -> None:
    tree, other = tree_of(DeclaredCount), tree_of(DeclaredCount)
    tree.tick_once()
    tree.tick_once()
    restore_state(other, save_state(tree))
    assert [other.tick_once(), other.tick_once()] == [Status.RUNNING, Status.SUCCESS]
