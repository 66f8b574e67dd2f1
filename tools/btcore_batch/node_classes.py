"""The nodes that a batch can run, and the classes that run them."""

from typing import Final

from btcore.engine.node import TreeNode
from btcore.nodes.builtin_nodes import BUILTIN_NODES
from btcore_batch import branch, decorators, parallel, script_nodes, sequences, timing
from btcore_batch.node import BatchNode

_BY_ID: Final[dict[str, type[BatchNode]]] = {
    "AlwaysFailure": script_nodes.AlwaysFailure,
    "AlwaysSuccess": script_nodes.AlwaysSuccess,
    "AsyncFallback": sequences.AsyncFallback,
    "AsyncSequence": sequences.AsyncSequence,
    "Delay": timing.Delay,
    "Fallback": sequences.Fallback,
    "ForceFailure": decorators.ForceFailure,
    "ForceSuccess": decorators.ForceSuccess,
    "IfThenElse": branch.IfThenElse,
    "Inverter": decorators.Inverter,
    "KeepRunningUntilFailure": decorators.KeepRunningUntilFailure,
    "Parallel": parallel.Parallel,
    "ParallelAll": parallel.ParallelAll,
    "Precondition": script_nodes.Precondition,
    "ReactiveFallback": sequences.ReactiveFallback,
    "ReactiveSequence": sequences.ReactiveSequence,
    "Repeat": decorators.Repeat,
    "RetryUntilSuccessful": decorators.RetryUntilSuccessful,
    "RunOnce": decorators.RunOnce,
    "Script": script_nodes.Script,
    "ScriptCondition": script_nodes.ScriptCondition,
    "Sequence": sequences.Sequence,
    "SequenceWithMemory": sequences.SequenceWithMemory,
    "SetBlackboard": script_nodes.SetBlackboard,
    "Sleep": timing.Sleep,
    "SubTree": decorators.SubTree,
    "Switch2": branch.Switch,
    "Switch3": branch.Switch,
    "Switch4": branch.Switch,
    "Switch5": branch.Switch,
    "Switch6": branch.Switch,
    "Timeout": timing.Timeout,
    "TryCatch": sequences.TryCatch,
    "WhileDoElse": branch.WhileDoElse,
}

BATCH_CLASSES: Final[dict[type[TreeNode], type[BatchNode]]] = {
    BUILTIN_NODES[4][id]: cls for id, cls in _BY_ID.items()
}
"""The classes of the batch engine, by the classes of the nodes that they replace.

Subclasses are not listed: a subclass may behave differently from its base class.
"""
