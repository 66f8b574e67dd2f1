"""Log files of BehaviorTree.CPP's SqliteLogger and MinitraceLogger, and of version 3's FileLogger.

`btcore.logs` finds these formats by entry points. Nothing here imports a package of the monitor's extra.
"""

from btcore_monitor.logs.fbl import read_fbl
from btcore_monitor.logs.sqlite import Session, SqliteLog, read_sqlite, sessions
from btcore_monitor.logs.trace import TraceLog

__all__ = ["Session", "SqliteLog", "TraceLog", "read_fbl", "read_sqlite", "sessions"]
