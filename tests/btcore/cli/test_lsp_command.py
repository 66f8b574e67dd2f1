"""`btcore lsp` without its extra."""

import sys
from collections.abc import Callable

import pytest
from click.testing import Result


@pytest.mark.parametrize("module", ["pygls", "lsprotocol"])
def test_missing_extra_is_reported_with_the_install_command(
    cli: Callable[..., Result], monkeypatch: pytest.MonkeyPatch, module: str
) -> None:
    """Editors show stderr; stdout belongs to the protocol."""
    monkeypatch.delitem(sys.modules, "btcore.language.server", raising=False)
    monkeypatch.setitem(sys.modules, module, None)  # Python's mark for a module that is missing
    result = cli("lsp")
    assert result.exit_code == 2
    assert result.stdout == ""
    said = " ".join(result.stderr.split())
    assert "'lsp' requires an optional dependency: the module '" in said  # others may be missing, too
    assert "pip install 'btcore[lsp]'" in said
