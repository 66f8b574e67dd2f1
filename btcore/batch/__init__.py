"""A tree that is ticked for many agents at once, with numpy arrays (`pip install btcore[batch]`).

Leaves are functions of arrays:

    from btcore import batch
    from btcore.batch import BatchTree, Floats, Mask

    @batch.condition
    def battery_ok(level: In[Floats], minimum: In[Floats] = 0.2) -> Bools: ...

    swarm = BatchTree.load("forage.xml", agents=10_000, leaves=[battery_ok, …])
    statuses = swarm.tick()
"""

try:
    import numpy as _  # noqa: F401
except ModuleNotFoundError as error:
    raise ModuleNotFoundError("btcore.batch needs numpy: pip install btcore[batch]", name="numpy") from error

from btcore.batch.agent_sets import Indices, Mask
from btcore.batch.blackboard import BatchBlackboard
from btcore.batch.leaf_declaration import (
    Bools,
    Floats,
    Ints,
    NodeName,
    Rows,
    StatefulAction,
    Statuses,
    Texts,
    action,
    condition,
)
from btcore.batch.node import BatchNode
from btcore.batch.tree import BatchNodeError, BatchTree

__all__ = [
    "BatchBlackboard",
    "BatchNode",
    "BatchNodeError",
    "BatchTree",
    "Bools",
    "Floats",
    "Indices",
    "Ints",
    "Mask",
    "NodeName",
    "Rows",
    "StatefulAction",
    "Statuses",
    "Texts",
    "action",
    "condition",
]
