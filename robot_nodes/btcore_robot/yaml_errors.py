"""Conversion of PyYAML's errors to errors of the caller's class, with the place in the file."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import yaml


@contextmanager
def yaml_errors(path: Path, error_type: type[Exception]) -> Iterator[None]:
    """Convert PyYAML's errors in the `with` block to errors with the file, the line and the column.

    Args:
        path: The file that the block reads.
        error_type: The class of the new errors.
    """
    try:
        yield
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        place = f"{path}:{mark.line + 1}:{mark.column + 1}" if mark else str(path)
        raise error_type(f"{place}: not valid YAML: {error.problem}") from None
    except RecursionError:
        raise error_type(f"{path}: not valid YAML: nested too deeply") from None
    except yaml.reader.ReaderError as error:
        raise error_type(f"{path}: not valid YAML: {error.reason}") from None
