"""Which built-in nodes there are, by ID, in each format."""

from typing import Final

from btcore.node import TreeNode
from btcore.nodes import legacy
from btcore.nodes.branch import IfThenElse, WhileDoElse
from btcore.nodes.data import SetBlackboard, UnsetBlackboard
from btcore.nodes.fallback import AsyncFallback, Fallback, ReactiveFallback
from btcore.nodes.fixed import AlwaysFailure, AlwaysSuccess
from btcore.nodes.loop import LoopBool, LoopDouble, LoopInt, LoopString
from btcore.nodes.manual import ManualSelector
from btcore.nodes.outcome import ForceFailure, ForceSuccess, Inverter, KeepRunningUntilFailure, RunOnce
from btcore.nodes.parallel import Parallel, ParallelAll
from btcore.nodes.repeat import Repeat, RetryUntilSuccessful
from btcore.nodes.scripted import Precondition, Script, ScriptCondition
from btcore.nodes.sequence import AsyncSequence, ReactiveSequence, Sequence, SequenceWithMemory
from btcore.nodes.subtree import SubTree
from btcore.nodes.switch import Switch2, Switch3, Switch4, Switch5, Switch6
from btcore.nodes.timing import Delay, Sleep, Timeout
from btcore.nodes.try_catch import TryCatch
from btcore.nodes.updated import SkipUnlessUpdated, WaitValueUpdate, WasEntryUpdated

_Palette = dict[str, type[TreeNode]]


def _by_name(*nodes: type[TreeNode]) -> _Palette:
    return {node.__name__: node for node in nodes}


EVERYWHERE: Final[_Palette] = _by_name(
    AlwaysFailure, AlwaysSuccess, Fallback, ForceFailure, ForceSuccess, IfThenElse, Inverter,
    KeepRunningUntilFailure, ReactiveFallback, ReactiveSequence, Sequence, Timeout,
)  # fmt: skip

FORMAT_4: Final[_Palette] = _by_name(
    AsyncFallback, AsyncSequence, Delay, LoopBool, LoopDouble, LoopInt, LoopString, Parallel, ParallelAll,
    Precondition, Repeat, RetryUntilSuccessful, RunOnce, Script, ScriptCondition, SequenceWithMemory,
    SetBlackboard, SkipUnlessUpdated, Sleep, SubTree, Switch2, Switch3, Switch4, Switch5, Switch6, TryCatch,
    UnsetBlackboard, WaitValueUpdate, WasEntryUpdated, WhileDoElse,
)  # fmt: skip

FORMAT_3: Final[_Palette] = {
    "BlackboardCheckBool": legacy.BlackboardCheckBool,
    "BlackboardCheckDouble": legacy.BlackboardCheckDouble,
    "BlackboardCheckInt": legacy.BlackboardCheckInt,
    "BlackboardCheckString": legacy.BlackboardCheckString,
    "Delay": legacy.Delay3,
    "ManualSelector": ManualSelector,
    "Parallel": legacy.Parallel3,
    "Repeat": legacy.Repeat3,
    "RetryUntilSuccessful": legacy.RetryUntilSuccessful3,
    "SequenceStar": legacy.SequenceStar,
    "SetBlackboard": legacy.SetBlackboard3,
    "SubTree": legacy.SubTree3,
    "SubTreePlus": legacy.SubTreePlus,
    "Switch2": legacy.Switch2v3,
    "Switch3": legacy.Switch3v3,
    "Switch4": legacy.Switch4v3,
    "Switch5": legacy.Switch5v3,
    "Switch6": legacy.Switch6v3,
    "WhileDoElse": legacy.WhileDoElse3,
}
