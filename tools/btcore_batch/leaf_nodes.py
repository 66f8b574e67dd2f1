"""The leaf nodes of a batch, which call a function or the methods of a class."""

import reprlib
from collections.abc import Callable
from typing import Any

import numpy as np

from btcore.blackboard.ports import UNSET
from btcore.clock import Clock
from btcore.engine.leaf import SyncAction
from btcore.engine.node import TreeNode
from btcore.engine.signature import Parameter
from btcore.errors import NodeError
from btcore.registry.resources import Resources
from btcore.status import Status
from btcore_batch.agent_sets import AgentSet, Indices, Mask
from btcore_batch.context import BatchContext
from btcore_batch.leaf_declaration import LeafDeclaration, NodeName
from btcore_batch.node import NO_RESULTS, BatchNode, Results, merge_results, unsupported
from btcore_batch.ports import BatchInput, BatchOutput


class LeafNode(BatchNode):
    """The base class of leaves.

    Args:
        node: The ordinary leaf that represents the node.
        context: The shared state of the batch.
    """

    def __init__(self, node: TreeNode, context: BatchContext, leaf: LeafDeclaration) -> None:
        super().__init__(node, context, [])
        self.leaf = leaf

    def resource(self, parameter: Parameter) -> object:
        """Return the value of a parameter that is not a port.

        Raises:
            TreeError: No resource has the parameter's type, and the parameter has no default; or several
                resources of one class have it.
        """
        if parameter.resource_type is Clock:
            return self.context.clock
        if parameter.resource_type is NodeName:
            return NodeName(self.name)
        use = f"the parameter '{parameter.name}' of <{self.leaf.id}>"
        try:
            resource = Resources(self.context.resources).first_of(parameter.resource_type, use)
        except NodeError as error:
            raise unsupported(self.config, str(error)) from None
        if resource is not UNSET:
            return resource
        if parameter.default is not UNSET:
            return parameter.default
        message = (
            f"<{self.leaf.id}> needs a resource of type {parameter.type_name} for its parameter "
            f"'{parameter.name}'"
        )
        raise unsupported(self.config, message, "pass it to BatchTree.load(…, resources=[…])")

    def results(self, returned: object, agents: AgentSet) -> Results:
        """Convert the value *returned* by a leaf for *agents*; record an error for invalid results."""
        agent_sets = self.context.agent_sets
        if isinstance(returned, np.ndarray) and returned.shape == (agent_sets.count,):
            if returned.dtype == np.bool_:
                success = agent_sets.from_mask(returned) & agents
                return success, agents ^ success, 0, 0
            if returned.dtype.kind in "iu":
                return self._results_from_statuses(returned, agents)
        elif returned is True or returned is False or isinstance(returned, np.bool_):
            return (agents, 0, 0, 0) if returned else (0, agents, 0, 0)
        elif isinstance(returned, Status) and returned is not Status.IDLE:
            sets = dict.fromkeys(Status, 0) | {returned: agents}
            return sets[Status.SUCCESS], sets[Status.FAILURE], sets[Status.RUNNING], sets[Status.SKIPPED]
        if isinstance(returned, np.ndarray):
            shown = f"an array of the type {returned.dtype} and the shape {returned.shape}"
        else:
            shown = reprlib.repr(returned)
        message = (
            "a leaf of a batch must return an array of bools or statuses (uint8), of shape "
            f"({agent_sets.count},), or a single bool or Status for all agents, not {shown}"
        )
        self.context.fail(self, agents, NodeError(message))
        return NO_RESULTS

    def _results_from_statuses(self, returned: Any, agents: AgentSet) -> Results:
        # RUNNING, SUCCESS, FAILURE and SKIPPED are 1, 2, 3 and 4: each of the three bits is a set of agents.
        from_mask = self.context.agent_sets.from_mask
        low, high = from_mask(returned & 1) & agents, from_mask(returned & 2) & agents
        skipped = from_mask(returned & 4) & agents
        either = low | high
        wrong = agents ^ (either | skipped)
        if skipped:
            wrong |= skipped & either
        # The reduction is faster than a comparison of each element.
        if np.bitwise_or.reduce(returned) > 7 or np.bitwise_or.reduce(returned) < 0:
            wrong |= from_mask((returned > 4) | (returned < 0)) & agents
        if wrong:
            message = "each ticked agent needs a status: 1 (RUNNING), 2 (SUCCESS), 3 (FAILURE) or 4 (SKIPPED)"
            self.context.fail(self, wrong, NodeError(message))
            low, high, skipped = self.drop_failed(low), self.drop_failed(high), self.drop_failed(skipped)
        both = low & high
        return high ^ both, both, low ^ both, skipped


class FunctionNode(LeafNode):
    """A leaf that calls a function."""

    def __init__(self, node: TreeNode, context: BatchContext, leaf: LeafDeclaration) -> None:
        super().__init__(node, context, leaf)
        self.function: Callable[..., Any] = leaf.implementation
        self.is_synchronous = issubclass(leaf.base_class, SyncAction)
        # The arguments, keyword arguments last. The values of inputs and masks are filled in by each tick.
        self._arguments: list[Any] = []
        self._keywords: list[str] = []
        self._inputs: list[tuple[int, BatchInput]] = []
        self._outputs: list[BatchOutput] = []
        self._masks: list[int] = []
        self._indices: list[int] = []
        for index, parameter in enumerate(sorted(leaf.parameters, key=lambda parameter: parameter.keyword)):
            port = parameter.port
            argument: Any = None
            if port is not None and port.reads and not port.writes:
                self._inputs.append((index, BatchInput(self, port.name, port)))
            elif port is not None:
                argument = BatchOutput(self, port.name)
                self._outputs.append(argument)
            elif parameter.resource_type == Mask:
                self._masks.append(index)
            elif parameter.resource_type == Indices:
                self._indices.append(index)
            else:
                argument = self.resource(parameter)
            self._arguments.append(argument)
            if parameter.keyword:
                self._keywords.append(parameter.name)

    def tick(self, agents: AgentSet) -> Results:
        """Call the function for the agents that have values in all inputs."""
        context = self.context
        # All inputs are checked before any is read, because read() requires that all agents have a value.
        for _, port in self._inputs:
            agents = port.available(agents)
            if not agents:
                return NO_RESULTS
        arguments = self._arguments.copy()
        for index, port in self._inputs:
            arguments[index] = port.read(agents)
        if context.raised:
            agents = self.drop_failed(agents)
            if not agents:
                return NO_RESULTS
        for output in self._outputs:
            output.agents = agents
        for index in self._masks:
            arguments[index] = context.agent_sets.mask(agents)
        for index in self._indices:
            arguments[index] = context.agent_sets.indices(agents)
        try:
            if self._keywords:
                first = len(arguments) - len(self._keywords)
                keywords = dict(zip(self._keywords, arguments[first:], strict=True))
                returned = self.function(*arguments[:first], **keywords)
            else:
                returned = self.function(*arguments)
        except Exception as error:
            context.fail(self, agents, error)
            return NO_RESULTS
        results = self.results(returned, agents)
        if results[2] and self.is_synchronous:
            message = (
                "a function must complete within its tick, but it returned RUNNING; for an action of several "
                "ticks derive a class from batch.StatefulAction"
            )
            context.fail(self, results[2], NodeError(message))
        return results


class StatefulNode(LeafNode):
    """A leaf that calls the methods of an instance of a class."""

    def __init__(self, node: TreeNode, context: BatchContext, leaf: LeafDeclaration) -> None:
        super().__init__(node, context, leaf)
        # Outputs have "=" after their name, because an InOut port is an input and an output.
        ports: dict[str, Any] = {
            port.name: BatchInput(self, port.name, port) for port in leaf.ports if port.reads
        }
        ports |= {port.name + "=": BatchOutput(self, port.name) for port in leaf.ports if port.writes}
        self._ports = list(ports.values())
        cls: Any = leaf.implementation
        self.instance = cls.__new__(cls)
        # The attributes are set before __init__, which may use them.
        self.instance._port = ports.__getitem__
        self.instance.name = node.config.name
        self.instance.agents = context.agent_sets.count
        self.instance.now = context.clock.now
        self.instance.__init__(**{parameter.name: self.resource(parameter) for parameter in leaf.parameters})

    def tick(self, agents: AgentSet) -> Results:
        """Call `on_start` or `on_running`; agents that have completed keep their result until a reset."""
        # on_start() changes self.running, so the sets are computed before it is called.
        going, stored = self.running & agents, self.not_idle(agents)
        results: Results = (self.success & agents, self.failure & agents, 0, 0)
        starting = agents ^ stored
        if starting:
            returned = self._call(self.instance.on_start, starting)
            results = merge_results(results, self.results(returned, starting))
        if going:
            returned = self._call(self.instance.on_running, going)
            results = merge_results(results, self.results(returned, going))
        return results

    def _call(self, method: Callable[[Mask], object], agents: AgentSet, doing: str = "ticking") -> object:
        """Return the result of *method*. It is None if *method* raised; `results` adds no second error."""
        for port in self._ports:
            port.agents = agents
        try:
            return method(self.context.agent_sets.mask(agents))
        except Exception as error:
            self.context.fail(self, agents, error, doing)
            return None

    def halt(self, agents: AgentSet) -> None:
        """Call `on_halted` for the agents for which the node is RUNNING, and store IDLE."""
        running = self.running & agents
        if running:
            self._call(self.instance.on_halted, running, "being halted")
        self.reset(agents)
