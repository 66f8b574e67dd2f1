"""The rule of folding: which nodes of a tree a drawing hides if it has no room for all of them."""

from collections import deque
from collections.abc import Collection, Mapping, Sequence


def fold(
    children: Mapping[int, Sequence[int]],
    calls: Collection[int],
    most: int,
    folded: Collection[int] = (),
    unfolded: Collection[int] = (),
) -> dict[int, int]:
    """Return the number of hidden descendants of each visible node whose children are hidden, by its uid.

    Called trees are visible as a whole as long as there is room: first those whose SubTree node is in
    *unfolded*, and the outer before the inner trees. A tree that is too large for any drawing, and the main
    tree, are visible level by level.

    Args:
        children: The children of each node, by uid, in pre-order.
        calls: The SubTree nodes whose trees are visible as a whole, or not at all.
        most: The greatest number of visible nodes.
        folded: Nodes whose children are always hidden.
        unfolded: Nodes whose children are visible even without room, if the nodes are visible.
    """
    root = next(iter(children))
    visible = {root}
    for uid, below in children.items():
        if uid in visible and uid in unfolded and uid not in folded:
            visible.update(below)
    trees = _contents(children, calls, folded)
    for entry, content in sorted(trees.items(), key=lambda tree: tree[0] != root and tree[0] not in unfolded):
        if entry in visible and len(visible.union(content)) <= most:
            visible.update(content)
    waiting = deque([root])
    while waiting:
        uid = waiting.popleft()
        hidden = [child for child in children[uid] if child not in visible]
        fits_elsewhere = uid in calls and len(trees.get(uid, ())) <= most
        if hidden and (uid in folded or fits_elsewhere or len(visible) + len(hidden) > most):
            continue
        visible.update(hidden)
        waiting.extend(children[uid])
    sizes: dict[int, int] = {}
    for uid, below in reversed(list(children.items())):
        sizes[uid] = 1 + sum(sizes[child] for child in below)
    return {
        uid: sizes[uid] - 1
        for uid, below in children.items()
        if below and uid in visible and below[0] not in visible
    }


def _contents(
    children: Mapping[int, Sequence[int]], calls: Collection[int], folded: Collection[int]
) -> dict[int, list[int]]:
    """Return the nodes of each tree by its SubTree node, or by the root; the outer before the inner trees."""
    root = next(iter(children))
    trees: dict[int, list[int]] = {}
    waiting = deque([(root, [root])])
    while waiting:
        entry, pending = waiting.popleft()
        content = trees.setdefault(entry, [])
        while pending:
            uid = pending.pop()
            content.append(uid)
            if uid in folded or not children[uid]:
                continue
            if uid in calls:
                waiting.append((uid, list(reversed(children[uid]))))
            else:
                pending.extend(reversed(children[uid]))
    return trees
