"""Lanes for slices of time that overlap, so that every lane holds properly nested slices.

Trace events know of no slice that ends while one that began later on the same thread goes on. Nodes
do that: the first child of a Parallel may be done before the second. So a slice goes on its parent's
lane only while the parent is innermost there, else on a free one.
"""


class SliceLanes:
    """Which node's slice is open on which lane; lanes count from 1."""

    def __init__(self, parents: dict[int, int]) -> None:
        self._parents = parents
        self._stacks: list[list[int]] = []
        self._lane: dict[int, int] = {}

    def lane(self, uid: int) -> int:
        """Where something of node *uid* that takes no time is shown: with its parent, if that is open."""
        if uid in self._lane:
            return self._lane[uid]
        return self._lane.get(self._parents.get(uid, 0), 1)

    def begin(self, uid: int) -> int:
        """Open the slice of node *uid*; returns its lane."""
        parent = self._parents.get(uid, 0)
        place = self._lane.get(parent, 0)
        if not place or self._stacks[place - 1][-1] != parent:
            place = self._free()
        self._stacks[place - 1].append(uid)
        self._lane[uid] = place
        return place

    def end(self, uid: int) -> tuple[int, list[int]]:
        """Close the slice of node *uid*; returns its lane, and which slices lie within, the outermost first.

        Those are cut: they end with it, and may begin again elsewhere.
        """
        place = self._lane[uid]
        stack = self._stacks[place - 1]
        depth = stack.index(uid)
        within = stack[depth + 1 :]
        del stack[depth:]
        for one in (uid, *within):
            del self._lane[one]
        return place, within

    def open(self) -> list[tuple[int, int]]:
        """Every open slice as (node, lane), such that closing them in this order keeps the nesting."""
        return [(uid, place) for place, stack in enumerate(self._stacks, 1) for uid in reversed(stack)]

    def __contains__(self, uid: int) -> bool:
        return uid in self._lane

    def _free(self) -> int:
        for place, stack in enumerate(self._stacks, 1):
            if not stack:
                return place
        self._stacks.append([])
        return len(self._stacks)
