"""The symbols in the badges of nodes, in all pictures of trees.

A symbol is an SVG path around (0, 0), within a radius of 9 units in a badge with a radius of 11; y points
down. Paths have the commands `M`, `L` and `C` with absolute coordinates only, for renderers without SVG.
"""

from typing import Final

_CIRCLE: Final = (
    "M0-5.5C-3.1-5.5-5.5-3.1-5.5 0C-5.5 3.1-3.1 5.5 0 5.5C3.1 5.5 5.5 3.1 5.5 0C5.5-3.1 3.1-5.5 0-5.5"
)
_RING: Final = (
    "M8.6 0C8.6-4.7 4.7-8.6 0-8.6C-4.7-8.6-8.6-4.7-8.6 0C-8.6 4.7-4.7 8.6 0 8.6C4.7 8.6 8.6 4.7 8.6 0"
)
_CLOCKWISE: Final = (
    "M1.7-4.6C-.5-5.4-2.9-4.6-4.1-2.6C-5.3-.7-5.1 1.8-3.5 3.5C-1.8 5.1 .7 5.3 2.6 4.1"
    "C4.6 2.9 5.4 .5 4.6-1.7M2.1-2.8L4.6-1.6L6.2-4"
)
_COUNTER: Final = (
    "M-1.7-4.6C.5-5.4 2.9-4.6 4.1-2.6C5.3-.7 5.1 1.8 3.5 3.5C1.8 5.1-.7 5.3-2.6 4.1"
    "C-4.6 2.9-5.4 .5-4.6-1.7M-2.1-2.8L-4.6-1.6L-6.2-4"
)

# By the names of a symbol: characters that classes of nodes declare, IDs, and types of nodes.
_SYMBOLS: Final = {
    "→ Sequence AsyncSequence": "M-6 0L5 0M1-4.2L5.4 0L1 4.2",
    "SequenceStar SequenceWithMemory NonblockingSequence": "M-6 2L5 2M1-2.2L5.4 2L1 6.2M-.6-4.6L.6-4.6",
    "↻→ ReactiveSequence": f"{_RING}M-4.8 0L4 0M.8-3.4L4.3 0L.8 3.4",
    "? Fallback Selector AsyncFallback": "M-3.4-2.6C-3.4-7.4 4.2-6.8 3.5-2.6C3.1-.4 0-.6 0 2M0 5.4L0 5.6",
    "↻? ReactiveFallback": f"{_RING}M-2.7-2.1C-2.7-5.9 3.4-5.4 2.8-2.1C2.5-.3 0-.5 0 1.6M0 4.3L0 4.5",
    "⇉ Parallel ParallelAll": "M-6-3.2L4.4-3.2M1.8-5.8L4.8-3.2L1.8-.6M-6 3.2L4.4 3.2M1.8 .6L4.8 3.2L1.8 5.8",
    "⎇ control IfThenElse WhileDoElse": "M-5.6 0L-1.3 0L4.6-3.7M-1.3 0L4.6 3.7"
    "M2-5L4.6-3.7L4-1.1M4 1.1L4.6 3.7L2 5",
    "⋔ Switch2 Switch3 Switch4 Switch5 Switch6": "M-6 0L-1.5 0L4.5-4.6M-1.5 0L4.5 4.6M-1.5 0L5 0",
    "↩ TryCatch": "M-5.5-3.5L1-3.5C3.3-3.5 4.5-2.3 4.5 0C4.5 2.3 3.3 3.5 1 3.5L-4.5 3.5M-1.8 .8L-4.8 3.5"
    "L-1.8 6.2",
    "ManualSelector": "M-2-5.9L-2 4L.7 1.7L2.2 5.7M.7 1.7L4.6 1.5L-2-5.9",
    "¬ Inverter": "M-5-2L5-2L5 3.5",
    "⊤ ForceSuccess AlwaysSuccess": "M-4.8 .2L-1.4 3.6L4.8-3.6",
    "⊥ ForceFailure AlwaysFailure": "M-4-4L4 4M4-4L-4 4",
    "◷ RateController Wait Timeout Delay Sleep": f"{_CIRCLE}M0-2.8L0 0L2.2 1.6",
    "↺ Repeat LoopBool LoopInt LoopDouble LoopString": _CLOCKWISE,
    # The misspelling is the ID in BehaviorTree.CPP 3.
    "RetryUntilSuccessful RetryUntilSuccesful": _COUNTER,
    "KeepRunningUntilFailure": "M0 0C0-1.7-1.4-3-3-3C-4.7-3-6.1-1.7-6.1 0C-6.1 1.7-4.7 3-3 3C-1.4 3 0 1.7 0 0"
    "C0-1.7 1.4-3 3-3C4.7-3 6.1-1.7 6.1 0C6.1 1.7 4.7 3 3 3C1.4 3 0 1.7 0 0",
    "RecoveryNode": f"{_COUNTER}M0-2.4L0 .4M0 2L0 2.4",
    "RoundRobin": f"{_CLOCKWISE}M-1.7 0L1.7 0M.3-1.5L1.7 0L.3 1.5",
    "PipelineSequence": "M-5.6-2.4L2-2.4M-5.6 2.4L5.6 2.4M2.9-.3L5.6 2.4L2.9 5M0-4.4L2-2.4L0-.4",
    "SingleTrigger RunOnce": "M-2.2-3.3L.9-5.9L.9 5.9",
    "GoalUpdated GlobalUpdatedGoal SkipUnlessUpdated WaitValueUpdate": ""
    "M0-5.9L5.3 0L0 5.9L-5.3 0L0-5.9M0-2.4L0 2.4M-1.5-.9L0-2.4L1.5-.9",
    "condition Precondition BlackboardCheckInt BlackboardCheckDouble BlackboardCheckString "
    "BlackboardCheckBool": "M0-5.4L5.4 0L0 5.4L-5.4 0L0-5.4",
    "§ Script ScriptCondition": "M-2-5C-4.6-5-2.6 0-5 0C-2.6 0-4.6 5-2 5M2-5C4.6-5 2.6 0 5 0C2.6 0 4.6 5 2 5",
    "↓ SetBlackboard": "M0-5.5L0 1.6M-3.2-1.4L0 1.8L3.2-1.4M-5 5.2L5 5.2",
    "▣ subtree": "M0-5.4L0-.6M-4.4 5L-4.4-.6L4.4-.6L4.4 5M0-.6L0 5",
    "action": "M-3-4.6L4.8 0L-3 4.6L-3-4.6",
    "decorator": "M4.6 0C4.6-2.6 2.6-4.6 0-4.6C-2.6-4.6-4.6-2.6-4.6 0C-4.6 2.6-2.6 4.6 0 4.6"
    "C2.6 4.6 4.6 2.6 4.6 0M-.1 0L.1 0",
    "unknown": "M-2 0L-1.9 0M2 0L2.1 0",
}
_PATHS: Final = {name: path for names, path in _SYMBOLS.items() for name in names.split()}


def symbol_path(id: str, node_type: str, declared: str = "") -> str:
    """Return the symbol of a node as an SVG path.

    Args:
        id: The ID of the node.
        node_type: The node type in lower case, whose symbol is used by default.
        declared: The symbol that the node's class declares, or "".
    """
    names = (id, declared, declared[-1:], node_type, "unknown")
    return next(path for name in names if (path := _PATHS.get(name)) is not None)
