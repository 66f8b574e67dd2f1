"""Which of the engine's two builds runs: compiled with mypyc, or the pure source beside it.

Python prefers a compiled file beside its source. ``BTCORE_PURE=1`` in the environment makes it
take the source all the same, so that a debugger can step through the engine of any install.
"""

import ast
import os
import sys
from collections.abc import Sequence
from functools import cache
from importlib.machinery import SOURCE_SUFFIXES, FileFinder, ModuleSpec, SourceFileLoader
from pathlib import Path
from types import ModuleType


class SourceOnly:
    """A finder for ``sys.meta_path`` that sees of btcore the source files alone."""

    @staticmethod
    def find_spec(
        fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """The source file of the module *fullname* below btcore, or None for the other finders."""
        if not fullname.startswith("btcore."):
            return None
        for folder in path or ():
            found = FileFinder(folder, (SourceFileLoader, SOURCE_SUFFIXES)).find_spec(fullname)
            if found is not None and found.loader is not None:
                return found
        return None


def choose() -> None:
    """Put :class:`SourceOnly` first if the environment asks for the pure build."""
    asked = os.environ.get("BTCORE_PURE", "0") not in ("", "0")
    if asked and not any(isinstance(finder, SourceOnly) for finder in sys.meta_path):
        sys.meta_path.insert(0, SourceOnly())


def running() -> str:
    """``"compiled"`` or ``"pure"``, by the file that the engine's status words came from."""
    from btcore import status

    source = status.__file__ or ""
    return "pure" if source.endswith(tuple(SOURCE_SUFFIXES)) else "compiled"


def written_docstring(cls: type) -> str:
    """The docstring of a class of the engine, which its compiled form has not: from the source beside it."""
    module = sys.modules[cls.__module__]
    file = Path(module.__file__ or "")
    if not cls.__module__.startswith("btcore.") or file.suffix == ".py":
        return ""
    return _docstrings(file.with_name(cls.__module__.rpartition(".")[2] + ".py")).get(cls.__name__, "")


@cache
def _docstrings(source: Path) -> dict[str, str]:
    """The docstrings of the classes in the file *source*."""
    classes = [node for node in ast.parse(source.read_text("utf-8")).body if isinstance(node, ast.ClassDef)]
    return {node.name: ast.get_docstring(node) or "" for node in classes}
