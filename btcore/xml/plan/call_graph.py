"""The calls among the trees of a document: recursive calls, and the size of a tree with all its subtrees."""

import sys

from btcore.diagnostic_codes import RECURSIVE_TREES, TOO_LARGE
from btcore.tree.tree import MAX_NODES
from btcore.xml.plan.plan import SubtreeCall, TreePlan, TreePlanner
from btcore.xml.plan.tree_definitions import TreeDefinition
from btcore.xml.read.diagnostics import DiagnosticCollector

MAX_DEPTH = 10_000
"""The maximum number of levels of a tree. Ticking needs a few hundred bytes of the C stack for each level."""
_MAX_SHOWN_CYCLE = 20


class CallGraph:
    """Checks the calls among trees, and adds errors to *diagnostics*.

    A tree that is not recursive is visited once, however many of the checked trees call it.
    """

    def __init__(self, planner: TreePlanner, diagnostics: DiagnosticCollector) -> None:
        self._planner = planner
        self._diagnostics = diagnostics
        # The numbers of nodes and of levels of each tree that is not recursive, with all its subtrees.
        self._sizes: dict[str, tuple[int, int]] = {}

    def is_recursive(self, main: TreeDefinition) -> bool:
        """Return whether *main* calls a tree that contains itself, and add an error for each such call."""
        planner = self._planner
        order: dict[str, TreePlan] = {}  # each tree comes before the trees that call it
        is_recursive = False
        path: list[str] = []
        places: dict[str, int] = {}  # the index of each tree in the path
        pending: list[tuple[str, bool]] = [(main.id, False)]
        while pending:
            id, leaving = pending.pop()
            if leaving:
                del places[path.pop()]
                order[id] = planner.plan(planner.definitions.by_id[id])
                continue
            if id in order or id in self._sizes:
                continue
            places[id] = len(path)
            path.append(id)
            pending.append((id, True))
            plan = planner.plan(planner.definitions.by_id[id])
            for call in plan.calls:
                if call.tree in places:
                    is_recursive = True
                    self._add_cycle(path, places[call.tree], plan, call)
                elif call.tree in planner.definitions.by_id and call.tree not in order:
                    pending.append((call.tree, False))
        if not is_recursive:
            for id, plan in order.items():
                self._sizes[id] = self._size(plan)
        return is_recursive

    def size_of(self, main: TreeDefinition) -> int:
        """Return the number of nodes of *main*, which is not recursive, with all its subtrees."""
        return self._sizes[main.id][0]

    def check_size(self, main: TreeDefinition) -> bool:
        """Return whether *main*, which is not recursive, is small enough with all its subtrees.

        Otherwise add an error. If the tree needs a higher recursion limit of Python, increase the limit.
        """
        nodes, depth = self._sizes[main.id]
        message, hint = "", ""
        if nodes > MAX_NODES:
            message = f"with all its subtrees the tree has more than {MAX_NODES:,} nodes"
            hint = "nodes are numbered with 16 bits; look for trees that call other trees several times"
        elif depth > MAX_DEPTH:
            message = f"with all its subtrees the tree is more than {MAX_DEPTH:,} levels deep"
        else:
            # Nodes are created and ticked recursively, with at most six Python calls per level.
            sys.setrecursionlimit(max(sys.getrecursionlimit(), 6 * depth + 1000))
            return True
        self._diagnostics.add(main.document.diagnostic(TOO_LARGE, message, main.element, "ID", hint=hint))
        return False

    def _size(self, plan: TreePlan) -> tuple[int, int]:
        """Return the numbers of nodes and of levels of a tree. The sizes of its subtrees are known."""
        nodes, deepest = plan.size, 0
        for call in plan.calls:
            size = self._sizes.get(call.tree)  # None for an unknown tree
            if size is not None:
                nodes += size[0]
                deepest = max(deepest, size[1])
        return min(MAX_NODES + 1, nodes), plan.depth + deepest

    def _add_cycle(self, path: list[str], start: int, plan: TreePlan, call: SubtreeCall) -> None:
        """Add the error for *call* in the last tree of *path*: it calls the tree with the index *start*."""
        if len(path) - start < _MAX_SHOWN_CYCLE:
            cycle = path[start:]
        else:
            half = _MAX_SHOWN_CYCLE // 2
            cycle = [*path[start : start + half], "…", *path[1 - half :]]
        message = f"the trees call each other recursively: {' → '.join([*cycle, call.tree])}"
        document = plan.definition.document
        hint = "a tree can't contain itself"
        self._diagnostics.add(document.diagnostic(RECURSIVE_TREES, message, call.element, "ID", hint=hint))
