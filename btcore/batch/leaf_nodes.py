"""Leaves in a batch: what a function or a class returns becomes sets of agents."""

import reprlib
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from btcore.batch.agent_sets import Indices, Mask
from btcore.batch.context import BatchContext
from btcore.batch.leaf_declaration import LeafDeclaration, LeafParameter, NodeName, StatefulAction
from btcore.batch.node import NO_RESULTS, BatchNode, Results, merge_results
from btcore.batch.ports import BatchInput, BatchOutput
from btcore.blackboard.ports import UNSET
from btcore.clock import Clock
from btcore.engine.leaf import SyncAction
from btcore.engine.node import TreeNode
from btcore.errors import NodeError
from btcore.registry.manifest import fits
from btcore.status import Status

Connect = Callable[[BatchNode, str], Any]
"""The Reader (or for ``name=`` the BatchOutput) of a port of a node."""


class LeafNode(BatchNode):
    """A leaf of a batch."""

    def results(self, given: object, agents: int) -> Results:
        """What a leaf has returned for *agents*, as sets; who has no status fails."""
        crowd = self.context.agent_sets
        if isinstance(given, np.ndarray) and given.shape == (crowd.count,):
            if given.dtype == np.bool_:
                success = crowd.from_mask(given) & agents
                return success, agents ^ success, 0, 0
            if given.dtype.kind in "iu":
                return self._of_statuses(given, agents)
        elif given is True or given is False or isinstance(given, np.bool_):
            return (agents, 0, 0, 0) if given else (0, agents, 0, 0)
        elif isinstance(given, Status) and given is not Status.IDLE:
            at = (Status.SUCCESS, Status.FAILURE, Status.RUNNING, Status.SKIPPED).index(given)
            return tuple(agents if place == at else 0 for place in range(4))  # type: ignore[return-value]
        said = (
            f"an array of the type {given.dtype} and the shape {given.shape}"
            if isinstance(given, np.ndarray)
            else reprlib.repr(given)
        )
        wanted = f"bools or statuses (uint8), of shape ({crowd.count},), or one bool or Status for all"
        self.context.fail(
            self, agents, NodeError(f"a leaf of a batch returns an array of {wanted}, not {said}")
        )
        return NO_RESULTS

    def _of_statuses(self, given: Any, agents: int) -> Results:
        # RUNNING, SUCCESS, FAILURE and SKIPPED are 1, 2, 3 and 4: each bit is a set.
        of = self.context.agent_sets.from_mask
        low, high = of(given & 1) & agents, of(given & 2) & agents
        skipped = of(given & 4) & agents
        either = low | high
        wrong = agents ^ (either | skipped)
        if skipped:
            wrong |= skipped & either
        if np.bitwise_or.reduce(given) > 7 or np.bitwise_or.reduce(given) < 0:
            wrong |= of((given > 4) | (given < 0)) & agents
        if wrong:
            said = (
                "a tick ends RUNNING, SUCCESS, FAILURE or SKIPPED, which are 1 to 4, for everyone of the mask"
            )
            self.context.fail(self, wrong, NodeError(said))
            low, high, skipped = self.drop_failed(low), self.drop_failed(high), self.drop_failed(skipped)
        both = low & high
        return high ^ both, both, low ^ both, skipped


class FunctionNode(LeafNode):
    """A function as a leaf."""

    def __init__(
        self,
        plan: TreeNode,
        context: BatchContext,
        leaf: LeafDeclaration,
        connect: Connect,
        resources: Sequence[object],
    ) -> None:
        super().__init__(plan, context, [])
        assert leaf.function is not None
        self.function = leaf.function
        self.ends_at_once = issubclass(leaf.base_class, SyncAction)
        # Where the arguments go: what is always the same is there already.
        self._arguments: list[Any] = []
        self._keywords: list[str] = []
        self._readers: list[tuple[int, BatchInput]] = []
        self._writers: list[BatchOutput] = []
        self._masks: list[int] = []
        self._indices: list[int] = []
        for wish in sorted(leaf.parameters, key=lambda one: one.keyword):
            at = len(self._arguments)
            port = wish.port
            filler: Any = None
            if port is not None and port.reads and not port.writes:
                self._readers.append((at, connect(self, port.name)))
            elif port is not None:
                filler = connect(self, port.name + "=")
                self._writers.append(filler)
            elif wish.annotation == Mask:
                self._masks.append(at)
            elif wish.annotation == Indices:
                self._indices.append(at)
            else:
                filler = resource_of(wish, leaf.id, self.name, context, resources)
            self._arguments.append(filler)
            if wish.keyword:
                self._keywords.append(wish.name)

    def tick(self, agents: int) -> Results:
        """Call the function for those who have what its ports read."""
        context = self.context
        for _, reader in self._readers:
            agents = reader.available(agents)
            if not agents:
                return NO_RESULTS
        arguments = self._arguments.copy()
        for at, reader in self._readers:
            arguments[at] = reader.read(agents)
        if context.raised:
            agents = self.drop_failed(agents)
            if not agents:
                return NO_RESULTS
        for writer in self._writers:
            writer.agents = agents
        for at in self._masks:
            arguments[at] = context.agent_sets.mask(agents)
        for at in self._indices:
            arguments[at] = context.agent_sets.indices(agents)
        try:
            if self._keywords:
                first = len(arguments) - len(self._keywords)
                named = dict(zip(self._keywords, arguments[first:], strict=True))
                given = self.function(*arguments[:first], **named)
            else:
                given = self.function(*arguments)
        except Exception as fault:
            context.fail(self, agents, fault)
            return NO_RESULTS
        results = self.results(given, agents)
        if results[2] and self.ends_at_once:
            said = (
                "an action of a function ends within its tick, but it returned RUNNING; derive a class from "
            )
            context.fail(self, results[2], NodeError(said + "batch.StatefulAction for one that lasts"))
        return results


class StatefulNode(LeafNode):
    """An instance of a class as a leaf."""

    def __init__(
        self,
        plan: TreeNode,
        context: BatchContext,
        leaf: LeafDeclaration,
        connect: Connect,
        resources: Sequence[object],
    ) -> None:
        super().__init__(plan, context, [])
        assert leaf.cls is not None
        made: dict[str, Any] = {}
        for port in leaf.ports:
            if port.reads:
                made[port.name] = connect(self, port.name)
            if port.writes:
                made[port.name + "="] = connect(self, port.name + "=")
        self._ports = list(made.values())
        self.leaf: StatefulAction = leaf.cls.__new__(leaf.cls)
        self.leaf._port = made.__getitem__
        self.leaf.name = plan.config.name
        self.leaf.agents = context.agent_sets.count
        self.leaf.now = context.clock.now
        filled = {
            one.name: resource_of(one, leaf.id, self.name, context, resources) for one in leaf.parameters
        }
        type(self.leaf).__init__(self.leaf, **filled)

    def tick(self, agents: int) -> Results:
        """Start or go on; who has completed and was not reset keeps the result."""
        # Who is running now is not who is once some have started.
        going, stored = self.running & agents, self.not_idle(agents)
        results: Results = (self.success & agents, self.failure & agents, 0, 0)
        starting = agents ^ stored
        if starting:
            results = merge_results(results, self._call(self.leaf.on_start, starting))
        if going:
            results = merge_results(results, self._call(self.leaf.on_running, going))
        return results

    def _call(self, method: Callable[[Mask], object], agents: int) -> Results:
        for port in self._ports:
            port.agents = agents
        try:
            given = method(self.context.agent_sets.mask(agents))
        except Exception as fault:
            self.context.fail(self, agents, fault)
            return NO_RESULTS
        return self.results(given, agents)

    def halt(self, agents: int) -> None:
        """Tell those for whom it runs, and be IDLE."""
        running = self.running & agents
        if running:
            for port in self._ports:
                port.agents = running
            try:
                self.leaf.on_halted(self.context.agent_sets.mask(running))
            except Exception as fault:
                self.context.fail(self, running, fault, "being halted")
        self.reset(agents)


def resource_of(
    wish: LeafParameter, id: str, name: str, context: BatchContext, resources: Sequence[object]
) -> object:
    """What fills a parameter that is no port. Raises NodeError if nothing does."""
    if wish.annotation is Clock:
        return context.clock
    if wish.annotation is NodeName:
        return NodeName(name)
    for resource in resources:
        if fits(resource, wish.annotation):
            return resource
    if wish.default is not UNSET:
        return wish.default
    called = getattr(wish.annotation, "__name__", str(wish.annotation))
    raise NodeError(f"<{id}> wants a {called} (its parameter '{wish.name}'), and none was handed in")
