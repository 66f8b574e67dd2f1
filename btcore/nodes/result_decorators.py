"""Decorators that change their child's result."""

from collections.abc import Mapping
from typing import ClassVar

from mypy_extensions import mypyc_attr

from btcore.blackboard.ports import Port
from btcore.engine.control import DecoratorNode
from btcore.engine.node import execute_tick, input_or, reset_status, set_status
from btcore.engine.node_spec import NodeSpec
from btcore.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, PossibleResults, Status
from btcore.values import BOOL


@mypyc_attr(allow_interpreted_subclasses=True)
class Inverter(DecoratorNode):
    """Ticks its child, and returns FAILURE for SUCCESS and SUCCESS for FAILURE.

    RUNNING and SKIPPED are returned unchanged.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(symbol="¬", never_pauses=True, formats=(3, 4))

    @classmethod
    def possible_results(
        cls, children: list[PossibleResults], literals: Mapping[str, object]
    ) -> PossibleResults:
        """Return the child's results, with SUCCESS and FAILURE swapped."""
        return children[0].replace_results({SUCCESS: FAILURE, FAILURE: SUCCESS})

    def tick(self) -> Status:
        """Tick the child, and return the opposite result."""
        set_status(self, RUNNING)
        status = execute_tick(self.child)
        if status is SUCCESS or status is FAILURE:
            reset_status(self.child)
            return FAILURE if status is SUCCESS else SUCCESS
        return status


@mypyc_attr(allow_interpreted_subclasses=True)
class ForcedNode(DecoratorNode):
    """Ticks its child, and returns *forced* when the child completes."""

    spec: ClassVar[NodeSpec] = NodeSpec(never_pauses=True)
    forced: ClassVar[Status] = SUCCESS

    @classmethod
    def possible_results(
        cls, children: list[PossibleResults], literals: Mapping[str, object]
    ) -> PossibleResults:
        """Return the child's results, with *forced* for SUCCESS and FAILURE."""
        return children[0].replace_results({SUCCESS: cls.forced, FAILURE: cls.forced})

    def tick(self) -> Status:
        """Tick the child."""
        set_status(self, RUNNING)
        status = execute_tick(self.child)
        if status is SUCCESS or status is FAILURE:
            reset_status(self.child)
            return self.forced
        return status


@mypyc_attr(allow_interpreted_subclasses=True)
class ForceSuccess(ForcedNode):
    """Ticks its child, and returns SUCCESS when the child succeeds or fails.

    RUNNING and SKIPPED are returned unchanged.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(symbol="⊤", results=frozenset({SUCCESS, SKIPPED}), formats=(3, 4))
    forced: ClassVar[Status] = SUCCESS


@mypyc_attr(allow_interpreted_subclasses=True)
class ForceFailure(ForcedNode):
    """Ticks its child, and returns FAILURE when the child succeeds or fails.

    RUNNING and SKIPPED are returned unchanged.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(symbol="⊥", results=frozenset({FAILURE, SKIPPED}), formats=(3, 4))
    forced: ClassVar[Status] = FAILURE


@mypyc_attr(allow_interpreted_subclasses=True)
class KeepRunningUntilFailure(DecoratorNode):
    """Ticks its child in every tick until it fails, and then fails; RUNNING until then.

    A child that succeeds is started again by the next tick. A skipped child also makes the node RUNNING, as
    in BehaviorTree.CPP.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(
        symbol="↺", results=frozenset({FAILURE}), is_endless=True, formats=(3, 4)
    )

    @classmethod
    def possible_results(
        cls, children: list[PossibleResults], literals: Mapping[str, object]
    ) -> PossibleResults:
        """Return FAILURE if the child can fail, else no result; RUNNING is always possible."""
        child = children[0]
        return PossibleResults(child.in_first_tick & cls.spec.results, child.results & cls.spec.results, True)

    def tick(self) -> Status:
        """Tick the child."""
        set_status(self, RUNNING)
        status = execute_tick(self.child)
        if status is SUCCESS or status is FAILURE:
            reset_status(self.child)
        return FAILURE if status is FAILURE else RUNNING


@mypyc_attr(allow_interpreted_subclasses=True)
class RunOnce(DecoratorNode):
    """Ticks its child until it completes for the first time, and returns its result.

    SKIPPED is returned unchanged, and the next tick ticks the child again. After the child has completed, it
    is not ticked: the node returns SKIPPED, or the first result again if `then_skip` is false. A halt does
    not reset this: the child completes at most once in the life of the tree.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(state_fields=("_result",), never_pauses=True, formats=(4,))

    _result: Status = IDLE  # the first result; IDLE = none yet

    @classmethod
    def possible_results(
        cls, children: list[PossibleResults], literals: Mapping[str, object]
    ) -> PossibleResults:
        """Return the child's results, and SKIPPED unless `then_skip` is false."""
        child = children[0]
        later = frozenset() if literals.get("then_skip") is False else frozenset({SKIPPED})
        return PossibleResults(child.results | later, child.after_running, child.may_run)

    @staticmethod
    def provided_ports() -> list[Port]:
        """Return the ports."""
        about = "later ticks: true = SKIPPED, false = the first result"
        return [Port("then_skip", type=BOOL, default="true", description=about)]

    def tick(self) -> Status:
        """Tick the child, unless it has completed before."""
        if self._result is not IDLE:
            # The port is read again, so that an entry may change the result; an unreadable port means true.
            return self._result if input_or(self, "then_skip", True) is False else SKIPPED
        set_status(self, RUNNING)
        status = execute_tick(self.child)
        if status is SUCCESS or status is FAILURE:
            self._result = status
            reset_status(self.child)
        return status
