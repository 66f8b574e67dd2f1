"""Recording and understanding runs: replay, statistics of the nodes, the first difference between two runs.

See docs/guides/recording.md.
"""

from btcore_recorder.divergence import Divergence, Step, find_divergence, steps
from btcore_recorder.file_recorder import FileRecorder, record
from btcore_recorder.replay import Difference, Replay
from btcore_recorder.saved_tests import assert_does_not_fail, assert_runs_as_recorded
from btcore_recorder.statistics import RecordedStatistics, recorded_statistics
from btcore_recorder.tree_observer import NodeStatistics, TreeObserver
from btcore_recorder.why import Answer, Explainer, Link

__all__ = [
    "Answer",
    "Difference",
    "Divergence",
    "Explainer",
    "FileRecorder",
    "Link",
    "NodeStatistics",
    "RecordedStatistics",
    "Replay",
    "Step",
    "TreeObserver",
    "assert_does_not_fail",
    "assert_runs_as_recorded",
    "find_divergence",
    "record",
    "recorded_statistics",
    "steps",
]
