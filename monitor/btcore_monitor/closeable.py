"""A base class of objects that are closed at the end of a `with` statement."""

from abc import ABC, abstractmethod
from typing import Self


class Closeable(ABC):
    """An object that is closed at the end of a `with` statement."""

    @abstractmethod
    def close(self) -> None:
        """Release all resources."""

    def __enter__(self) -> Self:
        return self

    # The exception is not suppressed.
    def __exit__(self, *error: object) -> None:
        self.close()
