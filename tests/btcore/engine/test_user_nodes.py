"""User-defined control nodes and decorators are classes, and are used from XML like built-in nodes."""

import pytest

from btcore import (
    ControlNode,
    DecoratorNode,
    In,
    InOut,
    NodeExecutionError,
    NodeType,
    Out,
    RegistrationError,
    Registry,
    Status,
    TreeError,
    TreeNode,
)
from btcore.nodes.result_decorators import Inverter
from btcore.nodes.sequences_and_fallbacks import Sequence
from tests.btcore.conftest import TreeFactory
from tests.conformance.recorded_cases import CallLog


class Shuffle(ControlNode):
    """Ticks its children from the last to the first, `rounds` times."""

    rounds: In[int] = 1
    done: Out[int]

    def __init__(self, calls: CallLog) -> None:
        self.calls = calls
        self.left: list[int] = []

    def tick(self) -> Status:
        if self.status is Status.IDLE:
            self.left = list(range(len(self.children))) * self.rounds
        self.set_status(Status.RUNNING)
        while self.left:
            status = self.children[self.left[-1]].execute_tick()
            if status is Status.RUNNING:
                return status
            self.halt_child(self.left.pop())
            if status is Status.FAILURE:
                self.reset_children()
                return status
        self.done = self.rounds
        self.reset_children()
        return Status.SUCCESS

    def halt(self) -> None:
        self.calls.record(self.name, "halt")
        super().halt()


class AtMost(DecoratorNode):
    """Gives its child *ticks* ticks, then fails."""

    ticks: In[int]
    used: InOut[int]

    def tick(self) -> Status:
        if self.status is Status.IDLE:
            self.used = 0
        self.set_status(Status.RUNNING)
        if self.used >= self.ticks:
            self.halt_child()
            return Status.FAILURE
        self.used += 1
        return self.child.execute_tick()


def test_control_node_decides_the_order_of_its_children(make_tree: TreeFactory, calls: CallLog) -> None:
    tree = make_tree(
        '<Shuffle name="x" rounds="2" done="{done}">'
        '<Act name="a" outcomes="S"/><Act name="b" outcomes="RS|S"/></Shuffle>',
        Shuffle,
    )
    assert tree.tick_exactly_once() is Status.RUNNING
    assert tree.tick_exactly_once() is Status.SUCCESS
    assert calls == ["b:start", "b:running", "a:start", "b:start", "a:start"]
    assert tree.blackboard["done"] == 2
    assert {node.status for node in tree} == {Status.IDLE}


def test_control_node_is_halted_with_its_children(make_tree: TreeFactory, calls: CallLog) -> None:
    tree = make_tree('<Sequence><Shuffle name="x"><Act name="b" outcomes="R"/></Shuffle></Sequence>', Shuffle)
    tree.tick_once()
    calls.take()
    tree.root.halt()
    assert calls.take() == ["x:halt", "b:halted"]
    assert {node.status for node in tree} == {Status.IDLE}


def test_node_types_ports_and_descriptions_are_known(make_tree: TreeFactory) -> None:
    tree = make_tree(
        '<Shuffle done="{d}"><AtMost ticks="3" used="{u}"><AlwaysSuccess/></AtMost></Shuffle>',
        Shuffle,
        AtMost,
    )
    assert [node.type for node in tree] == [NodeType.CONTROL, NodeType.DECORATOR, NodeType.ACTION]
    assert list(tree.registry.manifests["Shuffle"].ports) == ["rounds", "done"]
    assert tree.registry.manifests["AtMost"].description == "Gives its child *ticks* ticks, then fails."


def test_a_decorator_decides_when_its_child_is_ticked(make_tree: TreeFactory, calls: CallLog) -> None:
    tree = make_tree('<AtMost ticks="2" used="{u}"><Act name="a" outcomes="RRR"/></AtMost>', AtMost)
    assert [tree.tick_once().name for _ in range(3)] == ["RUNNING", "RUNNING", "FAILURE"]
    assert calls == ["a:start", "a:running", "a:halted"]
    assert tree.blackboard["u"] == 2


def test_child_set_by_an_overridden_set_children_is_reset(make_tree: TreeFactory) -> None:
    class Taking(DecoratorNode):
        def set_children(self, children: list[TreeNode]) -> None:
            self.child = children[0]

        def tick(self) -> Status:
            return self.child.execute_tick()

    tree = make_tree("<Taking><AlwaysSuccess/></Taking>", Taking)
    assert tree.tick_exactly_once() is Status.SUCCESS
    assert tree.nodes[1].status is Status.IDLE


def test_user_nodes_may_use_the_explicit_form(make_tree: TreeFactory) -> None:
    tree = make_tree(
        '<Control ID="Shuffle" done="{d}"><Decorator ID="AtMost" ticks="1" used="{u}">'
        '<Action ID="Act" outcomes="S"/></Decorator></Control>',
        Shuffle,
        AtMost,
    )
    assert tree.tick_once() is Status.SUCCESS


def test_pre_and_post_conditions_apply_to_user_nodes(make_tree: TreeFactory, calls: CallLog) -> None:
    tree = make_tree(
        '<Shuffle name="x" done="{d}" _skipIf="n == 1" _post="n := 1"><Act name="a" outcomes="S"/></Shuffle>',
        Shuffle,
    )
    tree.blackboard["n"] = 0
    assert tree.tick_once() is Status.SUCCESS
    assert tree.tick_once() is Status.SKIPPED
    assert calls == ["a:start"]


def test_decorator_requires_one_child_and_control_node_at_least_one(make_tree: TreeFactory) -> None:
    with pytest.raises(TreeError, match="AtMost"):
        make_tree('<AtMost ticks="1"><AlwaysSuccess/><AlwaysSuccess/></AtMost>', AtMost)
    with pytest.raises(TreeError, match="Shuffle"):
        make_tree("<Shuffle/>", Shuffle)


def test_node_without_a_tick_raises_an_error_that_names_it(make_tree: TreeFactory) -> None:
    class Idler(ControlNode):
        pass

    with pytest.raises(NodeExecutionError, match=r"'Idler::1' <Idler>.*<Idler> has no tick\(\)"):
        make_tree("<Idler><AlwaysSuccess/></Idler>", Idler).tick_once()


def test_built_in_control_node_can_be_subclassed(make_tree: TreeFactory, calls: CallLog) -> None:
    class Polite(Sequence):
        """A Sequence that records its results."""

        greeting: In[str] = "hello"

        def tick(self) -> Status:
            status = super().tick()
            calls.record(self.greeting, status.name)
            return status

    tree = make_tree('<Polite><Act name="a" outcomes="S"/><Act name="b" outcomes="RS"/></Polite>', Polite)
    tree.tick_once()
    tree.tick_once()
    assert calls == ["a:start", "b:start", "hello:RUNNING", "b:running", "hello:SUCCESS"]


def test_built_in_decorator_can_be_subclassed(make_tree: TreeFactory) -> None:
    class Sometimes(Inverter):
        inverts: In[bool]

        def tick(self) -> Status:
            return super().tick() if self.inverts else self.child.execute_tick()

    tree = make_tree('<Sometimes inverts="{i}"><AlwaysSuccess/></Sometimes>', Sometimes)
    tree.blackboard["i"] = True
    assert tree.tick_once() is Status.FAILURE
    tree.blackboard["i"] = False
    assert tree.tick_once() is Status.SUCCESS


@pytest.mark.parametrize(
    ("base", "name"), [(ControlNode, "halt_child"), (DecoratorNode, "child"), (DecoratorNode, "reset_child")]
)
def test_port_that_hides_an_attribute_of_a_parent_node_is_refused(base: type[TreeNode], name: str) -> None:
    hiding = type("Hiding", (base,), {"__annotations__": {name: In[str]}})
    message = f"port '{name}' of Hiding would hide the attribute '{name}' of {base.__name__}"
    with pytest.raises(RegistrationError, match=message):
        Registry.standard().add(hiding)
