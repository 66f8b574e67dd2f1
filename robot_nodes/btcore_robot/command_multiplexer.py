"""The priorities of velocity commands from several sources."""

from btcore.clock import NS_PER_S

SOURCE_TIMEOUT = NS_PER_S // 2
"""How long (ns) a command blocks commands of lower priority (twist_mux's timeout in Tiago's files)."""


class CommandMultiplexer:
    """Selects among several sources of velocity commands by their priorities.

    A command is passed on unless a source of higher priority has sent a command within the last 0.5 s.
    """

    def __init__(self) -> None:
        self._last_commands: dict[int, int] = {}

    def admits(self, priority: int, now: int) -> bool:
        """Record a command, and return whether it is passed on to the base.

        Args:
            priority: The priority of the source of the command; a higher number wins.
            now: The time of the command (ns).
        """
        self._last_commands[priority] = now
        return not any(
            p > priority and now - stamp <= SOURCE_TIMEOUT for p, stamp in self._last_commands.items()
        )

    def clear(self) -> None:
        """Forget all earlier commands."""
        self._last_commands.clear()
