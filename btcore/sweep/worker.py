"""What a worker on this machine does first; Dask calls `dask_setup` in its process."""

import faulthandler
import os
import signal

from btcore.sweep.cluster import LOG_VARIABLE


def dask_setup(worker: object) -> None:
    """Leave Ctrl-C to the sweep, and let what is printed go to the sweep's log.

    That includes what C libraries print, and the last words of a process that crashes.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    log = os.environ.get(LOG_VARIABLE)
    if log:
        file = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o666)
        os.dup2(file, 1)
        os.dup2(file, 2)
        os.close(file)
        faulthandler.enable()
