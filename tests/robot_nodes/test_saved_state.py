"""Robot and Nav2 nodes declare their state, so that a tree can be saved and restored."""

import ast
import inspect
import textwrap

import pytest

import btcore
from btcore import Registry, SimClock, Tree, TreeNode
from btcore_navigation import nodes as nav2_nodes
from btcore_proof.tree_state import state_fields_of
from btcore_robot.robot import Pose2D, Waypoints
from tests.conformance.recorded_cases import CallLog, RecordedAct
from tests.saved_state import restore_state, save_state

XML = """<root BTCPP_format="4"><BehaviorTree ID="Main">
  <ParallelAll max_failures="-1">
    <PipelineSequence>
      <Act outcomes="RS"/><Act outcomes="RRS|RF"/><Act outcomes="RRRS"/>
    </PipelineSequence>
    <RecoveryNode number_of_retries="2"><Act outcomes="RF|F|RS"/><Act outcomes="RS"/></RecoveryNode>
    <RoundRobin><Act outcomes="RS"/><Act outcomes="RF"/><Act outcomes="S"/></RoundRobin>
    <NonblockingSequence><Act outcomes="RS"/><Act outcomes="RRS"/></NonblockingSequence>
    <RateController hz="40"><Act outcomes="S|RS"/></RateController>
    <SingleTrigger><Act outcomes="RS"/></SingleTrigger>
    <GoalUpdatedController goal="{goal}"><Act outcomes="RS|S"/></GoalUpdatedController>
    <ReactiveFallback>
      <TimeExpired seconds="0.03"/><GoalUpdated goal="{goal}"/><Act outcomes="RRRRRS"/>
    </ReactiveFallback>
    <ReactiveFallback><GlobalUpdatedGoal goal="{goal}"/><Act outcomes="RRRS"/></ReactiveFallback>
  </ParallelAll>
</BehaviorTree></root>"""


def registry() -> Registry:
    nodes = Registry.standard()
    for library in ("btcore_robot.leaves", "btcore_navigation.leaves"):
        nodes.add_plugin(library)
    nav2_nodes.register(nodes)
    nodes.add(RecordedAct, ID="Act")
    return nodes


def new_tree(start: int) -> Tree:
    return btcore.loads(XML, nodes=registry(), clock=SimClock(start), resources=[CallLog()])


def tick(tree: Tree) -> list[str]:
    """Change the goal in every fourth tick, tick the tree, and return the statuses of its nodes."""
    tree.blackboard["goal"] = Pose2D(tree.ticks // 4, 0.0, 0.0)
    tree.tick_exactly_once()
    statuses = [node.status.name for node in tree]
    tree.sleep(0.01)
    return statuses


@pytest.mark.parametrize("count", range(10))
def test_restored_tree_of_nav2_nodes_does_the_same_as_the_saved_tree(count: int) -> None:
    original = new_tree(0)
    for _ in range(count):
        tick(original)
    restored = new_tree(original.clock.now())
    restore_state(restored, save_state(original))
    assert [tick(restored) for _ in range(10)] == [tick(original) for _ in range(10)]


def test_waypoint_nodes_of_a_restored_tree_continue_the_patrol_together() -> None:
    text = """<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence>
        <GetWaypoint waypoint="{first}"/> <GetWaypoint waypoint="{second}"/>
      </Sequence></BehaviorTree></root>"""
    places = Waypoints({f"wp{number}": Pose2D(number, 0.0, 0.0) for number in (1, 2, 3)})
    tree, restored = (btcore.loads(text, nodes=registry(), resources=[places]) for _ in range(2))
    tree.tick_once()
    restore_state(restored, save_state(tree))
    for _ in range(2):
        tree.tick_once()
        restored.tick_once()
        assert dict(restored.blackboard) == dict(tree.blackboard)
    assert len(set(tree.blackboard.values())) == 2


def assigned(cls: type[TreeNode]) -> set[str]:
    """Return the attributes that the methods of *cls*, apart from ``__init__``, assign."""
    (definition,) = ast.parse(textwrap.dedent(inspect.getsource(cls))).body
    assert isinstance(definition, ast.ClassDef)
    return {
        node.attr
        for method in definition.body
        if isinstance(method, ast.FunctionDef) and method.name != "__init__"
        for node in ast.walk(method)
        if isinstance(node, ast.Attribute)
        and isinstance(node.ctx, ast.Store)
        and isinstance(node.value, ast.Name)
        and node.value.id == "self"
    }


def test_every_attribute_that_a_robot_node_assigns_is_declared_as_state() -> None:
    undeclared = set()
    found = 0
    for manifest in registry():
        classes = [
            cls
            for cls in manifest.cls.__mro__
            if cls.__module__.startswith(("btcore_navigation.", "btcore_robot."))
        ]
        for cls in classes:
            assert issubclass(cls, TreeNode)
            names = assigned(cls) - set(manifest.ports)
            found += bool(names)
            if manifest.spec.state_fields is not None:
                undeclared |= {
                    f"{cls.__name__}.{name}" for name in names - set(state_fields_of(manifest.cls))
                }
    assert undeclared == set()
    assert found > 20
