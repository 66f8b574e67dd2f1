"""What something occupies."""

import gc
import tracemalloc
from collections.abc import Callable


def bytes_kept(make: Callable[[], object]) -> int:
    """What the thing that *make* returns occupies (bytes that Python allocated)."""
    gc.collect()
    tracemalloc.start()
    made = make()
    gc.collect()
    kept = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    del made
    return kept
