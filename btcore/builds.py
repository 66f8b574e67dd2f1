"""Selection of the build: the files compiled with mypyc, or the Python source beside them.

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

HERE = Path(__file__).parent


class SourceOnly:
    """A finder for `sys.meta_path` that finds only the source files of *package*, not the compiled files.

    *reason* is the cause, for messages.
    """

    def __init__(self, package: str, reason: str) -> None:
        self.package = package
        self.reason = reason
        self._folders: dict[str, FileFinder] = {}

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return the spec of the source file of a module below the package.

        The result is None for any other module. Python then calls the next finder.
        """
        if not fullname.startswith(f"{self.package}."):
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


def select_build(package: str) -> None:
    """Install `SourceOnly` as the first finder for *package*, unless its compiled files can run.

    The `__init__` of the package calls this function before it imports anything else, because a module that
    may be compiled must not be imported earlier.
    """
    reason = why_pure(package, Path(sys.modules[package].__path__[0]))
    if reason and _source_only(package) is None:
        sys.meta_path.insert(0, SourceOnly(package, reason))


def why_pure(package: str, folder: Path) -> str:
    """Return why the source of *package* runs, or "" if its compiled files run."""
    if env_flag("BTCORE_PURE"):
        return "BTCORE_PURE is set"
    checkout = all((HERE.parent / file).is_file() for file in ("setup.py", "pyproject.toml"))
    if checkout and not env_flag("BTCORE_COMPILED"):
        return "a checkout runs its source, unless BTCORE_COMPILED=1 is set"
    library = library_of(package)
    # In a checkout, the library is beside btcore, and the package may be in another folder.
    places = (place / (library + end) for place in (folder.parent, HERE.parent) for end in EXTENSION_SUFFIXES)
    file = next(filter(Path.is_file, places), None)
    if file is None:
        return f"{library}, which they need, is missing"
    try:
        _load_library(library, file)
        parts = compiled_modules(package)
    except ImportError as error:
        return f"{library}, which they need, can't be loaded ({error})"
    suffix = file.name.removeprefix(library)
    paths = {name: str(folder.parent.joinpath(*name.split("."))) + suffix for name in parts}
    missing = [name for name, path in paths.items() if not os.path.exists(path)]  # noqa: PTH110 - it is fast
    return f"{', '.join(missing)} is missing among them; reinstall btcore" if missing else ""


def library_of(package: str) -> str:
    """Return the name of the extension module with the compiled code of *package*.

    The extension modules beside the sources only refer to it.
    """
    return f"{package}__mypyc"


def _load_library(name: str, file: Path) -> None:
    # Loaded by its path: it is not in a package, and an editable install makes only packages importable.
    spec = spec_from_file_location(name, file)
    if name in sys.modules or spec is None or spec.loader is None:
        return
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    sys.modules[name] = module


def compiled_modules(package: str = "btcore") -> list[str]:
    """Return the names of the compiled modules of a package.

    Args:
        package: `btcore` or `btcore_batch`.

    Raises:
        ImportError: The compiled code is missing.
    """
    marks = [name for name in dir(import_module(library_of(package))) if name.startswith("init_")]
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
    finder = _source_only("btcore")
    if finder is None:
        return ""
    unused = [file for file in HERE.rglob("*") if file.name.endswith(tuple(EXTENSION_SUFFIXES))]
    return f"{len(unused)} compiled files in {HERE} are not used: {finder.reason}" if unused else ""


def env_flag(variable: str) -> bool:
    """Return whether the environment variable called *variable* is set to a text other than "" and "0"."""
    return os.environ.get(variable, "0") not in ("", "0")


def _source_only(package: str) -> SourceOnly | None:
    finders = (finder for finder in sys.meta_path if isinstance(finder, SourceOnly))
    return next((finder for finder in finders if finder.package == package), None)


# --- docstrings


def written_docstring(cls: type) -> str:
    """Return the docstring of a compiled engine class, from the source file; "" for other classes.

    It is needed because mypyc drops the docstrings of classes.
    """
    module = sys.modules.get(cls.__module__)  # None for a mock node, whose class names the file of a model
    file = Path(getattr(module, "__file__", None) or "")
    if not cls.__module__.startswith("btcore.") or file.suffix == ".py":
        return ""
    return _docstrings(file.with_name(cls.__module__.rpartition(".")[2] + ".py")).get(cls.__name__, "")


@cache
def _docstrings(source: Path) -> dict[str, str]:
    import ast

    module = ast.parse(source.read_text(encoding="utf-8"))
    classes = [node for node in module.body if isinstance(node, ast.ClassDef)]
    return {node.name: ast.get_docstring(node) or "" for node in classes}
