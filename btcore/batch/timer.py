"""A moment for each agent, on the clock that all of them share."""

import numpy as np

from btcore.batch.agent_sets import AgentSets
from btcore.clock import NS_PER_MS


class Timer:
    """Which agents wait for a moment (ns), and for which.

    *wishes* are those for whom the tree is to be ticked when it comes.
    """

    def __init__(self, crowd: AgentSets) -> None:
        self.crowd = crowd
        self.waiting = 0
        self.wake_ups = 0
        self._moments = np.zeros(crowd.count, dtype=np.int64)
        self._first = 0

    def start(self, agents: int, now: int, milliseconds: int) -> None:
        """Let *agents* wait for the moment *milliseconds* after *now* (ns)."""
        moment = now + milliseconds * NS_PER_MS
        if agents == self.crowd.all_agents:
            self._moments[...] = moment
            self._first = moment
        else:
            np.copyto(self._moments, moment, where=self.crowd.mask(agents))
            known = self.waiting | self.wake_ups
            self._first = min(self._first, moment) if known else moment
        self.waiting |= agents
        self.wake_ups |= agents

    def due(self, agents: int, now: int) -> int:
        """Those of *agents* whose moment has come."""
        agents &= self.waiting
        if not agents or now < self._first:
            return 0
        return self.crowd.from_mask(self._moments <= now) & agents

    def stop(self, agents: int) -> None:
        """Let *agents* wait no longer, and wish nothing."""
        self.waiting ^= self.waiting & agents
        self.wake_ups ^= self.wake_ups & agents

    def forget(self, agents: int) -> None:
        """Let *agents* wait no longer; a wish stays."""
        self.waiting ^= self.waiting & agents

    def take_due_wake_ups(self, agents: int, now: int) -> int:
        """Those of *agents* whose wish has come; it is taken."""
        agents &= self.wake_ups
        if not agents or now < self._first:
            return 0
        due = self.crowd.from_mask(self._moments <= now) & agents
        self.wake_ups ^= due
        return due
