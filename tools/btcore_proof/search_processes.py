"""A search by several processes: each runs the ticks from some of the states, and one has the graph.

The processes are forks, which have the same tree. A part of a state is sent to the process with the graph
once; after that, its number stands for it.
"""

import multiprocessing
import pickle
import signal
import sys
from collections.abc import Hashable, Sequence
from dataclasses import replace
from enum import Enum
from io import BytesIO
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from types import FunctionType
from typing import Any, Final, NamedTuple

from btcore.engine.node import start_tick_counts
from btcore.values.types import ValueType
from btcore_proof.exploration import Explorer
from btcore_proof.model_leaves import UnknownValue
from btcore_proof.state_graph import Edge, StateTable, Step, TickMoment, Violation
from btcore_proof.tree_state import Identity

CAN_FORK: Final = sys.platform == "linux"
"""Whether a search can be made by several processes."""
STATES_AT_A_TIME: Final = 16
"""The number of states that a process gets at a time."""
_Counts = list[tuple[int, int, int, int]]


class _Keys(NamedTuple):
    """Keys of states, in the numbers of the sender, and the parts that it has not sent before."""

    keys: list[tuple[int, ...]]
    parts: list[tuple[int, Hashable]]


class _Vertex(NamedTuple):
    """A vertex that a process has found: its moment if it is a decision, and how it was found."""

    moment: TickMoment | None
    parent: Step | None


class _Expansion(NamedTuple):
    """What a process has found from one state. All numbers are those of the process.

    Attributes:
        vertices: The new vertices.
        states: The keys of those of the new vertices that are states between two ticks.
        edges: The edges of the state and of the new decisions.
        violations: The new violations.
        bounds: The new bounds.
        ticks: The number of ticks that were run.
    """

    vertices: list[_Vertex]
    states: _Keys
    edges: list[tuple[int, list[Edge]]]
    violations: dict[str, Violation]
    bounds: dict[str, Step | None]
    ticks: int


class _Reply(NamedTuple):
    """What a process has found from some states, and so far.

    Attributes:
        expansions: What was found from each state.
        assumed: The keys of unknown values that were compared although this may be impossible.
        counts: The counts of the results of all leaves.
        memory: The memory (bytes).
    """

    expansions: list[_Expansion]
    assumed: set[str]
    counts: _Counts
    memory: int


class _Peer:
    """What a process knows of the numbers of parts in another process. Both begin with the same table.

    Args:
        table: The table of the process itself.
    """

    def __init__(self, table: StateTable) -> None:
        self._table = table
        self._sent = set(range(table.part_count))
        self._received = {number: number for number in self._sent}

    def pack_keys(self, numbers: Sequence[int]) -> _Keys:
        """Return the keys of the states *numbers* for the other process."""
        keys = [self._table.key(number) for number in numbers]
        new = {part for key in keys for part in key} - self._sent
        self._sent |= new
        return _Keys(keys, [(part, self._table.part(part)) for part in new])

    def unpack_keys(self, message: _Keys) -> list[tuple[int, ...]]:
        """Return the keys that the other process has sent, in the numbers of this process."""
        for number, part in message.parts:
            self._received[number] = self._table.part_number(part)
        return [tuple([self._received[part] for part in key]) for key in message.keys]


def memory_used() -> int:
    """Return the greatest memory (bytes) that this process has used; 0 on Windows and in a browser."""
    if sys.platform in ("win32", "emscripten"):
        return 0
    import resource

    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return used if sys.platform == "darwin" else used * 1024


class SearchProcesses:
    """Processes that run ticks for one search.

    Args:
        jobs: The number of processes.
    """

    def __init__(self, explorer: Explorer, jobs: int) -> None:
        self._explorer = explorer
        self._pickler = _StatePickler(explorer)
        self._connections: list[Connection] = []
        self._processes: list[BaseProcess] = []
        self._replies: list[_Reply | None] = [None] * jobs
        self._peers = [_Peer(explorer.table) for _ in range(jobs)]
        # For each process: the numbers here of its vertices.
        self._vertices = [list(range(len(explorer.table))) for _ in range(jobs)]
        if sys.platform == "win32":
            raise OSError("processes cannot be forked")
        context = multiprocessing.get_context("fork")
        for _ in range(jobs):
            ours, theirs = context.Pipe()
            arguments = (theirs, [ours, *self._connections], explorer, self._pickler)
            process = context.Process(target=_serve, args=arguments, daemon=True)
            process.start()
            theirs.close()
            self._connections.append(ours)
            self._processes.append(process)

    def close(self) -> None:
        """End the processes, and add their counts of the results of leaves to those of the tree."""
        for connection, process in zip(self._connections, self._processes, strict=True):
            process.kill()
            process.join()
            connection.close()
        for reply in self._replies:
            for node, counted in zip(self._explorer.counted, reply.counts if reply else (), strict=False):
                counts = start_tick_counts(node)
                counts.ticks += counted[0]
                counts.skipped += counted[1]
                counts.success += counted[2]
                counts.failure += counted[3]

    @property
    def memory(self) -> int:
        """The greatest memory (bytes) that the processes have used."""
        return sum(reply.memory for reply in self._replies if reply is not None)

    def expand(self, numbers: Sequence[int]) -> None:
        """Run all ticks from some states, and add what was found to the graph.

        Args:
            numbers: The numbers of the states.

        Raises:
            PicklingError: A state has a value that other processes do not recognise.
            EOFError: A process has ended unexpectedly.
            ConnectionError: As EOFError.
        """
        jobs = len(self._connections)
        for job, connection in enumerate(self._connections):
            connection.send_bytes(self._pickler.dumps(self._peers[job].pack_keys(numbers[job::jobs])))
        for job, connection in enumerate(self._connections):
            reply = self._pickler.loads(connection.recv_bytes())
            if isinstance(reply, Exception):
                raise reply
            self._replies[job] = reply
            self._explorer.choices.assumed |= reply.assumed
        # In the order of the states, so that the first run to a state or a violation is always the same.
        for place in range(len(numbers)):
            reply = self._replies[place % jobs]
            assert reply is not None
            self._add(place % jobs, reply.expansions[place // jobs])

    def _add(self, job: int, expansion: _Expansion) -> None:
        """Add what a process has found from a state.

        A decision that other processes have found, too, is added again: the keys of decisions are long.
        """
        graph, table, vertices = self._explorer.graph, self._explorer.table, self._vertices[job]

        def edge_here(edge: Edge) -> Edge:
            return edge if edge.target < 0 else edge._replace(target=vertices[edge.target])

        def step_here(step: Step) -> Step:
            return vertices[step[0]], edge_here(step[1])

        graph.transitions += expansion.ticks
        keys = iter(self._peers[job].unpack_keys(expansion.states))
        for moment, parent in expansion.vertices:
            if moment is None:
                number, is_new = table.number_of_key(next(keys))
                vertices.append(number)
                if is_new:
                    assert parent is not None
                    self._explorer.add_state(number, step_here(parent))
            else:
                assert parent is not None
                vertices.append(table.add_without_key())
                graph.add_decision(step_here(parent), moment._replace(state=vertices[moment.state]))
        for vertex, edges in expansion.edges:
            graph.edges[vertices[vertex]] = [edge_here(edge) for edge in edges]
        for name, violation in expansion.violations.items():
            if graph.lacks_violation(name, violation.is_guessed):
                graph.violations[name] = replace(violation, step=step_here(violation.step))
        for reason, step in expansion.bounds.items():
            graph.bounds.setdefault(reason, None if step is None else step_here(step))


def _serve(
    connection: Connection, others: Sequence[Connection], explorer: Explorer, pickler: "_StatePickler"
) -> None:
    """Run ticks from the states that arrive, until the connection is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for other in others:
        other.close()
    peer = _Peer(explorer.table)
    before = _counts_of(explorer)
    while True:
        try:
            message = pickler.loads(connection.recv_bytes())
        except EOFError:
            return
        try:
            answer = pickler.dumps(_reply_to(explorer, peer, peer.unpack_keys(message), before))
        except Exception as error:
            answer = pickle.dumps(pickle.PicklingError(f"{type(error).__name__}: {error}"))
        connection.send_bytes(answer)


def _reply_to(explorer: Explorer, peer: _Peer, keys: Sequence[tuple[int, ...]], before: _Counts) -> _Reply:
    graph, table = explorer.graph, explorer.table
    expansions: list[_Expansion] = []
    for key in keys:
        first, ticks = len(table), graph.transitions
        violations, bounds = dict(graph.violations), set(graph.bounds)
        state, is_new = table.number_of_key(key)
        if is_new:
            graph.add_state(None)
        explorer.expand(state)
        new = range(first, len(table))
        expansions.append(
            _Expansion(
                [_Vertex(graph.decisions.get(vertex), graph.parents[vertex]) for vertex in new],
                peer.pack_keys([vertex for vertex in new if vertex not in graph.decisions]),
                [(vertex, graph.edges[vertex]) for vertex in {state, *new} if graph.edges[vertex]],
                {name: step for name, step in graph.violations.items() if violations.get(name) is not step},
                {reason: step for reason, step in graph.bounds.items() if reason not in bounds},
                graph.transitions - ticks,
            )
        )
    counts = [
        (now[0] - first[0], now[1] - first[1], now[2] - first[2], now[3] - first[3])
        for now, first in zip(_counts_of(explorer), before, strict=True)
    ]
    return _Reply(expansions, explorer.choices.assumed, counts, memory_used())


def _counts_of(explorer: Explorer) -> _Counts:
    counts = [start_tick_counts(node) for node in explorer.counted]
    return [(each.ticks, each.skipped, each.success, each.failure) for each in counts]


class _StatePickler:
    """Pickles states for processes that have the same tree.

    Types of values are recognised by their identity, so that they are sent as numbers.

    Args:
        explorer: The search.
    """

    def __init__(self, explorer: Explorer) -> None:
        types: dict[int, ValueType] = {}
        for node in explorer.tree.nodes:
            for input in node.config.inputs.values():
                types[id(input.port.type)] = input.port.type
            for output in node.config.outputs.values():
                types[id(output.type)] = output.type
            for entry in node._blackboard.local_entries().values():
                types[id(entry.declared)] = entry.declared
        self._types = list(types.values())
        self._numbers = {key: number for number, key in enumerate(types)}
        self._unknown = explorer.choices.unknown

    def dumps(self, value: object) -> bytes:
        """Return the bytes of *value*.

        Raises:
            PicklingError: An object that is equal only to itself is not known to the other processes.
        """
        file = BytesIO()
        pickler = pickle.Pickler(file, protocol=pickle.HIGHEST_PROTOCOL)
        pickler.persistent_id = self._identifier  # type: ignore[method-assign]
        pickler.dump(value)
        return file.getvalue()

    def loads(self, data: bytes) -> Any:
        """Return the value of *data*."""
        unpickler = pickle.Unpickler(BytesIO(data))
        unpickler.persistent_load = self._object  # type: ignore[method-assign]
        return unpickler.load()

    def _identifier(self, value: object) -> object:
        if isinstance(value, UnknownValue):
            return value.key, value.operands
        cls = type(value)
        if isinstance(value, Identity) and type(value.value) is not UnknownValue:
            raise pickle.PicklingError("a value is equal only to itself")
        if cls.__eq__ is not object.__eq__ or value is None or isinstance(value, (type, FunctionType, Enum)):
            return None
        number = self._numbers.get(id(value))
        if number is None and cls.__module__ != "builtins":
            raise pickle.PicklingError(f"a value of the class '{cls.__name__}' is equal only to itself")
        return number

    def _object(self, identifier: Any) -> object:
        return self._unknown(*identifier) if isinstance(identifier, tuple) else self._types[identifier]
