"""Connect the blackboard keys of all trees: through SubTree elements, `_autoremap`, models and `@`."""

from collections.abc import Callable, Iterable, Iterator
from typing import Final, NamedTuple, TypeVar
from weakref import WeakKeyDictionary

from btcore.xml.plan.tree_plan import SubtreeCall
from btcore_studio.language.project import Project
from btcore_studio.language.project_symbols import ProjectSymbols, symbols_of
from btcore_studio.language.symbols import CallPort, KeyForm, KeyUse, TreeCall, TreeSymbol

MAX_LINKS: Final = 300_000
"""Maximum number of connections between keys, and of places that name them."""

_Item = TypeVar("_Item")
# A memory of results, which follow from the project alone.
_KNOWN: Final["WeakKeyDictionary[Project, KeyLinks]"] = WeakKeyDictionary()


def links_of(project: Project) -> "KeyLinks":
    """Return the links of the keys of *project*."""
    symbols = symbols_of(project)
    known = _KNOWN.get(project)
    if known is None or known.symbols is not symbols:
        known = _KNOWN[project] = KeyLinks(symbols)
    return known


class TreeKey(NamedTuple):
    """A key of a tree's own blackboard."""

    tree: TreeSymbol
    key: str


class _Link(NamedTuple):
    """A connection to another key, and whether the two keys have the same name by necessity."""

    to: TreeKey
    same_name: bool


class KeyLinks:
    """All keys of the trees, the places that name them, and their connections.

    A link leads from a key of a called tree to the key of the calling tree whose entry it is.

    Attributes:
        symbols: The symbols of the project.
        uses: For each key the places that name it.
        named: For each place the keys that it names: several, for example, if the SubTree element can call
            several trees with the same ID.
        own_name_remaps: The pairs of an inner and an outer key of which the outer is written as `{=}`.
        is_complete: Whether there are at most `MAX_LINKS` links and names. All further links are left out.
    """

    def __init__(self, symbols: ProjectSymbols) -> None:
        self.symbols = symbols
        self.uses: dict[TreeKey, list[KeyUse]] = {}
        self.named: dict[KeyUse, list[TreeKey]] = {}
        self.own_name_remaps: list[tuple[KeyUse, KeyUse]] = []
        self.is_complete = True
        self._size = 0
        self._callers: dict[TreeSymbol, list[TreeCall]] = {}
        self._outer: dict[TreeKey, list[_Link]] = {}
        self._inner: dict[TreeKey, list[_Link]] = {}
        self._roots: dict[TreeSymbol, list[TreeSymbol]] = {}
        # The call of each attribute that names a key of the called tree.
        self._calls: dict[KeyUse, TreeCall] = {}
        # The connected keys of each call and their places, with the defaults of the tree's model.
        self._connections: dict[TreeCall, tuple[SubtreeCall, list[CallPort]]] = {}
        for file in symbols.files.values():
            for tree in file.trees:
                self._add_tree(tree)
        self._add_models()
        self._link()

    # --- questions

    def entry_uses(self, keys: Iterable[TreeKey]) -> list[KeyUse]:
        """Return the places whose entry can be the entry of one of *keys*, across the remappings."""
        outermost = _reachable(keys, lambda key: (link.to for link in self._outer.get(key, ())))
        related = _reachable(outermost, lambda key: (link.to for link in self._inner.get(key, ())))
        known, from_outside = set(related), set(outermost)
        return [use for use in self.uses_of(related) if self._is_related(use, known, from_outside)]

    def outermost_keys(self, keys: Iterable[TreeKey]) -> list[TreeKey]:
        """Return the keys under which the outermost calling trees know the entries of *keys*."""
        around = _reachable(keys, lambda key: (link.to for link in self._outer.get(key, ())))
        return [key for key in around if not self._outer.get(key)]

    def first_use(self, keys: Iterable[TreeKey]) -> KeyUse | None:
        """Return the first place in the order of the trees that writes the entry of *keys*, else names it."""
        keys = list(keys)
        written = [use for use in self.entry_uses(keys) if use.form is not KeyForm.DEFAULT]
        candidates = dict.fromkeys([use for use in written if use.writes] or written)
        roots = dict.fromkeys(root for key in keys for root in self._roots_of(key.tree))
        first = next((use for use in self._in_order(roots) if use in candidates), None)
        return first if first is not None else next(iter(candidates), None)

    def same_name_keys(self, keys: Iterable[TreeKey]) -> list[TreeKey]:
        """Return the keys that must be renamed together with *keys*."""
        return _reachable(keys, self._namesakes)

    def is_outermost(self, key: TreeKey) -> bool:
        """Return whether the entry of *key* can be on the blackboard that a program passes to the tree."""
        return not self._outer.get(key) or key.tree in self._roots_of(key.tree)

    def is_called_with_autoremap(self, tree: TreeSymbol) -> bool:
        """Return whether a SubTree element calls *tree* with `_autoremap`."""
        return any(call.connections.autoremap for call in self._callers.get(tree, ()))

    def uses_of(self, keys: Iterable[TreeKey]) -> list[KeyUse]:
        """Return the places that name one of *keys*, each once."""
        return list(dict.fromkeys(use for key in keys for use in self.uses.get(key, ())))

    # --- construction

    def _add_tree(self, tree: TreeSymbol) -> None:
        for use in tree.uses:
            self._name(use, TreeKey(tree, use.key))
        for call in tree.calls:
            called = self.symbols.trees_called(call.id, tree.file)
            for inner_tree in called:
                self._callers.setdefault(inner_tree, []).append(call)
            # Every call has all ports of the tree's model: a short document could fill the memory.
            if self.is_complete:
                self._connections[call] = self.symbols.connections_of(call)
            else:
                self._connections[call] = call.connections, list(call.ports.values())
            _, ports = self._connections[call]
            self._count(len(ports))
            for port in ports:
                for inner_tree in called:
                    self._name(port.inner, TreeKey(inner_tree, port.inner.key))
                if port.inner.form is KeyForm.ATTRIBUTE:
                    self._calls[port.inner] = call
                if port.outer is not None:
                    self._name(port.outer, TreeKey(tree, port.outer.key))
                    if port.outer.form is KeyForm.OF_PORT:
                        self.own_name_remaps.append((port.inner, port.outer))

    def _add_models(self) -> None:
        for file in self.symbols.files.values():
            for model in file.models:
                if model.is_subtree:
                    for tree in self.symbols.trees_called(model.id, model.file):
                        for port in model.ports.values():
                            self._name(port.name, TreeKey(tree, port.name.key))

    def _name(self, use: KeyUse, key: TreeKey) -> None:
        keys = self.named.setdefault(use, [])
        if key not in keys:
            keys.append(key)
            self.uses.setdefault(key, []).append(use)
            self._count(1)

    def _count(self, more: int) -> None:
        self._size += more
        self.is_complete = self._size <= MAX_LINKS

    def _link(self) -> None:
        """Link every key, including keys that only an automatic remapping creates."""
        pending = list(self.uses)
        known = set(pending)
        while pending and self.is_complete:
            key = pending.pop()
            links = self._outer[key] = list(dict.fromkeys(self._links_outwards(key)))
            self._count(len(self._callers.get(key.tree, ())) + len(links))
            for link in links:
                self._inner.setdefault(link.to, []).append(_Link(key, link.same_name))
                if link.to not in known:
                    known.add(link.to)
                    pending.append(link.to)
        for key in known:
            self.uses.setdefault(key, [])

    def _links_outwards(self, key: TreeKey) -> Iterator[_Link]:
        format = self.symbols.files[key.tree.file].format
        if format == 4 and key.key.startswith("@"):
            # The entry of the outermost tree's blackboard, whatever the remappings.
            for root in self._roots_of(key.tree):
                yield _Link(TreeKey(root, key.key.lstrip("@")), True)
            return
        for call in self._callers.get(key.tree, ()):
            connections, _ = self._connections[call]
            outer = connections.outer_key(key.key)
            if outer is not None:
                yield _Link(TreeKey(call.caller, outer), key.key not in connections.remaps)

    def _namesakes(self, key: TreeKey) -> Iterator[TreeKey]:
        for link in (*self._outer.get(key, ()), *self._inner.get(key, ())):
            if link.same_name:
                yield link.to
        for use in self.uses.get(key, ()):
            yield from self.named[use]

    def _is_related(self, use: KeyUse, related: set[TreeKey], from_outside: set[TreeKey]) -> bool:
        """Return whether the entry of a place that names a related key is the same."""
        if use not in self._calls:
            return True
        # Each SubTree element that calls the tree connects the key with another entry.
        call = self._calls[use]
        outer = call.ports[use.key].outer
        if outer is not None:
            return TreeKey(call.caller, outer.key) in related
        return any(key in from_outside for key in self.named[use])

    # --- trees

    def _roots_of(self, tree: TreeSymbol) -> list[TreeSymbol]:
        """Return the outermost trees that call *tree* directly or indirectly, or the tree itself."""
        if tree not in self._roots:
            around = _reachable(
                [tree], lambda other_tree: (call.caller for call in self._callers.get(other_tree, ()))
            )
            named = {symbols.main_tree.value for symbols in self.symbols.files.values() if symbols.main_tree}
            roots = [
                other_tree
                for other_tree in around
                if other_tree not in self._callers or other_tree.id in named
            ]
            self._roots[tree] = sorted(roots or [tree], key=lambda other_tree: other_tree.id not in named)
        return self._roots[tree]

    def _in_order(self, roots: Iterable[TreeSymbol]) -> Iterator[KeyUse]:
        """Yield the places in the order in which the nodes of the trees are ticked first."""
        seen: set[TreeSymbol] = set()
        pending: list[TreeSymbol | TreeCall | KeyUse] = [*reversed(list(roots))]
        while pending:
            item = pending.pop()
            if isinstance(item, KeyUse):
                yield item
            elif isinstance(item, TreeCall):
                _, ports = self._connections[item]
                yield from (use for port in ports for use in (port.inner, port.outer) if use is not None)
                pending += reversed(self.symbols.trees_called(item.id, item.caller.file))
            elif item not in seen:
                seen.add(item)
                steps: list[TreeCall | KeyUse] = [*item.uses, *item.calls]
                steps.sort(key=_place_in_text, reverse=True)
                pending += steps


def _place_in_text(step: TreeCall | KeyUse) -> tuple[int, int]:
    # The keys of a SubTree's own conditions come before the keys of the tree that it calls.
    return (step.element.start, step.start if isinstance(step, KeyUse) else step.element.start_tag_end)


def _reachable(start: Iterable[_Item], neighbours: Callable[[_Item], Iterable[_Item]]) -> list[_Item]:
    """Return *start* and everything that *neighbours* leads to, each once."""
    reached = dict.fromkeys(start)
    pending = list(reached)
    while pending:
        for item in neighbours(pending.pop()):
            if item not in reached:
                reached[item] = None
                pending.append(item)
    return list(reached)
