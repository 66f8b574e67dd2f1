"""The time and the memory of loading trees."""

import gc
import time
import tracemalloc

from measure.paired_timing import Work


def loading_time(load: Work) -> int:
    """Return the processor time (ns) of *load* and of the first garbage collection of its result.

    The collection is included because loading postpones it.
    """
    gc.collect()
    start = time.process_time_ns()
    loaded = load()
    gc.collect(0)
    taken = time.process_time_ns() - start
    del loaded
    return taken


def allocated_bytes(load: Work) -> int:
    """Return the memory (bytes allocated by Python) of the object that *load* returns."""
    gc.collect()
    tracemalloc.start()
    loaded = load()
    gc.collect()
    kept = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    del loaded
    return kept
