"""One small counter for each agent, as sets: plane *k* holds the agents whose count has bit *k*."""

import numpy as np
from numpy.typing import NDArray

from btcore.batch.agent_sets import AgentSets


class Counters:
    """Counts from 0. To add one for any number of agents takes a few operations on sets."""

    __slots__ = ("planes",)

    def __init__(self) -> None:
        self.planes: list[int] = []

    def add(self, agents: int) -> None:
        """Count one more for *agents*."""
        planes = self.planes
        for at, plane in enumerate(planes):
            planes[at] = plane ^ agents
            agents &= plane
            if not agents:
                return
        if agents:
            planes.append(agents)

    def clear(self, agents: int) -> None:
        """Begin at 0 for *agents*."""
        planes = self.planes
        for at, plane in enumerate(planes):
            if plane:
                planes[at] = plane ^ (plane & agents)
        while planes and not planes[-1]:
            planes.pop()

    def below(self, limit: int, agents: int) -> int:
        """Those of *agents* whose count is less than *limit*."""
        if limit <= 0:
            return 0
        less, same = 0, agents
        for at in range(max(len(self.planes), limit.bit_length()) - 1, -1, -1):
            plane = self.planes[at] if at < len(self.planes) else 0
            if limit >> at & 1:
                less |= same ^ (same & plane)
                same &= plane
            else:
                same ^= same & plane
        return less

    def equal(self, number: int, agents: int) -> int:
        """Those of *agents* whose count is *number*."""
        if number.bit_length() > len(self.planes):
            return 0
        for at, plane in enumerate(self.planes):
            agents = agents & plane if number >> at & 1 else agents ^ (agents & plane)
        return agents

    def numbers(self, crowd: AgentSets) -> NDArray[np.int64]:
        """Every agent's count."""
        counts = np.zeros(crowd.count, dtype=np.int64)
        for at, plane in enumerate(self.planes):
            counts += crowd.mask(plane).astype(np.int64) << at
        return counts
