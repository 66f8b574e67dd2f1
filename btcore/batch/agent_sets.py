"""Sets of agents, and how they become masks.

A set is a Python integer whose bit *i* stands for agent *i*: ``&``, ``|`` and ``^`` on integers of a
thousand bits take some 30 ns, a tenth of what they take on numpy's booleans, and nothing can be changed
behind anybody's back. The control nodes know sets alone; leaves and scripts get masks.
"""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from btcore.errors import BtcoreError

Mask: TypeAlias = NDArray[np.bool_]
"""True for the agents that are meant, of shape (agents,)."""
Indices: TypeAlias = NDArray[np.intp]
"""The numbers of the agents that are meant, from 0, ascending."""


class AgentSets:
    """How many agents there are. *everyone* is the set of all."""

    def __init__(self, count: object) -> None:
        if isinstance(count, bool) or not isinstance(count, (int, np.integer)):
            raise BtcoreError(f"how many agents a batch has is a whole number, not {count!r}")
        if count < 1:
            raise BtcoreError(f"a batch needs at least one agent, not {count}")
        self.count = int(count)
        self.all_agents = (1 << self.count) - 1
        self._bytes = (self.count + 7) // 8
        self._full = np.ones(self.count, dtype=np.bool_)
        self._full.flags.writeable = False
        self._last = 0
        self._last_mask: Mask = np.zeros(self.count, dtype=np.bool_)
        self._last_mask.flags.writeable = False

    def mask(self, agents: int) -> Mask:
        """*agents* as a mask, which is not to be written."""
        if agents == self.all_agents:
            return self._full
        if agents is self._last:
            return self._last_mask
        data = np.frombuffer(agents.to_bytes(self._bytes, "little"), np.uint8)
        # Positional arguments, and setflags, save numpy a third of the time.
        mask: Mask = np.unpackbits(data, None, self.count, "little").view(np.bool_)
        mask.setflags(write=False)
        self._last, self._last_mask = agents, mask
        return mask

    def from_mask(self, mask: Mask) -> int:
        """The set that *mask* (of bools) stands for."""
        return int.from_bytes(np.packbits(mask, None, "little").tobytes(), "little")

    def indices(self, agents: int) -> Indices:
        """The numbers of *agents*, ascending."""
        return np.flatnonzero(self.mask(agents))

    def from_user_mask(self, mask: object) -> int:
        """The set that a user's *mask* means: None is everyone. Raises BtcoreError for what is no mask."""
        if mask is None:
            return self.all_agents
        try:
            array = np.asarray(mask)
        except ValueError:
            raise BtcoreError(f"a mask has {self.count} bools, one an agent, but this is no array") from None
        if array.dtype != np.bool_ or array.shape != (self.count,):
            raise BtcoreError(
                f"a mask has {self.count} bools, one an agent, but this has the shape {array.shape} and the "
                f"type {array.dtype}"
            )
        return self.from_mask(array)
