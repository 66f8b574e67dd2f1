"""A plain enumeration of the runs of a tree, which shares no code with `btcore_proof`.

Every run is made from the start, on a tree that is loaded anew, on the ordinary engine: a script gives the
results of the leaves, the times of the ticks, and the time that passes within a tick before a timer is set.
Nothing is ever restored.

Times. All durations are multiples of a unit. Which timers have expired at which of *t* ticks is a system of
conditions `time j - time i >= n units` and `time j - time i < n units`. Such a system can be met if no
cycle of its conditions has a negative sum, where a cycle with a strict condition needs a positive sum,
which is at least a unit. A strict condition has to do with the beginning of a tick, when timers are judged,
and a cycle passes each of these once, so that it has at most t strict conditions: if each of them is replaced
by `<= n units - unit / t`, the sum remains at least 0, and the shortest paths are times on a grid of
unit / t. So it is complete to try all multiples of unit / t, up to the greatest remaining time of a timer:
after this time, nothing further expires.
"""

import pickle
import random
import threading
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from functools import partial
from typing import ClassVar, NamedTuple

from proof_plugins import DECLARED, HIDDEN, begin_run
from proof_trees import LEAVES, UNIT_MS, Atom, LeafKind, RandomQuestion, RandomTree

from btcore import NodeSpec
from btcore.blackboard.blackboard import Blackboard
from btcore.blackboard.format3 import Format3Blackboard
from btcore.clock import NS_PER_MS, Clock, SimClock, SystemClock
from btcore.engine.leaf import Condition, LeafNode, StatefulAction, SyncAction
from btcore.errors import NodeExecutionError
from btcore.loading.instantiate import instantiate
from btcore.nodes.manual_selector import Prompt
from btcore.registry.registry import Registry
from btcore.status import FAILURE, RUNNING, SKIPPED, SUCCESS, Status
from btcore.tree.tree import Tree
from btcore.xml.plan.plan import plan_document
from btcore.xml.read.read import parse_text
from tests.saved_state import save_state

_STATUSES = {"S": SUCCESS, "F": FAILURE, "K": SKIPPED, "R": RUNNING}
_TIMED = ("Delay", "Timeout", "Sleep", "UserTimer")
_WATCHERS = ("SkipUnlessUpdated", "WaitValueUpdate", "WasEntryUpdated")
_REACTIVE = ("ReactiveSequence", "ReactiveFallback")


class LeafScript:
    """The outcomes of the leaves in one tick: those that are given, then the first option of each.

    Args:
        unknown: The values that are written to entries whose values are not known to the prover.
    """

    def __init__(self, unknown: Sequence[int] = (1,)) -> None:
        self._unknown = unknown
        self.begin(())

    def begin(self, given: Sequence[int]) -> None:
        """Begin a tick."""
        self.given = list(given)
        self.options: list[int] = []
        self.completed: list[tuple[str, Status]] = []
        self.ticked: list[str] = []
        self.halted: list[str] = []
        self.log: list[tuple[str, str]] = []

    def choose(self, options: int) -> int:
        """Return the number of the next outcome."""
        place = len(self.options)
        self.options.append(options)
        if place == len(self.given):
            self.given.append(0)
        return self.given[place]

    def following(self) -> list[int] | None:
        """Return the outcomes to try next; None = this tick was the last."""
        given = list(self.given)
        while given:
            if given[-1] + 1 < self.options[len(given) - 1]:
                given[-1] += 1
                return given
            given.pop()
        return None

    def result(self, leaf: LeafNode, kind: LeafKind, may_complete: bool = True) -> Status:
        """Return the outcome of the tick of a leaf; write its output."""
        self.ticked.append(leaf.name)
        port = kind.port
        if port is not None and port.reads:
            leaf.get_input("value")
        options: list[tuple[str, int | None]] = [(letter, None) for letter in kind.results]
        if port is not None and port.writes:
            values = self._unknown if kind.key in "uw" else (0, 1)
            options = [("F", None), *((letter, value) for letter in "SF" for value in values)]
        letter, value = options[self.choose(len(options))] if may_complete else ("R", None)
        if value is not None:
            leaf.set_output("value", str(value) if kind.key in "sw" else value)
        self.log.append((leaf.name, letter))
        if letter in "SF":
            self.completed.append((leaf.name, _STATUSES[letter]))
        return _STATUSES[letter]


class ScriptedAction(StatefulAction):
    """An action that follows a LeafScript."""

    spec = NodeSpec(state_fields=())
    kind: ClassVar[LeafKind]

    def __init__(self, script: LeafScript) -> None:
        self.script = script

    def on_start(self) -> Status:
        """Return the outcome of the script; RUNNING if the kind of the leaf starts so."""
        return self.script.result(self, self.kind, not self.kind.is_late)

    def on_running(self) -> Status:
        """Return the outcome of the script."""
        return self.script.result(self, self.kind)

    def on_halted(self) -> None:
        """Record the halt."""
        self.script.halted.append(self.name)
        self.script.log.append((self.name, "H"))


class ScriptedSyncAction(SyncAction):
    """An action of one tick that follows a LeafScript."""

    spec = NodeSpec(state_fields=())
    kind: ClassVar[LeafKind]

    def __init__(self, script: LeafScript) -> None:
        self.script = script

    def tick(self) -> Status:
        """Return the outcome of the script."""
        return self.script.result(self, self.kind)


class ScriptedCondition(Condition):
    """A condition that follows a LeafScript."""

    spec = NodeSpec(state_fields=())
    kind: ClassVar[LeafKind]

    def __init__(self, script: LeafScript) -> None:
        self.script = script

    def tick(self) -> Status:
        """Return the outcome of the script."""
        return self.script.result(self, self.kind)


class ScriptedPrompt(Prompt):
    """A user whose answers follow a LeafScript."""

    def __init__(self, script: LeafScript) -> None:
        self.script = script

    def choose(self, question: str, options: list[str]) -> int:
        """Return the answer of the script."""
        return self.script.choose(len(options))


def _scripted_nodes() -> Registry:
    nodes = Registry.standard()
    bases: dict[str, type[LeafNode]] = {
        "condition": ScriptedCondition,
        "sync": ScriptedSyncAction,
        "action": ScriptedAction,
    }
    for tag, kind in LEAVES.items():
        ports = [] if kind.port is None else [kind.port]
        members = {"kind": kind, "provided_ports": staticmethod(lambda ports=ports: ports)}
        nodes.add(type(tag, (bases[kind.base],), members), ID=tag)
    for cls in (*DECLARED, *HIDDEN):
        nodes.add(cls)
    return nodes


SCRIPTED_NODES = _scripted_nodes()


def first_blackboard(format: int, clock: Clock) -> Blackboard:
    """Return the blackboard with which every run begins."""
    board = Blackboard(clock=clock) if format == 4 else Format3Blackboard(clock=clock)
    board["a"] = 0
    board["b"] = 0
    board["s"] = "0"
    board["z"] = 0.0
    return board


class Seen(NamedTuple):
    """What was seen in one tick.

    Attributes:
        before: The names of the nodes that were RUNNING before the tick.
        running: The names of the nodes that are RUNNING after the tick.
        results: The results of all nodes that were ticked, by name, in order.
        completed: The results of the leaves that completed.
        ticked: The names of the leaves whose code ran.
        halted: The names of the leaves that were halted while RUNNING.
        log: The results and halts (H) of the leaves, in order.
        entries: The values of the entries a, m and u; None = not written.
        orphans: Whether a node is RUNNING although its parent is not.
        has_two: Whether two children of a reactive node are RUNNING.
        result: The result of the tree; None after an exception.
        unwritten: Whether the exception is that a node has read an entry that was not written.
        culprits: The names of the nodes that raised.
        kept_timers: The names of the nodes with a timer that was pending before the tick and still is.
    """

    before: frozenset[str]
    running: frozenset[str]
    results: dict[str, list[Status]]
    completed: list[tuple[str, Status]]
    ticked: list[str]
    halted: list[str]
    log: list[tuple[str, str]]
    entries: dict[str, object]
    orphans: bool
    has_two: bool
    result: Status | None
    unwritten: bool
    culprits: list[str]
    kept_timers: frozenset[str]

    @property
    def has_ended(self) -> bool:
        """Whether the run ends with this tick."""
        return self.result is not RUNNING

    def holds(self, atom: Atom) -> bool:
        """Return whether a proposition holds."""
        if atom.kind == "running":
            return atom.name in self.running
        if atom.kind == "is":
            return Status[atom.value] in self.results.get(atom.name, ())
        if atom.kind == "ticked":
            return atom.name in self.results
        if atom.kind == "halted":
            return atom.name in self.halted
        # Format 3 writes the texts of the XML.
        return self.entries[atom.name] in (int(atom.value), atom.value)

    @property
    def kept(self) -> set[str]:
        """The names of the nodes that were RUNNING during the whole tick, without leaves that ended in it."""
        ended = {name for name, _ in self.completed} | set(self.halted)
        return set(self.before & self.running) - ended


Tick = tuple[int, tuple[int, ...]]
"""The time (ns) since the previous tick, and the outcomes of the leaves."""


class End(NamedTuple):
    """The end of a run.

    Attributes:
        seen: What was seen in the last tick.
        following: The outcomes to try next instead of those of the last tick; None = all were tried.
        given: The outcomes of the last tick.
        state: The state of the tree after it; empty if the run has ended.
        longest: The greatest remaining time (ns) of a timer.
    """

    seen: Seen
    following: list[int] | None
    given: tuple[int, ...]
    state: bytes
    longest: int


class SlowClock:
    """The clock of the nodes of a tree: time may pass before each reading, which a node makes to set a timer.

    Args:
        clock: The clock of the run.
        pass_time: Lets time pass.
    """

    def __init__(self, clock: SimClock, pass_time: Callable[[], None]) -> None:
        self._clock = clock
        self._pass_time = pass_time
        self._is_beginning = False

    def begin(self) -> None:
        """Begin a tick, which makes the first reading."""
        self._is_beginning = True

    def now(self) -> int:
        """Return the time (ns), after some time unless the tick begins."""
        if not self._is_beginning:
            self._pass_time()
        self._is_beginning = False
        return self._clock.now()

    def wait_until(self, deadline: int, wake: threading.Event) -> bool:
        """Do not wait."""
        return wake.is_set()


class RandomScript(LeafScript):
    """Random outcomes of the leaves, each of which takes up to *seconds*."""

    def __init__(self, rng: random.Random, seconds: float, unknown: Sequence[int]) -> None:
        super().__init__(unknown)
        self._rng = rng
        self._seconds = seconds

    def choose(self, options: int) -> int:
        """Return the number of the next outcome, after some time."""
        if self._seconds and self._rng.random() < 0.5:
            time.sleep(self._seconds * self._rng.random())
        self.options.append(options)
        return self._rng.randrange(options)


class Runner:
    """Runs a random tree from the start."""

    def __init__(self, tree: RandomTree, ticks: int) -> None:
        self.tree = tree
        self.grid = UNIT_MS * NS_PER_MS // ticks
        self.runs = 0
        self._plans = plan_document(parse_text(tree.xml), SCRIPTED_NODES)
        self._plans.diagnostics.raise_errors()
        self._unknown = (0, 1) if tree.compares_unknown else (1,)
        tags = tree.tags.values()
        self._watches = any(tag in tags for tag in _WATCHERS)
        self._counts_writes = self._watches and "UnsetBlackboard" in tags
        self._endless = {
            name
            for name, texts in tree.attributes.items()
            if "-1" in (texts.get("num_cycles"), texts.get("num_attempts"))
        }

    def run(self, script: Sequence[Tick]) -> End:
        """Run a tree that is loaded anew; only the last tick may end the run."""
        self.runs += 1
        begin_run()
        clock = SimClock()
        leaves = LeafScript(self._unknown)
        board = first_blackboard(self.tree.format, clock)
        resources = [leaves, ScriptedPrompt(leaves)]
        tree = instantiate(self._plans, resources, board, clock)
        results: dict[str, list[Status]] = {}

        def pass_time() -> None:
            steps = self.steps_of(self._longest_timer(tree, clock.now()))
            if len(steps) > 1 and not self.tree.is_instant:
                clock.advance(steps[leaves.choose(len(steps))] / 1e9)

        tree.context.clock = slow_clock = SlowClock(clock, pass_time)
        tree.context.uses_time = True
        for elapsed, given in script[:-1]:
            clock.advance(elapsed / 1e9)
            leaves.begin(given)
            slow_clock.begin()
            tree.tick_exactly_once()
        elapsed, given = script[-1]
        clock.advance(elapsed / 1e9)
        leaves.begin(given)
        slow_clock.begin()
        for node in tree.nodes:
            node.set_post_tick_function(partial(_record, results))
        seen = self._tick(tree, leaves, results, clock.now())
        state = b"" if seen.has_ended or self.tree.is_hidden else self.state(tree, clock.now())
        longest = self._longest_timer(tree, clock.now())
        return End(seen, leaves.following(), tuple(leaves.given), state, longest)

    def run_randomly(self, rng: random.Random, ticks: int) -> Iterator[Seen]:
        """Run the tree with random leaves, by the system's clock, and yield what happens in each tick.

        Args:
            rng: The source of random numbers.
            ticks: The greatest number of ticks.
        """
        begin_run()
        clock = SystemClock()
        has_timers = not {*_TIMED, "UserTimer", "UserElapsed"}.isdisjoint(self.tree.tags.values())
        seconds = 2.5 * UNIT_MS / 1000 if has_timers else 0.0
        leaves = RandomScript(rng, seconds, self._unknown)
        board = first_blackboard(self.tree.format, clock)
        resources = [leaves, ScriptedPrompt(leaves)]
        tree = instantiate(self._plans, resources, board, clock)
        results: dict[str, list[Status]] = {}
        for node in tree.nodes:
            node.set_post_tick_function(partial(_record, results))
        for _ in range(ticks):
            time.sleep(seconds * rng.random())
            leaves.begin(())
            results.clear()
            seen = self._tick(tree, leaves, results, clock.now())
            yield seen
            if seen.has_ended:
                return

    def _tick(self, tree: Tree, leaves: LeafScript, results: dict[str, list[Status]], now: int) -> Seen:
        before = frozenset(node.name for node in tree.nodes if node.status is RUNNING)
        deadlines = self._deadlines(tree)
        result: Status | None = None
        unwritten = False
        culprits: list[str] = []
        try:
            result = tree.tick_exactly_once()
        except NodeExecutionError as error:
            culprits = [each.path.rpartition("/")[2] for each in (error, *error.later_errors)]
            problems = ("is not on the blackboard", "never been written", "which has no value")
            unwritten = any(problem in str(error) for problem in problems)
        board = tree.blackboard
        pairs = [(parent, child) for parent in tree.nodes for child in parent.children]
        after = self._deadlines(tree)
        return Seen(
            before,
            frozenset(node.name for node in tree.nodes if node.status is RUNNING),
            {name: list(found) for name, found in results.items()},
            leaves.completed,
            leaves.ticked,
            leaves.halted,
            leaves.log,
            {key: board.get(key) for key in ("a", "m", "u")},
            any(child.status is RUNNING and parent.status is not RUNNING for parent, child in pairs),
            any(
                node.id in _REACTIVE and sum(child.status is RUNNING for child in node.children) > 1
                for node in tree.nodes
            ),
            result,
            unwritten,
            culprits,
            frozenset(name for name, end in after.items() if end > now and deadlines[name] == end),
        )

    @staticmethod
    def _deadlines(tree: Tree) -> dict[str, int]:
        return {node.name: node._deadline for node in tree.nodes if node.id in _TIMED}

    def _longest_timer(self, tree: Tree, now: int) -> int:
        """Return the greatest remaining time (ns) of a timer at the time *now* (ns)."""
        if "UserElapsed" in self.tree.tags.values():
            return UNIT_MS * NS_PER_MS
        return max((end - now for end in self._deadlines(tree).values() if end > now), default=0)

    def steps_of(self, longest: int) -> range:
        """Return the times (ns) until the next tick that must be tried."""
        return range(0, longest + self.grid, self.grid) if longest else range(1)

    def state(self, tree: Tree, now: int) -> bytes:
        """Return all that decides the future of *tree*, with times relative to *now* (ns)."""
        saved = save_state(tree)
        rows: list[object] = []
        for node, values in zip(tree.nodes, saved.values, strict=False):
            assert isinstance(values, dict)
            row = dict(values)
            if "_deadline" in row and row["_deadline"] > 0:
                row["_deadline"] = max(0, row["_deadline"] - now) + 1
            if "_completed" in row:
                row["_completed"] = sorted(row["_completed"])
            if node.name in self._endless:
                del row["_count"]
            if "_seen" in row and not self._counts_writes:
                # Nodes only compare the number of writes with the number that they have seen.
                entry = node.blackboard.find(node._key)
                row["_seen"] = entry is not None and entry.sequence_id == row["_seen"]
            rows.append(row)
        entries = [
            (each.declared.name, each.inferred, each.sequence_id if self._counts_writes else 0)
            for each in saved.entries
        ]
        statuses = [status.name for status, _ in saved.statuses]
        held = saved.values[len(saved.nodes) :]
        boards = [sorted(keys.items()) for keys in saved.boards]
        return pickle.dumps((rows, statuses, entries, held, boards))


def _record(results: dict[str, list[Status]], node: LeafNode, status: Status) -> Status:
    results.setdefault(node.name, []).append(status)
    return status


class Monitor:
    """What of the past decides whether a question is violated in later ticks."""

    @staticmethod
    def advanced(question: RandomQuestion, memory: int, seen: Seen) -> tuple[int, bool]:
        """Return the memory after a tick, and whether the tick violates the question.

        The memory is 0 at first. For `before` it is 1 after the first proposition has held. For `within` it
        is the number of ticks that are left plus 1 while the second proposition is awaited.
        """
        first = seen.holds(question.first)
        if question.second is None:
            return 0, first
        second = seen.holds(question.second)
        if question.kind == "before":
            memory = 1 if first else memory
            return memory, second and not memory
        if second:
            return 0, False
        if question.within is None:
            memory = 1 if first or memory else 0
            return memory, bool(memory) and seen.has_ended
        if memory:
            memory -= 1
            if memory == 1:
                return 0, True
        elif first:
            memory = question.within + 1
            if memory == 1:
                return 0, True
        return memory, bool(memory) and seen.has_ended


class Enumeration(NamedTuple):
    """The result of an enumeration.

    Attributes:
        ticks: The number of ticks of the longest runs.
        depths: For each violated question the number of ticks of the shortest run that violates it.
        runs: The number of runs.
        is_plain: Whether every run was continued, also those that lead to equal states.
    """

    ticks: int
    depths: dict[str, int]
    runs: int
    is_plain: bool


Check = Callable[[Seen], bool]


def standard_checks(tree: RandomTree) -> dict[str, Check]:
    """Return functions that return whether a tick violates a standard question, by question."""
    uses = {name: LEAVES[tree.tags[name]].uses for name in tree.leaves}

    def clashes(seen: Seen) -> bool:
        # A leaf uses its resource when it is ticked, and from then on while it is RUNNING.
        holders = set(seen.before & uses.keys())
        for name, letter in seen.log:
            if letter != "H" and any(uses[name] and uses[name] == uses[it] for it in holders - {name}):
                return True
            holders.discard(name)
            if letter == "R":
                holders.add(name)
        return False

    return {
        "no two leaves use the same resource at once": clashes,
        "everything that runs is halted when its parent ends": lambda seen: (
            seen.result is not None and seen.orphans
        ),
        "no reactive node keeps two children running": lambda seen: seen.has_two,
        "every mandatory input is written before it is read": lambda seen: seen.unwritten,
        "no node raises an exception": lambda seen: seen.result is None and not seen.unwritten,
    }


_Open = tuple[list[Tick], tuple[int, ...], int]
"""A run to be continued: its script, the memories of the questions, and the longest remaining time (ns)."""


def enumerate_runs(tree: RandomTree, ticks: int, most_runs: int, most_plain: int = 150) -> Enumeration | None:
    """Return what the runs of *tree* violate, or None if there are too many runs.

    If a part of the state of the tree is hidden, equal states are not known: the first *most_runs* runs are
    enumerated.

    Args:
        tree: The tree.
        ticks: The number of ticks of a run.
        most_runs: The maximum number of runs.
        most_plain: If more runs than this are to be continued, only one of those that lead to the same state
            of the tree and of the questions is continued. Such runs have the same continuations.
    """
    runner = Runner(tree, ticks)
    checks = standard_checks(tree)
    depths: dict[str, int] = {}
    front: list[_Open] = [([], (0,) * len(tree.questions), 0)]
    known: set[tuple[bytes, tuple[int, ...]]] = set()
    is_plain = True
    for depth in range(1, ticks + 1):
        found: list[tuple[_Open, tuple[bytes, tuple[int, ...]]]] = []
        for script, memories, longest in front:
            for elapsed in runner.steps_of(longest):
                for end in _run_outcomes(runner, script, elapsed):
                    if runner.runs > most_runs:
                        return Enumeration(ticks, depths, runner.runs, False) if tree.is_hidden else None
                    seen = end.seen
                    for question, is_violated in checks.items():
                        if is_violated(seen):
                            depths.setdefault(question, depth)
                    later: list[int] = []
                    for asked, memory in zip(tree.questions, memories, strict=True):
                        memory, wrong = Monitor.advanced(asked, memory, seen)
                        later.append(memory)
                        if wrong:
                            depths.setdefault(str(asked), depth)
                    if not seen.has_ended:
                        remembered = tuple(later)
                        opened = ([*script, (elapsed, end.given)], remembered, end.longest)
                        found.append((opened, (end.state, remembered)))
        if len(found) <= most_plain or tree.is_hidden:
            front = [opened for opened, _ in found]
            known.update(key for _, key in found)
            continue
        front = []
        for opened, key in found:
            if key in known:
                is_plain = is_plain and depth == ticks
            else:
                known.add(key)
                front.append(opened)
    return Enumeration(ticks, depths, runner.runs, is_plain)


def _run_outcomes(runner: Runner, script: Sequence[Tick], elapsed: int) -> Iterator[End]:
    """Run all outcomes of the tick after *script*."""
    given: list[int] | None = []
    while given is not None:
        end = runner.run([*script, (elapsed, tuple(given))])
        yield end
        given = end.following


class Arc(NamedTuple):
    """A tick from a state: the number of the next state, or -1 at the end of the run, and what was seen."""

    source: int
    target: int
    seen: Seen


def enumerate_graph(tree: RandomTree, ticks: int, most_runs: int) -> tuple[list[Arc], int] | None:
    """Return the ticks from all states of *tree*, and the number of states; None after too many runs.

    If a part of the state of the tree is hidden, the result is None, too.
    """
    if tree.is_hidden:
        return None
    runner = Runner(tree, ticks)
    scripts: list[tuple[list[Tick], int]] = [([], 0)]
    numbers: dict[bytes, int] = {b"": 0}
    arcs: list[Arc] = []
    for source, (script, longest) in _growing(scripts):
        for elapsed in runner.steps_of(longest):
            for end in _run_outcomes(runner, script, elapsed):
                if runner.runs > most_runs:
                    return None
                seen = end.seen
                target = -1
                if not seen.has_ended:
                    if end.state not in numbers:
                        numbers[end.state] = len(scripts)
                        scripts.append(([*script, (elapsed, end.given)], end.longest))
                    target = numbers[end.state]
                arcs.append(Arc(source, target, seen))
    return arcs, len(scripts)


def _growing(items: list[tuple[list[Tick], int]]) -> Iterator[tuple[int, tuple[list[Tick], int]]]:
    """Return all items with their numbers, also those that are added meanwhile."""
    place = 0
    while place < len(items):
        yield place, items[place]
        place += 1


FairnessRule = tuple[Callable[[Arc], bool], Callable[[Arc], bool]]
"""A cause and an effect: if the cause happens infinitely often, the effect does too."""


def has_fair_cycle(arcs: Collection[Arc], conditions: Sequence[FairnessRule]) -> bool:
    """Return whether *arcs* contain a cycle that meets all conditions, by trying all subsets.

    A cycle meets a condition if it avoids the cause, or if it has the effect. For each subset of the
    conditions, the causes of the subset are avoided; then a strongly connected component must have the
    effects of all other conditions.
    """
    marked = {
        (
            arc.source,
            arc.target,
            sum(1 << n for n, (cause, _) in enumerate(conditions) if cause(arc)),
            sum(1 << n for n, (_, effect) in enumerate(conditions) if effect(arc)),
        )
        for arc in arcs
        if arc.target >= 0
    }
    whole = (1 << len(conditions)) - 1
    edges = list(marked)
    inner = [edge for part in _strong_parts(edges) for edge in part]
    possible = 0
    for _, _, causes, _ in inner:
        possible |= causes
    always = whole
    for _, _, causes, _ in inner:
        always &= causes
    avoidable = possible & ~always
    avoided = avoidable
    while True:
        kept = [edge for edge in inner if not edge[2] & avoided]
        needed = possible & ~avoided
        for part in _strong_parts(kept):
            effects = 0
            for edge in part:
                effects |= edge[3]
            if needed & ~effects == 0:
                return True
        if not avoided:
            return False
        avoided = (avoided - 1) & avoidable


_Edge = tuple[int, int, int, int]


def _strong_parts(edges: Sequence[_Edge]) -> list[list[_Edge]]:
    """Return the edges within each strongly connected component (Kosaraju's algorithm)."""
    forward: dict[int, list[int]] = {}
    backward: dict[int, list[int]] = {}
    for source, target, _, _ in edges:
        forward.setdefault(source, []).append(target)
        backward.setdefault(target, []).append(source)
    order: list[int] = []
    visited: set[int] = set()
    for root in forward:
        if root in visited:
            continue
        visited.add(root)
        work = [(root, iter(forward[root]))]
        while work:
            state, targets = work[-1]
            for target in targets:
                if target not in visited:
                    visited.add(target)
                    work.append((target, iter(forward.get(target, ()))))
                    break
            else:
                order.append(state)
                work.pop()
    parts: dict[int, int] = {}
    for root in reversed(order):
        if root in parts:
            continue
        parts[root] = root
        stack = [root]
        while stack:
            for source in backward.get(stack.pop(), ()):
                if source not in parts:
                    parts[source] = root
                    stack.append(source)
    inside: dict[int, list[_Edge]] = {}
    for edge in edges:
        if parts[edge[0]] == parts[edge[1]]:
            inside.setdefault(parts[edge[0]], []).append(edge)
    return list(inside.values())
