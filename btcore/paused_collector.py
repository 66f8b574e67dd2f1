"""Pause Python's cyclic garbage collector."""

import gc
from types import TracebackType


class PausedCollector:
    """A context in which Python's cyclic garbage collector is disabled.

    While a tree is loaded or checked, the collector would scan the growing tree again and again, although no
    part of it is garbage.

    Args:
        keeps: Whether the new objects are kept afterwards. False if nearly all of them are freed.
    """

    def __init__(self, keeps: bool = True) -> None:
        self._keeps = keeps

    def __enter__(self) -> None:
        self._was_enabled = gc.isenabled()
        gc.disable()
        # A new tree goes to the oldest generation at once: scanning it on its way there takes a fifth of the
        # time of loading. Only freeze() moves objects there, and it moves all young objects of the process;
        # therefore the other young objects are collected first. An application's frozen objects stay frozen.
        self._moves = self._keeps and self._was_enabled and not gc.get_freeze_count()
        if self._moves:
            gc.collect(1)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._moves:
            gc.freeze()
            gc.unfreeze()
        if self._was_enabled:
            gc.enable()
