"""Logs of a running tree: log files of BehaviorTree.CPP's tools, and console output.

`with BtLog(tree, "run.btlog"): …` writes a log, `read_log("run.btlog")` reads it.
"""

from btcore.logs.btlog import BtLog, read_btlog
from btcore.logs.console import ConsoleLog
from btcore.logs.files import LogError
from btcore.logs.formats import open_log, read_log
from btcore.logs.log import Log
from btcore.logs.recording import Gap, LoggedTransition, RecordedNode, Recording

__all__ = [
    "BtLog", "ConsoleLog", "Gap", "Log", "LogError", "LoggedTransition", "RecordedNode",
    "Recording", "open_log", "read_btlog", "read_log",
]  # fmt: skip
