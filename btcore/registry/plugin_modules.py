"""The modules and files of node libraries: their import, and the errors about them."""

import importlib
import sys
from pathlib import Path
from types import ModuleType

from btcore.errors import RegistrationError
from btcore.names import PLUGIN_FILE_PREFIX
from btcore.suggestions import similar_file, suggestion


def import_module_or_file(module_or_file: str, library_name: str | None) -> ModuleType:
    """Import a module or Python file of a node library; errors also have the name of the library."""
    title = f"'{module_or_file}'"
    if library_name not in (None, module_or_file):
        title += f" of '{library_name}'"
    try:
        if module_or_file.endswith(".py") or Path(module_or_file).name != module_or_file:
            return _import_file(Path(module_or_file), title)
        return importlib.import_module(module_or_file)
    except RegistrationError:
        raise
    except (Exception, SystemExit) as error:
        # The plugin itself may be missing, or a module that it imports.
        if isinstance(error, ModuleNotFoundError) and f"{module_or_file}.".startswith(f"{error.name}."):
            message = "give the name of a module that can be imported, or a file ending in .py"
            hint = _file_hint(Path(module_or_file))
            raise RegistrationError(f"plugin {title} is not found: {message}{hint}") from error
        raise plugin_error(title, error) from error


def _import_file(path: Path, title: str) -> ModuleType:
    if not path.is_file():
        raise RegistrationError(f"plugin {title} is not found: there is no such file{_file_hint(path)}")
    from importlib.util import module_from_spec, spec_from_file_location

    name = f"{PLUGIN_FILE_PREFIX}{path.stem}"
    spec = spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise RegistrationError(f"plugin {title} is not a Python file")
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


def plugin_error(title: str, error: BaseException, doing: str = "it was imported") -> RegistrationError:
    """Return the error about a plugin that raised *error* while *doing*; it names the line.

    Args:
        title: The name of the plugin, in quotes.
    """
    if isinstance(error, SyntaxError):
        where = f"{error.filename}:{error.lineno}"
    else:
        import traceback

        last = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{last.filename}:{last.lineno}"
    return RegistrationError(f"plugin {title} raised while {doing}: {where}: {type(error).__name__}: {error}")
