"""A tree that is ticked for many agents at once, with numpy arrays (`pip install btcore[batch]`).

Leaves are functions of arrays:

    import btcore_batch as batch
    from btcore_batch import BatchTree, Bools, Floats

    @batch.condition
    def battery_ok(level: In[Floats], minimum: In[Floats] = 0.2) -> Bools: ...

    swarm = BatchTree.load("forage.xml", agents=10_000, leaves=[battery_ok, …])
    statuses = swarm.tick()
"""

from btcore import builds

try:
    import numpy as _  # noqa: F401
except ModuleNotFoundError as error:
    from btcore.extras import install_command

    command = install_command("numpy", "batch")
    raise ModuleNotFoundError(f"btcore_batch needs numpy: {command}", name="numpy") from error
else:
    builds.select_build(__name__)

from btcore_batch.agent_sets import Indices, Mask
from btcore_batch.blackboard import BatchBlackboard
from btcore_batch.leaf_declaration import (
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
from btcore_batch.node import BatchNode
from btcore_batch.tree import BatchNodeError, BatchTree

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
