"""Understanding runs: statistics of the nodes, and the first difference between two runs.

See docs/guides/recording.md.
"""

from btcore_recorder.divergence import Divergence, Step, find_divergence, steps
from btcore_recorder.statistics import RecordedStatistics, recorded_statistics
from btcore_recorder.tree_observer import NodeStatistics, TreeObserver

__all__ = [
    "Divergence",
    "NodeStatistics",
    "RecordedStatistics",
    "Step",
    "TreeObserver",
    "find_divergence",
    "recorded_statistics",
    "steps",
]
