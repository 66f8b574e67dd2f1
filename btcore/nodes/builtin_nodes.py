"""Which built-in nodes there are, by ID, in each format."""

from typing import Final

from btcore.engine.node import TreeNode
from btcore.nodes import format3
from btcore.nodes.blackboard_actions import SetBlackboard, UnsetBlackboard
from btcore.nodes.branch import IfThenElse, WhileDoElse
from btcore.nodes.constant_results import AlwaysFailure, AlwaysSuccess
from btcore.nodes.entry_updates import SkipUnlessUpdated, WaitValueUpdate, WasEntryUpdated
from btcore.nodes.fallback import AsyncFallback, Fallback, ReactiveFallback
from btcore.nodes.loop import (
    LoopBool,
    LoopDouble,
    LoopInt,
    LoopString,
)
from btcore.nodes.manual_selector import ManualSelector
from btcore.nodes.parallel import Parallel, ParallelAll
from btcore.nodes.repeat import Repeat, RetryUntilSuccessful
from btcore.nodes.result_decorators import (
    ForceFailure,
    ForceSuccess,
    Inverter,
    KeepRunningUntilFailure,
    RunOnce,
)
from btcore.nodes.script_nodes import Precondition, Script, ScriptCondition
from btcore.nodes.sequence import (
    AsyncSequence,
    ReactiveSequence,
    Sequence,
    SequenceWithMemory,
)
from btcore.nodes.subtree import SubTree
from btcore.nodes.switch import (
    Switch2,
    Switch3,
    Switch4,
    Switch5,
    Switch6,
)
from btcore.nodes.timing import Delay, Sleep, Timeout
from btcore.nodes.try_catch import TryCatch

_Palette = dict[str, type[TreeNode]]


def _by_name(*nodes: type[TreeNode]) -> _Palette:
    return {node.__name__: node for node in nodes}


COMMON_NODES: Final[_Palette] = _by_name(
    AlwaysFailure, AlwaysSuccess, Fallback, ForceFailure, ForceSuccess, IfThenElse, Inverter,
    KeepRunningUntilFailure, ReactiveFallback, ReactiveSequence, Sequence, Timeout,
)  # fmt: skip

FORMAT_4_NODES: Final[_Palette] = _by_name(
    AsyncFallback, AsyncSequence, Delay, LoopBool, LoopDouble, LoopInt, LoopString, Parallel, ParallelAll,
    Precondition, Repeat, RetryUntilSuccessful, RunOnce, Script, ScriptCondition, SequenceWithMemory,
    SetBlackboard, SkipUnlessUpdated, Sleep, SubTree, Switch2, Switch3, Switch4, Switch5, Switch6, TryCatch,
    UnsetBlackboard, WaitValueUpdate, WasEntryUpdated, WhileDoElse,
)  # fmt: skip

FORMAT_3_NODES: Final[_Palette] = {
    "BlackboardCheckBool": format3.BlackboardCheckBool,
    "BlackboardCheckDouble": format3.BlackboardCheckDouble,
    "BlackboardCheckInt": format3.BlackboardCheckInt,
    "BlackboardCheckString": format3.BlackboardCheckString,
    "Delay": format3.Delay3,
    "ManualSelector": ManualSelector,
    "Parallel": format3.Parallel3,
    "Repeat": format3.Repeat3,
    "RetryUntilSuccessful": format3.RetryUntilSuccessful3,
    "SequenceStar": format3.SequenceStar,
    "SetBlackboard": format3.SetBlackboard3,
    "SubTree": format3.SubTree3,
    "SubTreePlus": format3.SubTreePlus,
    "Switch2": format3.Switch2v3,
    "Switch3": format3.Switch3v3,
    "Switch4": format3.Switch4v3,
    "Switch5": format3.Switch5v3,
    "Switch6": format3.Switch6v3,
    "WhileDoElse": format3.WhileDoElse3,
}
