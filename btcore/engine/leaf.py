"""The leaf classes that users subclass: conditions, synchronous actions and actions of several ticks."""

from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Final

from mypy_extensions import mypyc_attr

from btcore.blackboard.ports import Port
from btcore.engine.node import TreeNode
from btcore.engine.node_spec import NodeSpec
from btcore.errors import NodeError
from btcore.status import IDLE, NO_RESULT, RUNNING, NodeType, PossibleResults


@mypyc_attr(allow_interpreted_subclasses=True)
class LeafNode(TreeNode):
    """A node without children. A leaf may return True for SUCCESS and False for FAILURE."""

    spec: ClassVar[NodeSpec] = NodeSpec(node_type=NodeType.ACTION)

    @classmethod
    def possible_results(
        cls, children: list[PossibleResults], literals: Mapping[str, object]
    ) -> PossibleResults:
        """Return the results that the class declares, all in the first tick."""
        return PossibleResults(cls.spec.results)


@mypyc_attr(allow_interpreted_subclasses=True)
class Condition(LeafNode):
    """A leaf that checks the world: override `tick` to return True or False without side effects.

    Examples:
        >>> import btcore
        >>> class IsDark(btcore.Condition):
        ...     light: btcore.In[float]
        ...     def tick(self):
        ...         return self.light < 0.1
        >>> nodes = btcore.Registry.standard()
        >>> nodes.add(IsDark)
        >>> b = btcore.Builder(nodes)
        >>> b.build(b.IsDark(light=0.05)).tick_once()
        <Status.SUCCESS: 2>
    """

    spec: ClassVar[NodeSpec] = NodeSpec(node_type=NodeType.CONDITION)


@mypyc_attr(allow_interpreted_subclasses=True)
class SyncAction(LeafNode):
    """An action that completes within one tick: override `tick`, which must not return RUNNING.

    Examples:
        >>> import btcore
        >>> class Say(btcore.SyncAction):
        ...     text: btcore.In[str]
        ...     def tick(self):
        ...         print(self.text)
        ...         return btcore.SUCCESS
        >>> nodes = btcore.Registry.standard()
        >>> nodes.add(Say)
        >>> b = btcore.Builder(nodes)
        >>> b.build(b.Say(text="hello")).tick_once()
        hello
        <Status.SUCCESS: 2>
    """

    spec: ClassVar[NodeSpec] = NodeSpec(must_complete=True)


@mypyc_attr(allow_interpreted_subclasses=True)
class StatefulAction(LeafNode):
    """An action that may last several ticks.

    Override `on_start`, `on_running` (both return a Status, True or False) and, to clean
    up, `on_halted`. A tick must not block: start the work, return RUNNING, and check the work again
    in the next tick.

    Examples:
        >>> import btcore
        >>> class Drive(btcore.StatefulAction):
        ...     def on_start(self):
        ...         self.left = 2
        ...         return btcore.RUNNING
        ...     def on_running(self):
        ...         self.left -= 1
        ...         return btcore.RUNNING if self.left else btcore.SUCCESS
        ...     def on_halted(self):
        ...         print("stop")
        >>> nodes = btcore.Registry.standard()
        >>> nodes.add(Drive)
        >>> b = btcore.Builder(nodes)
        >>> tree = b.build(b.Drive())
        >>> [tree.tick_once().name for _ in range(3)]
        ['RUNNING', 'RUNNING', 'SUCCESS']
    """

    @classmethod
    def possible_results(
        cls, children: list[PossibleResults], literals: Mapping[str, object]
    ) -> PossibleResults:
        """Return the declared results, in the first tick only if the action may complete on start."""
        spec = cls.spec
        at_once = spec.results if spec.may_complete_on_start else NO_RESULT
        return PossibleResults(at_once, spec.results, True)

    def on_start(self) -> object:
        """Start the action. Called by a tick while the node is IDLE.

        Returns:
            A Status other than IDLE, or True (SUCCESS) or False (FAILURE).

        Raises:
            NodeError: The class does not override this method.
        """
        raise NodeError(f"<{self.config.id}> has no on_start()")

    def on_running(self) -> object:
        """Continue the action. Called by every tick while the node is RUNNING.

        Returns:
            A Status other than IDLE, or True (SUCCESS) or False (FAILURE).

        Raises:
            NodeError: The class does not override this method.
        """
        raise NodeError(f"<{self.config.id}> has no on_running()")

    def on_halted(self) -> None:
        """Clean up. Called when the node is halted while it is RUNNING."""

    def tick(self) -> object:
        """Start or continue the action. A completed node that was not reset returns its result again."""
        before = self._status
        if before is IDLE:
            return self.on_start()
        if before is RUNNING:
            return self.on_running()
        return before

    def halt(self) -> None:
        """Call `on_halted` if the node is RUNNING, then set the node to IDLE."""
        try:
            if self._status is RUNNING:
                self.on_halted()
        finally:
            self.reset_status()


# --- ports that are attributes of a leaf
#
# The attributes are properties with these functions, and not compiled descriptors, because mypyc drops the
# `__set__` of a descriptor class. The functions are here because this module is compiled; their class,
# `PortAttribute`, is in `signature.py`, which is not, because mypyc cannot compile a subclass of property.

PORT_PLACEHOLDER: Final = object()
"""The argument for a port in the `__init__` of a dataclass: assigning it to the port has no effect."""


def port_getter(port: Port) -> Callable[[Any], object]:
    """Return a function that reads *port* of a node, or raises AttributeError for an output."""
    name = port.name
    if not port.reads:

        def refuse(node: TreeNode) -> object:
            raise AttributeError(
                f"port [{name}] is an output: it can be assigned, but not read; to read and assign it, "
                "annotate it with InOut[…]"
            )

        return refuse

    def read(node: TreeNode) -> object:
        return node.config.input(name).read()

    return read


def port_setter(port: Port) -> Callable[[Any, object], None]:
    """Return a function that writes a value to *port* of a node, or raises AttributeError for an input."""
    name, writes = port.name, port.writes

    def write(node: TreeNode, value: object) -> None:
        if value is PORT_PLACEHOLDER:
            return
        if not writes:
            raise AttributeError(f"port [{name}] is an input: it can be read, but not assigned")
        node.config.output(name).write(value)

    return write
