"""A sample of the typing that `make accept` does at length."""

from collections.abc import Callable
from types import ModuleType

import pytest

pytest.importorskip("pytest_lsp")


def test_typing_files_ends_with_the_diagnostics_of_validate(
    acceptance_script: Callable[[str], ModuleType],
) -> None:
    wrong, mistakes = acceptance_script("typed_files").run(3, range(5))
    assert wrong == []
    assert mistakes > 0
