"""The setup of a worker process on this machine: Dask calls `dask_setup` in it."""

import faulthandler
import os
import signal

from btcore.sweep.cluster import LOG_VARIABLE


def dask_setup(worker: object) -> None:
    """Ignore Ctrl-C, which the main process handles, and redirect the worker's output to the sweep's log."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    log = os.environ.get(LOG_VARIABLE)
    if log:
        # The file descriptors are replaced, not sys.stdout: C libraries and faulthandler write to them too.
        file = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o666)
        os.dup2(file, 1)
        os.dup2(file, 2)
        os.close(file)
        faulthandler.enable()
