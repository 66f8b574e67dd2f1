"""Logs of a running tree: log files of BehaviorTree.CPP's tools, console output and statistics.

`with BtLog(tree, "run.btlog"): …` writes a log, `read_log("run.btlog")` reads it.
"""

from btcore.logs.btlog import BtLog, read_btlog
from btcore.logs.console import ConsoleLog
from btcore.logs.files import LogError
from btcore.logs.formats import open_log, read_log
from btcore.logs.log import Log
from btcore.logs.recording import Gap, LoggedTransition, RecordedNode, Recording
from btcore.logs.statistics import NodeStatistics, TreeObserver

__all__ = [
    "BtLog", "ConsoleLog", "Gap", "Log", "LogError", "LoggedTransition", "NodeStatistics", "RecordedNode",
    "Recording", "TreeObserver", "open_log", "read_btlog", "read_log",
]  # fmt: skip
