"""The symbols in the badges of nodes: a small drawing of each ID or type.

Drawings use the notation of font.py, within ±10 units around the origin; y points up.
"""

from typing import Final

from btcore_monitor.screen.font import Stroke, parse

_ARROW: Final = "0 -8.5,0 8.5,0 / 3,5.5 8.5,0 3,-5.5"
_ARROW_LOW: Final = "0 -8,-3 8,-3 / 3.4,1.6 8,-3 3.4,-7.6"
_QUESTION: Final = "0 0,4.2,4.4,4.8,165,-50 0,-1.2 0,-4 / 0,-9 0,-8.3"
_QUESTION_LOW: Final = "0 0,1.6,3.8,4,165,-50 0,-3 0,-4.8 / 0,-9.4 0,-8.8"
# A reactive node, which ticks all its children again, has a wave above its arrow; a node with memory, a dot.
_WAVE: Final = " / -3.6,7.4,3.6,2.2,180,0 3.6,7.4,3.6,2.2,180,360"
_MEMORY: Final = " / -1,7 1,7"
_PARALLEL: Final = "0 -8,4.5 8,4.5 / 4,8.5 8,4.5 4,0.5 / -8,-4.5 8,-4.5 / 4,-0.5 8,-4.5 4,-8.5"
_LOOP: Final = "0 0,0,7.4,7.4,70,380 / 3.2,4.2 7,2.4 9.4,6"
_RETRY: Final = "0 0,0,7.4,7.4,110,-200 / -3.2,4.2 -7,2.4 -9.4,6"
_CLOCK: Final = "0 0,0,8.4,8.4,90,450 / 0,5 0,0 3.8,-2.2"
_BRANCH: Final = "0 -8.5,0 -2,0 7,5.6 / -2,0 7,-5.6 / 3,7.6 7,5.6 6,1.6 / 6,-1.6 7,-5.6 3,-7.6"
_TREE: Final = "0 0,9 0,1 / -6.5,-7 -6.5,1 6.5,1 6.5,-7 / 0,1 0,-7"
_DIAMOND: Final = "0 0,8.4 8.4,0 0,-8.4 -8.4,0 0,8.4"
_PLAY: Final = "0 -4.6,7 7,0 -4.6,-7 -4.6,7"
_RING: Final = "0 0,0,7,7,0,360 / 0,0,2,2,0,360"
_TICK: Final = "0 -7.5,0 -2.2,-5.8 7.5,6"
_CROSS: Final = "0 -6,6 6,-6 / 6,6 -6,-6"
_NOT: Final = "0 0,9 0,-3 / 0,-8.7 0,-8"
_PEN: Final = "0 -7,-7 -6,-2.6 4,7.4 7.4,4 -2.6,-6 -7,-7"
_HAND: Final = "0 -3,9 -3,-6 1,-2.6 3.4,-8.6 / 1,-2.6 7,-2.2 -3,9"
_ONCE: Final = "0 -3.4,5 1.4,9 1.4,-9"
_RECOVER: Final = "0 0,0,7.4,7.4,110,-200 / -3.2,4.2 -7,2.4 -9.4,6 / 0,3.6 0,-0.6 / 0,-3.6 0,-3"
_PIPELINE: Final = "0 -8.5,3.6 3,3.6 / -8.5,-3.6 8.5,-3.6 / 4.4,0.4 8.5,-3.6 4.4,-7.6 / 0,6.6 3,3.6 0,0.6"
_ROUND: Final = "0 0,0,7.4,7.4,70,380 / 3.2,4.2 7,2.4 9.4,6 / -2.6,0 2.6,0 / 0.4,2.2 2.6,0 0.4,-2.2"
_UPDATED: Final = "0 0,9 8,0 0,-9 -8,0 0,9 / 0,3.6 0,-3.6 / -2.2,1.4 0,3.6 2.2,1.4"
_INFINITY: Final = "0 -4.6,0,4.6,4.6,0,360 / 4.6,0,4.6,4.6,180,540"

_IDS: Final[dict[str, tuple[str, ...]]] = {
    _ARROW: ("Sequence", "AsyncSequence"),
    _ARROW_LOW + _WAVE: ("ReactiveSequence",),
    _ARROW_LOW + _MEMORY: ("SequenceStar", "SequenceWithMemory", "NonblockingSequence"),
    _QUESTION: ("Fallback", "Selector", "AsyncFallback"),
    _QUESTION_LOW + _WAVE: ("ReactiveFallback",),
    _PARALLEL: ("Parallel", "ParallelAll"),
    _BRANCH: ("IfThenElse", "WhileDoElse", "TryCatch"),
    _HAND: ("ManualSelector",),
    _NOT: ("Inverter",),
    _TICK: ("ForceSuccess", "AlwaysSuccess"),
    _CROSS: ("ForceFailure", "AlwaysFailure"),
    _RECOVER: ("RecoveryNode",),
    _PIPELINE: ("PipelineSequence",),
    _ROUND: ("RoundRobin",),
    _CLOCK: ("RateController", "Wait", "Timeout", "Delay", "Sleep"),
    _ONCE: ("SingleTrigger", "RunOnce"),
    _UPDATED: ("GoalUpdated", "GlobalUpdatedGoal", "SkipUnlessUpdated", "WaitValueUpdate"),
    _LOOP: ("Repeat",),
    _INFINITY: ("KeepRunningUntilFailure",),
    # The misspelling is the ID in BehaviorTree.CPP 3.
    _RETRY: ("RetryUntilSuccessful", "RetryUntilSuccesful"),
    _DIAMOND: (
        "Precondition",
        "ScriptCondition",
        "BlackboardCheckInt",
        "BlackboardCheckDouble",
        "BlackboardCheckString",
        "BlackboardCheckBool",
    ),
    _PEN: ("Script", "SetBlackboard", "UnsetBlackboard"),
}
"""Registration IDs by drawing."""
_BY_ID: Final = {node_id: drawing for drawing, ids in _IDS.items() for node_id in ids}
_BY_PREFIX: Final = (("Switch", _BRANCH), ("Loop", _LOOP))
_BY_TYPE: Final[dict[str, str]] = {
    "action": _PLAY,
    "condition": _DIAMOND,
    "control": _BRANCH,
    "decorator": _RING,
    "subtree": _TREE,
}


def symbol_strokes(node_id: str, node_type: str) -> list[Stroke]:
    """Return the strokes for a registration ID; an unknown *node_id* is drawn by its *node_type*."""
    drawing = _BY_ID.get(node_id)
    if drawing is None:
        drawing = next((shape for prefix, shape in _BY_PREFIX if node_id.startswith(prefix)), None)
    if drawing is None:
        drawing = _BY_TYPE.get(node_type, _RING)
    return parse(drawing)[1]
