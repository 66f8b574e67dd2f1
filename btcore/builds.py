"""Selection of the engine's build: the files compiled with mypyc, or the Python source beside them.

Python prefers a compiled file to the source beside it. This module makes Python ignore the compiled files
in three cases: in a checkout, whose source may be newer than the compiled files; in an install in which a
compiled file is missing, which would crash; and if `BTCORE_PURE=1` is set, so that a debugger can step
through the engine.
"""

import os
import sys
from collections.abc import Sequence
from functools import cache
from importlib import import_module
from importlib.machinery import EXTENSION_SUFFIXES, SOURCE_SUFFIXES, FileFinder, ModuleSpec, SourceFileLoader
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

__all__ = ["active_build", "compiled_modules"]

LIBRARY = "btcore__mypyc"
"""The extension module with all compiled code; the extension modules beside the sources only refer to it."""
HERE = Path(__file__).parent


class SourceOnly:
    """A finder for `sys.meta_path` that finds only the source files of btcore, not the compiled files.

    *reason* is the cause, for messages.
    """

    def __init__(self, reason: str) -> None:
        self.reason = reason
        self._folders: dict[str, FileFinder] = {}

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return the spec of the source file of a module below btcore.

        Args:
            fullname: The full name of the module, for example `btcore.engine.node`.
            path: The `__path__` of the module's parent package: the folders to search; None for a top-level
                module.
            target: Ignored; part of the interface of finders.

        Returns:
            The spec; None if the module is not below btcore or has no source file. Python then calls the
            next finder.
        """
        if not fullname.startswith("btcore."):
            return None
        for folder in path or ():
            finder = self._folders.get(folder)
            if finder is None:
                finder = self._folders[folder] = FileFinder(folder, (SourceFileLoader, SOURCE_SUFFIXES))
            spec = finder.find_spec(fullname)
            if spec is not None and spec.loader is not None:
                return spec
        return None

    def invalidate_caches(self) -> None:
        """Forget the cached contents of folders."""
        self._folders.clear()


def select_build() -> None:
    """Install `SourceOnly` as the first finder, unless the compiled build can run."""
    reason = why_pure()
    if reason and _source_only() is None:
        sys.meta_path.insert(0, SourceOnly(reason))


def why_pure() -> str:
    """Return why the pure build runs, or "" for the compiled build."""
    if env_flag("BTCORE_PURE"):
        return "BTCORE_PURE is set"
    checkout = all((HERE.parent / file).is_file() for file in ("setup.py", "pyproject.toml"))
    if checkout and not env_flag("BTCORE_COMPILED"):
        return "a checkout runs its source, unless BTCORE_COMPILED=1 is set"
    file = next(filter(Path.is_file, (HERE.parent / (LIBRARY + end) for end in EXTENSION_SUFFIXES)), None)
    if file is None:
        return f"{LIBRARY}, which they need, is missing"
    try:
        _load_library(file)
        parts = compiled_modules()
    except ImportError as error:
        return f"{LIBRARY}, which they need, can't be loaded ({error})"
    suffix = file.name.removeprefix(LIBRARY)
    paths = {name: str(HERE.parent.joinpath(*name.split("."))) + suffix for name in parts}
    missing = [name for name, path in paths.items() if not os.path.exists(path)]  # noqa: PTH110 - it is fast
    return f"{', '.join(missing)} is missing among them; reinstall btcore" if missing else ""


def _load_library(file: Path) -> None:
    # Loaded by its path: it is not in a package, and an editable install makes only packages importable.
    spec = spec_from_file_location(LIBRARY, file)
    if LIBRARY in sys.modules or spec is None or spec.loader is None:
        return
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    sys.modules[LIBRARY] = module


def compiled_modules() -> list[str]:
    """Return the names of the modules compiled into `LIBRARY`. Raise ImportError if it is missing."""
    marks = [name for name in dir(import_module(LIBRARY)) if name.startswith("init_")]
    return [mark.removeprefix("init_").replace("___", ".") for mark in marks]


def active_build() -> str:
    """Return `"compiled"` or `"pure"`, by the file from which btcore.status was imported.

    Examples:
        >>> from btcore import builds
        >>> builds.active_build() in ("compiled", "pure")
        True
    """
    from btcore import status

    source = status.__file__ or ""
    return "pure" if source.endswith(tuple(SOURCE_SUFFIXES)) else "compiled"


def unused_build_message() -> str:
    """Return a message about compiled files that exist but are not used, or ""."""
    finder = _source_only()
    if finder is None:
        return ""
    unused = [file for file in HERE.rglob("*") if file.name.endswith(tuple(EXTENSION_SUFFIXES))]
    return f"{len(unused)} compiled files in {HERE} are not used: {finder.reason}" if unused else ""


def env_flag(variable: str) -> bool:
    """Return whether the environment variable called *variable* is set to a text other than "" and "0"."""
    return os.environ.get(variable, "0") not in ("", "0")


def _source_only() -> SourceOnly | None:
    return next((finder for finder in sys.meta_path if isinstance(finder, SourceOnly)), None)


# --- docstrings


def written_docstring(cls: type) -> str:
    """Return the docstring of a compiled engine class, from the source file; "" for other classes.

    It is needed because mypyc drops the docstrings of classes.
    """
    module = sys.modules[cls.__module__]
    file = Path(module.__file__ or "")
    if not cls.__module__.startswith("btcore.") or file.suffix == ".py":
        return ""
    return _docstrings(file.with_name(cls.__module__.rpartition(".")[2] + ".py")).get(cls.__name__, "")


@cache
def _docstrings(source: Path) -> dict[str, str]:
    """Return the docstrings of the classes in the file *source*."""
    import ast

    module = ast.parse(source.read_text(encoding="utf-8"))
    classes = [node for node in module.body if isinstance(node, ast.ClassDef)]
    return {node.name: ast.get_docstring(node) or "" for node in classes}
