"""Decorators that change their child's result."""

from collections.abc import Mapping
from typing import ClassVar

from mypy_extensions import mypyc_attr

from btcore.blackboard.ports import Port
from btcore.engine.control import DecoratorNode
from btcore.engine.node import execute_tick, reset_status
from btcore.errors import BlackboardError, ConversionError, NodeError
from btcore.status import (
    FAILURE,
    IDLE,
    RUNNING,
    SKIPPED,
    SUCCESS,
    PossibleResults,
    Status,
)
from btcore.values import BOOL


@mypyc_attr(allow_interpreted_subclasses=True)
class Inverter(DecoratorNode):
    """Turns SUCCESS into FAILURE and FAILURE into SUCCESS; RUNNING and SKIPPED pass."""

    builtin_formats: ClassVar[tuple[int, ...]] = (3, 4)
    node_symbol: ClassVar[str] = "¬"
    batch_class: ClassVar[str] = "btcore.batch.decorators:Inverter"

    @classmethod
    def possible_results(
        cls, children: list[PossibleResults], literals: Mapping[str, object]
    ) -> PossibleResults:
        """The child's, swapped."""
        return children[0].mapped({SUCCESS: FAILURE, FAILURE: SUCCESS})

    def tick(self) -> Status:
        """Tick the child, and swap its result."""
        self.set_status(RUNNING)
        status = execute_tick(self.child)
        if status is SUCCESS:
            reset_status(self.child)
            return FAILURE
        if status is FAILURE:
            reset_status(self.child)
            return SUCCESS
        return status


@mypyc_attr(allow_interpreted_subclasses=True)
class ForcedNode(DecoratorNode):
    """Gives *forced* when its child completes; RUNNING and SKIPPED pass."""

    builtin_formats: ClassVar[tuple[int, ...]] = ()
    forced: ClassVar[Status] = SUCCESS

    @classmethod
    def possible_results(
        cls, children: list[PossibleResults], literals: Mapping[str, object]
    ) -> PossibleResults:
        """The child's, with the forced result for those that complete."""
        return children[0].mapped({SUCCESS: cls.forced, FAILURE: cls.forced})

    def tick(self) -> Status:
        """Tick the child."""
        self.set_status(RUNNING)
        status = execute_tick(self.child)
        if status is SUCCESS or status is FAILURE:
            reset_status(self.child)
            return self.forced
        return status


@mypyc_attr(allow_interpreted_subclasses=True)
class ForceSuccess(ForcedNode):
    """Succeeds when its child completes, either way; RUNNING and SKIPPED pass."""

    builtin_formats: ClassVar[tuple[int, ...]] = (3, 4)
    node_symbol: ClassVar[str] = "⊤"
    may_return: ClassVar[frozenset[Status]] = frozenset({SUCCESS, SKIPPED})
    batch_class: ClassVar[str] = "btcore.batch.decorators:ForceSuccess"
    forced: ClassVar[Status] = SUCCESS


@mypyc_attr(allow_interpreted_subclasses=True)
class ForceFailure(ForcedNode):
    """Fails when its child completes, either way; RUNNING and SKIPPED pass."""

    builtin_formats: ClassVar[tuple[int, ...]] = (3, 4)
    node_symbol: ClassVar[str] = "⊥"
    may_return: ClassVar[frozenset[Status]] = frozenset({FAILURE, SKIPPED})
    batch_class: ClassVar[str] = "btcore.batch.decorators:ForceFailure"
    forced: ClassVar[Status] = FAILURE


@mypyc_attr(allow_interpreted_subclasses=True)
class KeepRunningUntilFailure(DecoratorNode):
    """Keeps RUNNING, and ticks its child anew after each SUCCESS; FAILURE when the child fails."""

    builtin_formats: ClassVar[tuple[int, ...]] = (3, 4)
    node_symbol: ClassVar[str] = "↺"
    may_return: ClassVar[frozenset[Status]] = frozenset({FAILURE})
    batch_class: ClassVar[str] = "btcore.batch.decorators:KeepRunningUntilFailure"

    @classmethod
    def possible_results(
        cls, children: list[PossibleResults], literals: Mapping[str, object]
    ) -> PossibleResults:
        """FAILURE, if the child can fail."""
        child = children[0]
        return PossibleResults(child.in_first_tick & cls.may_return, child.results & cls.may_return, True)

    def tick(self) -> Status:
        """Tick the child."""
        self.set_status(RUNNING)
        status = execute_tick(self.child)
        if status is FAILURE:
            reset_status(self.child)
            return FAILURE
        if status is SUCCESS:
            reset_status(self.child)
        return RUNNING


@mypyc_attr(allow_interpreted_subclasses=True)
class RunOnce(DecoratorNode):
    """Ticks its child until it completes once in the life of the tree.

    Later it is SKIPPED, or with `then_skip` false gives the same result again. A halt doesn't
    change what is remembered.
    """

    builtin_formats: ClassVar[tuple[int, ...]] = (4,)
    batch_class: ClassVar[str] = "btcore.batch.decorators:RunOnce"
    state_fields: ClassVar[tuple[str, ...] | None] = ("_result",)

    _result: Status = IDLE

    @classmethod
    def possible_results(
        cls, children: list[PossibleResults], literals: Mapping[str, object]
    ) -> PossibleResults:
        """The child's, or SKIPPED unless the result is repeated."""
        child = children[0]
        later = frozenset() if literals.get("then_skip") is False else frozenset({SKIPPED})
        return PossibleResults(child.results | later, child.after_running, child.may_run)

    @staticmethod
    def provided_ports() -> list[Port]:
        """The ports."""
        return [Port("then_skip", type=BOOL, default="true", description="skip later, or repeat the result")]

    def tick(self) -> Status:
        """Tick the child, or give what is remembered."""
        if self._result is not IDLE:
            return SKIPPED if self._skips() else self._result
        self.set_status(RUNNING)
        status = execute_tick(self.child)
        if status is SUCCESS or status is FAILURE:
            self._result = status
            self.reset_child()
        return status

    def _skips(self) -> bool:
        try:
            return self.get_input("then_skip") is not False
        except (NodeError, BlackboardError, ConversionError):
            return True
