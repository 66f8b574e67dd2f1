"""The API reference describes every public name: parameters, results, errors and attributes."""

import ast
import re
import sys
import textwrap
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import btcore
from btcore.diagnostic_codes import ALL_CODES

ROOT = Path(__file__).parents[2]
griffe = pytest.importorskip("griffe")
sys.path.insert(0, str(ROOT / "docs" / "site"))

import api_pages  # noqa: E402


@cache
def source() -> griffe.ModulesCollection:
    """Return the source of all packages; reading it takes 4 s, which no other test needs."""
    return api_pages.load_packages()


# Modules whose constants are a table: their pages show the values, the class of the values explains them.
TABLES = ("btcore.diagnostic_codes", "btcore.values", "btcore_monitor.events")
# Nav2's documentation explains the parameters; the pages show their names, types and defaults.
NAV2_PARAMETERS = "btcore_navigation.parameters"
# Leaves and components are run, not called: their pages describe the ports and the topics, and hide all else.
LEAVES = ("btcore_navigation.leaves", "btcore_robot.leaves")
COMPONENT = "btcore_robot.components.component.Component"


def public_objects() -> Iterator[tuple[str, griffe.Object]]:
    """Yield the public names with their paths, as a user writes them, and the members of public classes."""
    seen = set()
    listed = [("btcore", btcore.__all__)]
    listed += [(name, api_pages.public_names(source()[name])) for name in api_pages.public_modules()[1:]]
    for module, names in listed:
        for name in names:
            described = source()[f"{module}.{name}"]
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


@cache
def public() -> list[tuple[str, griffe.Object]]:
    return list(public_objects())


def classes() -> list[tuple[str, griffe.Object]]:
    return [(path, it) for path, it in public() if it.is_class]


def functions() -> list[tuple[str, griffe.Object]]:
    return [(path, it) for path, it in public() if it.is_function and not it.path.startswith(LEAVES)]


def attributes() -> list[tuple[str, griffe.Object]]:
    return [(path, it) for path, it in public() if it.is_attribute]


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
    """Whether *cls* is a built-in leaf of a robot or derived from Component."""
    return cls.path.startswith(LEAVES) or any(base.path == COMPONENT for base in bases(cls))


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
    assert [path for path, it in classes() + functions() if it.docstring is None] == []


def test_every_attribute_is_explained() -> None:
    assert [path for path, it in attributes() if not is_explained(it)] == []


def test_sections_of_attributes_are_complete() -> None:
    missing = []
    for path, it in attributes():
        described = {
            entry.name for kind in ("attributes", "parameters") for entry in sections(it.parent, kind)
        }
        has_section = any(True for _ in sections(it.parent, "attributes"))
        inherited = it.parent.is_class and any(explains(base, it.name) for base in bases(it.parent))
        elsewhere = it.docstring is not None or inherited or (it.parent.is_class and bool(overridden(it)))
        if has_section and not elsewhere and it.name not in described and not is_run_only(it.parent):
            missing.append(path)
    assert missing == []


def refers_to_another(it: griffe.Object) -> bool:
    """Return whether the docstring says whose parameters and exceptions the function has, too."""
    return "The other parameters and the exceptions are those of `" in it.docstring.value


def test_docstrings_list_the_parameters() -> None:
    missing = []
    for path, it in functions():
        listed = {entry.name.lstrip("*") for entry in sections(it, "parameters")}
        names = [parameter.name for parameter in it.parameters if parameter.name not in ("self", "cls")]
        inherited = it.parent.is_class and bool(overridden(it))
        if len(names) > 1 and not inherited and not refers_to_another(it):
            missing += [f"{path}({name})" for name in names if name not in listed]
        missing += [f"{path}({name}) does not exist" for name in listed if name not in names]
    for path, it in classes():
        init = it.members.get("__init__")
        hidden = path.startswith(NAV2_PARAMETERS) or is_run_only(it)
        if init is not None and not init.is_alias and not hidden:
            names = [parameter.name for parameter in init.parameters if parameter.name != "self"]
            missing += [f"{path}({name})" for name in names if len(names) > 1 and not explains(it, name)]
    assert missing == []


def test_docstrings_describe_the_result() -> None:
    missing = []
    for path, it in functions():
        text = it.docstring.value
        has_section = bool([*sections(it, "returns"), *sections(it, "yields")])
        says_so = re.search(r"\b(return(s|ed)?|yields?|iterate|whether)\b", text, re.IGNORECASE)
        inherited = it.parent.is_class and bool(overridden(it))
        if str(it.returns) not in ("None", "NoReturn") and not (has_section or says_so or inherited):
            missing.append(path)
    assert missing == []


def test_docstrings_list_the_exceptions() -> None:
    missing = []
    for path, it in functions():
        listed = {str(entry.annotation).rpartition(".")[2] for entry in sections(it, "raises")}
        undocumented = raised(it) - listed
        if not refers_to_another(it) and not any(overridden(it) if it.parent.is_class else []):
            missing += [f"{path}: {name}" for name in undocumented]
    assert missing == []


def test_summaries_have_one_line() -> None:
    # The summary tables show the first line only.
    found = [(path, it.docstring.value) for path, it in public() if it.docstring is not None]
    assert [path for path, text in found if text.partition("\n\n")[0].count("\n")] == []


def test_docstrings_are_markdown() -> None:
    rst = re.compile(r":[a-z]+:`|(?<!`)``(?!`)|::$", re.MULTILINE)
    assert [path for path, it in public() if it.docstring and rst.search(it.docstring.value)] == []


def test_the_index_lists_the_names_of_the_engine() -> None:
    assert sorted(sum(api_pages.GROUPS.values(), ())) == sorted(btcore.__all__)


# --- examples

# The modules of which every class and function has an example, apart from exception classes …
WITH_EXAMPLES = ("btcore.", "btcore_batch", "btcore_proof", "btcore_recorder",
                 "btcore_monitor.breakpoints", "btcore_monitor.events", "btcore_monitor.logs",
                 "btcore_monitor.serve", "btcore_monitor.watch")  # fmt: skip
# … and these, which another example shows.
SHOWN_BY = {
    "btcore.Direction": "btcore.Port",
    "btcore.FAILURE": "btcore.Status",
    "btcore.IDLE": "btcore.Status",
    "btcore.RUNNING": "btcore.Status",
    "btcore.RunSettings": "btcore.Run",
    "btcore.option": "btcore.Settings",
    "btcore.SKIPPED": "btcore.Status",
    "btcore.SUCCESS": "btcore.Status",
    "btcore.Transitions": "btcore.Observer",
    "btcore_batch.BatchBlackboard": "btcore_batch.BatchTree",
    "btcore_batch.NodeName": "btcore_batch.action",
    "btcore_batch.condition": "btcore_batch.BatchTree",
    "btcore.bundled_trees.folder": "btcore.bundled_trees.find",
    "btcore.loading.json_export.import_blackboard": "btcore.loading.json_export.export_blackboard",
    "btcore.loading.json_export.import_tree": "btcore.loading.json_export.export_tree",
    "btcore.logs.Log": "btcore.logs.BtLog",
    "btcore.logs.LoggedTransition": "btcore.logs.read_log",
    "btcore.logs.RecordedNode": "btcore.logs.read_log",
    "btcore.logs.Recording": "btcore.logs.read_log",
    "btcore.logs.read_btlog": "btcore.logs.read_log",
    "btcore_proof.Answer": "btcore_proof.prove",
    "btcore_proof.Counterexample": "btcore_proof.prove",
    "btcore_proof.LeafTick": "btcore_proof.prove",
    "btcore_proof.Report": "btcore_proof.prove",
    "btcore_proof.RunTick": "btcore_proof.prove",
    "btcore_recorder.Answer": "btcore_recorder.Explainer",
    "btcore_recorder.Difference": "btcore_recorder.Replay",
    "btcore_recorder.Divergence": "btcore_recorder.find_divergence",
    "btcore_recorder.FileRecorder": "btcore_recorder.record",
    "btcore_recorder.Link": "btcore_recorder.Explainer",
    "btcore_recorder.NodeStatistics": "btcore_recorder.TreeObserver",
    "btcore_recorder.RecordedStatistics": "btcore_recorder.recorded_statistics",
    "btcore_recorder.Step": "btcore_recorder.find_divergence",
    "btcore_recorder.steps": "btcore_recorder.find_divergence",
    "btcore.testing.MockAction": "btcore.testing.Outcomes",
    "btcore.testing.MockCondition": "btcore.testing.Outcomes",
    "btcore.testing.StatusChange": "btcore.testing.Trace",
    "btcore.testing.TestNode": "btcore.testing.TestNodeConfig",
    "btcore.testing.TraceStep": "btcore.testing.Trace",
    "btcore.testing.outcomes": "btcore.testing.trees",
    "btcore.testing.blackboards": "btcore.testing.trees",
    "btcore.testing.xml_documents": "btcore.testing.trees",
    "btcore.tree.hooks.Hook": "btcore.tree.hooks.Hooks",
    "btcore.tree.hooks.HookMode": "btcore.tree.hooks.Hooks",
    "btcore.tree.hooks.HookPosition": "btcore.tree.hooks.Hooks",
    "btcore.values.RealType": "btcore.values.IntegerType",
    "btcore_monitor.breakpoints.RequestedHook": "btcore_monitor.breakpoints.BreakpointClient",
    "btcore_monitor.events.ObservedNode": "btcore_monitor.events.ObservedTree",
    "btcore_monitor.events.TreeEvent": "btcore_monitor.watch.feed.Feed",
    "btcore_monitor.logs.Session": "btcore_monitor.logs.SqliteLog",
    "btcore_monitor.logs.sessions": "btcore_monitor.logs.SqliteLog",
    "btcore_monitor.serve.Publisher": "btcore_monitor.serve.serve",
}
# … or these, for other reasons.
PROGRAM = "run by `btcore run` and its commands; docs/guides/your_resources.md has examples"
PROVIDER = "a parameter of providers; docs/guides/your_resources.md has examples"
EVENT = "the feed creates it; an example would only repeat the attributes"
WITHOUT = {
    "btcore_batch.BatchNode": "a tree creates its nodes",
    "btcore.builds.compiled_modules": "raises an exception without the compiled build",
    "btcore.logs.Gap": "part of a damaged file",
    "btcore_monitor.logs.read_fbl": "no code of the project writes files of format 3's logger",
    "btcore.program_runner.create_run": PROGRAM,
    "btcore.field_options.FiniteRange": PROGRAM,
    "btcore.program_runner.TreelessProgram": PROGRAM,
    "btcore.program_runner.ProviderCommand": PROGRAM,
    "btcore.program_runner.GivenSettings": PROGRAM,
    "btcore.program_runner.load_nodes": PROGRAM,
    "btcore.field_options.pass_options": PROGRAM,
    "btcore.program_runner.print_result": PROGRAM,
    "btcore.field_options.add_options": PROGRAM,
    "btcore.Report": PROVIDER,
    "btcore.Resources": PROVIDER,
    "btcore.values.PortDirection": "an enum that scripts use",
    "btcore.values.UserType": "a registry creates it for a class of the user",
    "btcore_monitor.breakpoints.HookReached": EVENT,
    "btcore_monitor.events.BlackboardEvent": EVENT,
    "btcore_monitor.events.ConnectionEvent": EVENT,
    "btcore_monitor.events.MissingDataEvent": EVENT,
    "btcore_monitor.events.DataSource": EVENT,
    "btcore_monitor.events.ExceptionEvent": EVENT,
    "btcore_monitor.events.HooksEvent": EVENT,
    "btcore_monitor.events.LeavesEvent": EVENT,
    "btcore_monitor.events.MovingSceneEvent": EVENT,
    "btcore_monitor.events.SavedSceneEvent": EVENT,
    "btcore_monitor.events.StaticSceneEvent": EVENT,
    "btcore_monitor.events.TransitionEvent": EVENT,
    "btcore_monitor.events.TickEvent": EVENT,
    "btcore_monitor.events.LostTransitionsEvent": EVENT,
}


def test_public_names_have_examples() -> None:
    missing, shown = [], set()
    names = [("btcore", name) for name in btcore.__all__]
    for module in api_pages.public_modules():
        if module.startswith(WITH_EXAMPLES):
            names += [(module, name) for name in api_pages.public_names(source()[module])]
    for module, name in names:
        described = source()[f"{module}.{name}"]
        if described.is_module or (described.is_attribute and module != "btcore") or name.endswith("Error"):
            continue
        has_example = described.docstring is not None and ">>> " in described.docstring.value
        shown |= {f"{module}.{name}"} if has_example else set()
        missing += [] if has_example else [f"{module}.{name}"]
    assert sorted(set(missing)) == sorted({*SHOWN_BY, *WITHOUT})
    assert set(SHOWN_BY.values()) <= shown


# --- the pages


def test_pages_show_constants_and_inherited_members(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(api_pages, "load_packages", source)  # read once
    api_pages.write_api_pages(tmp_path / "api")

    def page(name: str) -> str:
        return (tmp_path / "api" / f"{name}.md").read_text(encoding="utf-8")

    assert "- [`get_input`][btcore.TreeNode.get_input] – " in page("StatefulAction")
    assert "`on_start`" not in page("StatefulAction")  # its own member
    codes = page("btcore.diagnostic_codes")
    assert len(re.findall(r"^\| `[A-Z_0-9]+` \| `DiagnosticCode\(", codes, re.MULTILINE)) == len(ALL_CODES)
    assert "| `FAILED_TO_MAKE_PROGRESS` | `105` |" in page("btcore_navigation.error_codes")
    listed = page("index")
    assert all(f"[`{name}`]" in listed for name in btcore.__all__)
