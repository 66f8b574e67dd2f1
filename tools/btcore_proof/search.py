"""The search for all states of a tree, by one process or several, until a fixpoint or a bound."""

import math
import pickle
from collections.abc import Callable
from itertools import islice
from typing import Final

from btcore_proof.exploration import Explorer
from btcore_proof.search_processes import CAN_FORK, STATES_AT_A_TIME, SearchProcesses, memory_used
from btcore_proof.state_graph import StateGraph

_FEW_STATES: Final = 500
"""The number of states up to which one process is enough."""
_CHECK_INTERVAL: Final = 64
"""The number of states after which the memory is checked, and the progress is shown."""


def search(
    explorer: Explorer,
    most_ticks: int | None = None,
    memory: int | None = None,
    progress: Callable[[StateGraph], object] | None = None,
    jobs: int = 1,
    seconds: float | None = None,
) -> None:
    """Search until every state is known, or a bound is reached. The result is in the graph of the explorer.

    Args:
        explorer: The search, with its initial states.
        most_ticks: The greatest number of ticks of a run; None = no limit.
        memory: The memory (bytes) that the processes may use; None = no limit.
        progress: Called from time to time.
        jobs: The number of processes. The states that are found do not depend on it.
        seconds: The time (s, real time) after which the search ends; None = no limit.
    """
    if seconds is not None:
        explorer.limit_time(seconds)
    graph, waiting = explorer.graph, explorer.waiting
    processes: SearchProcesses | None = None
    next_check = 0
    if not CAN_FORK:
        jobs = 1
    try:
        while waiting and not explorer.is_out_of_time():
            if most_ticks is not None and graph.depths[waiting[0]] >= most_ticks:
                graph.bounds.setdefault(f"runs of more than {most_ticks} ticks were not searched", None)
                break
            if graph.expanded >= next_check:
                next_check = graph.expanded + _CHECK_INTERVAL
                used = memory_used() + (processes.memory if processes is not None else 0)
                if memory is not None and used > memory:
                    graph.bounds.setdefault(f"the memory limit of {memory >> 20} MB was reached", None)
                    break
                if progress is not None:
                    progress(graph)
            if jobs > 1 and processes is None and graph.expanded >= _FEW_STATES:
                processes = SearchProcesses(explorer, jobs)
            numbers = [waiting[0]]
            if processes is None:
                explorer.expand(waiting[0])
            else:
                next_states = islice(waiting, jobs * STATES_AT_A_TIME)
                numbers = [
                    number for number in next_states if graph.depths[number] < (most_ticks or math.inf)
                ]
                try:
                    processes.expand(numbers)
                except pickle.PicklingError:
                    # Other processes do not recognise the states of this tree.
                    processes.close()
                    processes, jobs = None, 1
                    continue
            for _ in numbers:
                waiting.popleft()
            graph.expanded += len(numbers)
    except KeyboardInterrupt:
        graph.bounds.setdefault("the search was interrupted", None)
    except (EOFError, ConnectionError):
        graph.bounds.setdefault("a process of the search has ended, perhaps for lack of memory", None)
    finally:
        if processes is not None:
            processes.close()
