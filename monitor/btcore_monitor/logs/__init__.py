"""Log files of BehaviorTree.CPP's SqliteLogger, and of version 3's FileLogger.

`btcore.logs` finds these formats by entry points. Nothing here imports a package of the monitor's extra.
"""

from btcore_monitor.logs.fbl import read_fbl
from btcore_monitor.logs.sqlite import Session, SqliteLog, read_sqlite, sessions

__all__ = ["Session", "SqliteLog", "read_fbl", "read_sqlite", "sessions"]
