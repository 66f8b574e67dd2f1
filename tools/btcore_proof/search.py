"""The search for all states of a tree, by one process or several, until a fixpoint or a bound."""

import math
import pickle
from collections.abc import Callable
from itertools import islice
from typing import Annotated, Final

from btcore.options import Options, option
from btcore_proof.exploration import Explorer
from btcore_proof.search_processes import CAN_FORK, STATES_AT_A_TIME, SearchProcesses, memory_used
from btcore_proof.state_graph import StateGraph

MEMORY_MB: Final = 4000
"""The default limit of the memory of a search (MB)."""
_FEW_STATES: Final = 500
"""The number of states up to which one process is enough."""
_CHECK_INTERVAL: Final = 64
"""The number of states after which the memory is checked, and the progress is shown."""


class SearchLimits(Options):
    """When a search ends, and how many processes it uses."""

    ticks: (
        Annotated[int, option("Search runs of at most N ticks. Default: no limit.", metavar="N", ge=1)] | None
    ) = None
    time_s: (
        Annotated[
            float,
            option(
                "End the search after S seconds, with the answers so far. Default: no limit.",
                metavar="S",
                gt=0,
                name="time",
            ),
        ]
        | None
    ) = None
    memory: Annotated[
        int,
        option(
            "End the search when its processes have used this much memory; without effect on Windows.",
            metavar="MB",
            ge=100,
        ),
    ] = MEMORY_MB
    jobs: (
        Annotated[
            int,
            option(
                "Number of processes of a long search, on Linux.  "
                "[default: one per core, but 1 on two cores]",
                metavar="N",
                ge=1,
            ),
        ]
        | None
    ) = None
    states: (
        Annotated[
            int,
            option(
                "End the search when it has found more than N states. Default: no limit.", metavar="N", ge=1
            ),
        ]
        | None
    ) = None


def search(
    explorer: Explorer, limits: SearchLimits, progress: Callable[[StateGraph], object] | None = None
) -> None:
    """Search until every state is known, or a bound is reached. The result is in the graph of the explorer.

    Args:
        explorer: The search, with its initial states.
        limits: The limits. The states that are found do not depend on the number of processes.
        progress: Called from time to time.
    """
    if limits.time_s is not None:
        explorer.limit_time(limits.time_s)
    graph, waiting = explorer.graph, explorer.waiting
    processes: SearchProcesses | None = None
    next_check = 0
    jobs = limits.jobs or 1 if CAN_FORK else 1
    most_ticks = math.inf if limits.ticks is None else limits.ticks
    try:
        while waiting and not explorer.is_out_of_time():
            if graph.depths[waiting[0]] >= most_ticks:
                graph.bounds.setdefault(f"runs of more than {most_ticks} ticks were not searched", None)
                break
            if graph.expanded >= next_check:
                next_check = graph.expanded + _CHECK_INTERVAL
                used = memory_used() + (processes.memory if processes is not None else 0)
                if used > limits.memory << 20:
                    graph.bounds.setdefault(f"the memory limit of {limits.memory} MB was reached", None)
                    break
                if limits.states is not None and graph.states > limits.states:
                    graph.bounds.setdefault(f"more than {limits.states:,} states were found", None)
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
                numbers = [number for number in next_states if graph.depths[number] < most_ticks]
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
