"""Exceptions with which the search ends a tick.

The engine passes them on as they are, and `except Exception` in the code of a node does not catch them.
"""

from collections.abc import Callable

from btcore.errors import TickInterrupt, UndecidedOperandError


class SearchInterrupt(TickInterrupt):
    """The search ends a tick."""


class KnownMomentError(SearchInterrupt):
    """The rest of the tick has been searched before."""


class UnknownOutcomeError(SearchInterrupt):
    """The search does not know how the tick continues. The message is the reason."""


class UnknownValueError(UnknownOutcomeError, UndecidedOperandError):
    """A node uses a value that the models do not know.

    Args:
        key: The key of the entry with the value.
        operand: The value.
        decide: Decides a comparison, as the method does.
    """

    def __init__(
        self,
        key: str,
        operand: object,
        decide: "Callable[[UnknownValueError, str, object, object], bool]",
    ) -> None:
        super().__init__(f"the value of {{{key}}} is not known: declare its domain", operand)
        self._decide = decide

    def decide(self, operator: str, left: object, right: object) -> bool:
        """Return whether the search continues as if `left operator right` were true."""
        return self._decide(self, operator, left, right)


class EndlessTickError(UnknownOutcomeError):
    """A tick did not end: it repeats nodes without a pause."""


class OpaqueStateError(UnknownOutcomeError):
    """A part of the state of a tree cannot be copied and compared."""


class HiddenInputError(UnknownOutcomeError):
    """A node uses the time or random numbers of the system."""


class LostInterruptError(UnknownOutcomeError):
    """A node caught an interrupt of the search, so that the rest of its tick means nothing."""
