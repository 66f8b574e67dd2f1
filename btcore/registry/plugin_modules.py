"""The modules and files of node libraries: their import, and the errors about them."""

import importlib
import sys
from pathlib import Path
from types import ModuleType

from btcore.errors import RegistrationError
from btcore.names import PLUGIN_FILE_PREFIX
from btcore.suggestions import similar_file, suggestion


def import_module_or_file(library: str, name: str | None) -> ModuleType:
    """Import the module or Python file *library*; errors also have the *name* of the node library."""
    title = library if name in (None, library) else f"{library}' of '{name}"
    try:
        if library.endswith(".py") or Path(library).name != library:
            return _import_file(Path(library))
        return importlib.import_module(library)
    except RegistrationError:
        raise
    except (Exception, SystemExit) as error:
        # The plugin itself may be missing, or a module that it imports.
        if isinstance(error, ModuleNotFoundError) and f"{library}.".startswith(f"{error.name}."):
            message = "give the name of a module that can be imported, or a file ending in .py"
            hint = _file_hint(Path(library))
            raise RegistrationError(f"plugin '{title}' is not found: {message}{hint}") from error
        raise plugin_error(title, error) from error


def _import_file(path: Path) -> ModuleType:
    if not path.is_file():
        raise RegistrationError(f"plugin '{path}' is not found: there is no such file{_file_hint(path)}")
    from importlib.util import module_from_spec, spec_from_file_location

    name = f"{PLUGIN_FILE_PREFIX}{path.stem}"
    spec = spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise RegistrationError(f"plugin '{path}' is not a Python file")
    module = module_from_spec(spec)
    # Before the module runs: dataclasses look up their module in sys.modules.
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


def _file_hint(path: Path) -> str:
    near = similar_file(path, ".py")
    return "" if near is None else "; " + suggestion(f"'{near}'")


def plugin_error(library: str, error: BaseException, doing: str = "it was imported") -> RegistrationError:
    """Return the error about a node library that raised *error* while *doing*; it names the line."""
    if isinstance(error, SyntaxError):
        where = f"{error.filename}:{error.lineno}"
    else:
        import traceback

        last = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{last.filename}:{last.lineno}"
    return RegistrationError(
        f"plugin '{library}' raised while {doing}: {where}: {type(error).__name__}: {error}"
    )
