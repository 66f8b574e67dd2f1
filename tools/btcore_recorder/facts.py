"""Facts about a run that its recording contains: hashes of its tree and of the code of its leaves."""

import hashlib
import sys
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from functools import partial
from types import FunctionType
from typing import Any

from btcore.input_files import read_file
from btcore.registry.manifest import Manifest
from btcore_recorder.inputs import Facts, LeafCode


def collect_facts(
    run: str, documents: Sequence[tuple[str, str, bool]], manifests: Sequence[Manifest]
) -> Facts:
    """Return the facts about a run.

    Args:
        run: Identifies the run.
        documents: The documents of the tree.
        manifests: The external nodes.
    """
    modules = [(manifest.function or manifest.cls).__module__ for manifest in manifests]
    packages = dict.fromkeys(module.partition(".")[0] for module in modules)
    types = [parameter.resource_type for manifest in manifests for parameter in manifest.resource_parameters]
    resources = [f"{getattr(cls, '__module__', '?')}.{getattr(cls, '__qualname__', cls)}" for cls in types]
    hashes: dict[str, str] = {}
    codes = ((manifest.id, _find_code(manifest, hashes)) for manifest in manifests)
    return Facts(
        run,
        hash_documents(documents),
        {id: code for id, code in codes if code is not None},
        {name: str(getattr(sys.modules.get(name), "__version__", "")) for name in packages},
        tuple(dict.fromkeys(resources)),
    )


def hash_documents(documents: Iterable[tuple[str, str, bool]]) -> str:
    """Return a hash of the texts of documents, which does not depend on their paths."""
    digest = hashlib.sha256()
    for _, text, _ in documents:
        digest.update(hashlib.sha256(text.encode("utf-8", "surrogatepass")).digest())
    return digest.hexdigest()[:16]


def hash_file(path: str) -> str:
    """Return a hash of a file; "" if it cannot be read."""
    with suppress(OSError, ValueError):
        return hashlib.sha256(read_file(path)).hexdigest()[:16]
    return ""


def _find_code(manifest: Manifest, hashes: dict[str, str]) -> LeafCode | None:
    """Return the code of a node, or None if it is not known; *hashes* are those of the files so far."""
    implementation: Any = manifest.function or manifest.cls
    while isinstance(implementation, partial):
        implementation = implementation.func
    # That of a class would be found by parsing its file, which takes too long for each goal of a server.
    functions: list[Callable[..., object]] = [implementation, *vars(manifest.cls).values()]
    codes = [function.__code__ for function in functions if isinstance(function, FunctionType)]
    if not codes:
        return None
    file = codes[0].co_filename
    if file not in hashes:
        hashes[file] = hash_file(file)
    line = min(code.co_firstlineno for code in codes if code.co_filename == file)
    return LeafCode(f"{file}:{line}", hashes[file]) if hashes[file] else None
