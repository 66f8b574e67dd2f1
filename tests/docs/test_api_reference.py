"""The API reference describes every public name: parameters, results, errors and attributes."""

import ast
import re
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path

import pytest

import btcore

ROOT = Path(__file__).parents[2]
griffe = pytest.importorskip("griffe")
sys.path.insert(0, str(ROOT / "docs" / "site"))

import api_pages  # noqa: E402

SOURCE = api_pages.load_packages()

# Modules whose constants are a table: their pages show the values, the class of the values explains them.
TABLES = ("btcore.diagnostic_codes", "btcore.values", "btcore_monitor.events")
# Nav2's documentation explains the parameters; the pages show their names, types and defaults.
NAV2_PARAMETERS = "btcore_robot.navigation.parameters"
# Leaves and processes are run, not called: their pages describe the ports and the topics, and hide all else.
LEAVES = "btcore_robot.leaves"
PROCESS = "btcore_robot.process.process.Process"


def public_objects() -> Iterator[tuple[str, griffe.Object]]:
    """Yield the public names with their paths, as a user writes them, and the members of public classes."""
    seen = set()
    listed = [("btcore", btcore.__all__)]
    listed += [(name, api_pages.public_names(SOURCE[name])) for name in api_pages.public_modules()[1:]]
    for module, names in listed:
        for name in names:
            described = SOURCE[f"{module}.{name}"]
            if described.is_alias:
                described = described.final_target
            if described.is_module or described.path in seen:
                continue
            seen.add(described.path)
            yield f"{module}.{name}", described
            if described.is_class:
                for member in described.members.values():
                    if not member.is_alias and not member.name.startswith("_"):
                        yield f"{module}.{name}.{member.name}", member


PUBLIC = list(public_objects())
CLASSES = [(path, it) for path, it in PUBLIC if it.is_class]
FUNCTIONS = [(path, it) for path, it in PUBLIC if it.is_function and not it.path.startswith(LEAVES)]
ATTRIBUTES = [(path, it) for path, it in PUBLIC if it.is_attribute]


def sections(described: griffe.Object, kind: str) -> Iterator[griffe.DocstringElement]:
    """Yield the entries of the sections *kind* (parameters, raises, …) in a docstring."""
    if described.docstring is not None:
        for section in griffe.parse_google(described.docstring, warnings=False):
            if section.kind.value == kind:
                yield from section.value


def bases(cls: griffe.Class) -> list[griffe.Class]:
    """Return the base classes of *cls* that are in the project."""
    return [base for base in cls.mro() if base.path.startswith("btcore")]


def overridden(member: griffe.Object) -> list[griffe.Object]:
    """Return the documented members of base classes that *member* overrides."""
    found = [base.members.get(member.name) for base in bases(member.parent)]
    return [it for it in found if it is not None and it.docstring is not None]


def explains(cls: griffe.Class, name: str) -> bool:
    """Whether the docstring of *cls* or of its `__init__` explains the attribute or parameter *name*."""
    texts = [it for it in (cls, cls.members.get("__init__")) if it is not None and not it.is_alias]
    for it in texts:
        entries = [*sections(it, "attributes"), *sections(it, "parameters")]
        if any(entry.name.lstrip("*") == name for entry in entries):
            return True
        if it.docstring is not None and re.search(rf"([*`]){name}\1", it.docstring.value):
            return True
    return any(explains(base, name) for base in bases(cls))


def is_run_only(cls: griffe.Class) -> bool:
    """Whether *cls* is a built-in leaf of a robot or derived from Process."""
    return cls.path.startswith(LEAVES) or any(base.path == PROCESS for base in bases(cls))


def is_enum(cls: griffe.Class) -> bool:
    return any(str(base).rpartition(".")[2] in ("Enum", "IntEnum", "Flag", "StrEnum") for base in cls.bases)


def is_explained(attribute: griffe.Attribute) -> bool:
    """Whether an attribute or a constant is documented."""
    parent = attribute.parent
    if attribute.docstring is not None:
        return True
    if parent.is_module:
        type_variable = str(attribute.value).startswith("TypeVar(")
        return type_variable or (parent.path.startswith(TABLES) and attribute.name.isupper())
    return (
        is_enum(parent)
        or is_run_only(parent)
        or parent.path.startswith(NAV2_PARAMETERS)
        or explains(parent, attribute.name)
        or bool(overridden(attribute))
    )


def raised(function: griffe.Function) -> set[str]:
    """Return the names of the exceptions that the statements of *function* raise."""
    found = set()

    def visit(node: ast.AST) -> None:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.FunctionDef | ast.Lambda | ast.ClassDef):
                continue
            if isinstance(child, ast.Raise) and child.exc is not None:
                called = child.exc.func if isinstance(child.exc, ast.Call) else child.exc
                found.add(ast.unparse(called).rpartition(".")[2])
            visit(child)

    visit(ast.parse(textwrap.dedent("\n".join(function.lines))).body[0])
    # A lower-case name is a variable or a function that creates the exception.
    return {name for name in found if name[0].isupper()} - {"AssertionError", "NotImplementedError"}


def test_every_name_has_a_docstring() -> None:
    assert [path for path, it in CLASSES + FUNCTIONS if it.docstring is None] == []


def test_every_attribute_is_explained() -> None:
    assert [path for path, it in ATTRIBUTES if not is_explained(it)] == []


def test_docstrings_list_the_parameters() -> None:
    missing = []
    for path, it in FUNCTIONS:
        listed = {entry.name.lstrip("*") for entry in sections(it, "parameters")}
        names = [parameter.name for parameter in it.parameters if parameter.name not in ("self", "cls")]
        inherited = it.parent.is_class and bool(overridden(it))
        if len(names) > 1 and not inherited:
            missing += [f"{path}({name})" for name in names if name not in listed]
        missing += [f"{path}({name}) does not exist" for name in listed if name not in names]
    for path, it in CLASSES:
        init = it.members.get("__init__")
        hidden = path.startswith(NAV2_PARAMETERS) or is_run_only(it)
        if init is not None and not init.is_alias and not hidden:
            names = [parameter.name for parameter in init.parameters if parameter.name != "self"]
            missing += [f"{path}({name})" for name in names if len(names) > 1 and not explains(it, name)]
    assert missing == []


def test_docstrings_describe_the_result() -> None:
    missing = []
    for path, it in FUNCTIONS:
        text = it.docstring.value
        has_section = bool([*sections(it, "returns"), *sections(it, "yields")])
        says_so = re.search(r"\b(return(s|ed)?|yields?|iterate|whether)\b", text, re.IGNORECASE)
        inherited = it.parent.is_class and bool(overridden(it))
        if str(it.returns) not in ("None", "NoReturn") and not (has_section or says_so or inherited):
            missing.append(path)
    assert missing == []


def test_docstrings_list_the_exceptions() -> None:
    missing = []
    for path, it in FUNCTIONS:
        listed = {str(entry.annotation).rpartition(".")[2] for entry in sections(it, "raises")}
        undocumented = raised(it) - listed
        if not any(overridden(it) if it.parent.is_class else []):
            missing += [f"{path}: {name}" for name in undocumented]
    assert missing == []


def test_docstrings_are_markdown() -> None:
    rst = re.compile(r":[a-z]+:`|(?<!`)``(?!`)|::$", re.MULTILINE)
    assert [path for path, it in PUBLIC if it.docstring and rst.search(it.docstring.value)] == []


def test_the_index_lists_the_names_of_the_engine() -> None:
    assert sorted(sum(api_pages.GROUPS.values(), ())) == sorted(btcore.__all__)
