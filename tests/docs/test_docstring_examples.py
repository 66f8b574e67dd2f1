"""The examples in the docstrings run, and every public name of the main modules has an example."""

import doctest
import importlib
import sys
from pathlib import Path

import pytest

import btcore
from btcore import builds

ROOT = Path(__file__).parents[2]
pytest.importorskip("griffe")
sys.path.insert(0, str(ROOT / "docs" / "site"))

import api_pages  # noqa: E402

PACKAGES = [path.parent for parent in api_pages.PARENTS for path in parent.glob("btcore*/__init__.py")]
SOURCES = [path for package in PACKAGES for path in package.rglob("*.py")]
FILES = sorted(path for path in SOURCES if ">>> " in path.read_text(encoding="utf-8"))
OPTIONS = doctest.ELLIPSIS | doctest.REPORT_ONLY_FIRST_FAILURE

pytestmark = pytest.mark.skipif(
    builds.active_build() == "compiled", reason="mypyc leaves docstrings out of compiled code"
)


# The modules of which every class and function has an example, apart from exception classes …
WITH_EXAMPLES = ("btcore.", "btcore_monitor.breakpoints", "btcore_monitor.events", "btcore_monitor.serve",
                 "btcore_monitor.watch")  # fmt: skip
# … and these, which another example shows.
SHOWN_BY = {
    "btcore.Direction": "btcore.Port",
    "btcore.Transitions": "btcore.Observer",
    "btcore.batch.BatchBlackboard": "btcore.batch.BatchTree",
    "btcore.batch.NodeName": "btcore.batch.action",
    "btcore.batch.condition": "btcore.batch.BatchTree",
    "btcore.bundled_trees.folder": "btcore.bundled_trees.find",
    "btcore.loading.json_export.import_blackboard": "btcore.loading.json_export.export_blackboard",
    "btcore.loading.json_export.import_tree": "btcore.loading.json_export.export_tree",
    "btcore.logs.Divergence": "btcore.logs.find_divergence",
    "btcore.logs.Log": "btcore.logs.BtLog",
    "btcore.logs.LoggedTransition": "btcore.logs.read_log",
    "btcore.logs.NodeStatistics": "btcore.logs.TreeObserver",
    "btcore.logs.RecordedNode": "btcore.logs.read_log",
    "btcore.logs.RecordedStatistics": "btcore.logs.recorded_statistics",
    "btcore.logs.Recording": "btcore.logs.read_log",
    "btcore.logs.Session": "btcore.logs.SqliteLog",
    "btcore.logs.Step": "btcore.logs.find_divergence",
    "btcore.logs.read_btlog": "btcore.logs.read_log",
    "btcore.logs.sessions": "btcore.logs.SqliteLog",
    "btcore.logs.steps": "btcore.logs.find_divergence",
    "btcore.testing.CallLog": "btcore.testing.PlanAction",
    "btcore.testing.MockAction": "btcore.testing.Outcomes",
    "btcore.testing.MockCondition": "btcore.testing.Outcomes",
    "btcore.testing.StatusChange": "btcore.testing.Trace",
    "btcore.testing.TestNode": "btcore.testing.TestNodeConfig",
    "btcore.testing.TraceStep": "btcore.testing.Trace",
    "btcore.testing.outcomes": "btcore.testing.trees",
    "btcore.testing.action_plans": "btcore.testing.trees",
    "btcore.testing.blackboards": "btcore.testing.trees",
    "btcore.testing.sync_plans": "btcore.testing.trees",
    "btcore.testing.xml_documents": "btcore.testing.trees",
    "btcore.tree.hooks.Hook": "btcore.tree.hooks.Hooks",
    "btcore.tree.hooks.HookMode": "btcore.tree.hooks.Hooks",
    "btcore.tree.hooks.HookPosition": "btcore.tree.hooks.Hooks",
    "btcore.values.RealType": "btcore.values.IntegerType",
    "btcore_monitor.breakpoints.RequestedHook": "btcore_monitor.breakpoints.BreakpointClient",
    "btcore_monitor.events.ObservedNode": "btcore_monitor.events.ObservedTree",
    "btcore_monitor.events.TreeSeen": "btcore_monitor.watch.feed.Feed",
    "btcore_monitor.serve.Publisher": "btcore_monitor.serve.serve",
}
# … or these, for other reasons.
PROGRAM = "run by `btcore run` and its commands; docs/guides/your_robot.md has a complete program"
EVENT = "the feed creates it; an example would only repeat the attributes"
WITHOUT = {
    "btcore.batch.BatchNode": "a tree creates its nodes",
    "btcore.builds.compiled_modules": "raises an exception without the compiled build",
    "btcore.logs.Gap": "part of a damaged file",
    "btcore.logs.read_fbl": "no code of the project writes files of format 3's logger",
    "btcore.program_runner.FiniteRange": PROGRAM,
    "btcore.program_runner.GatheredResources": PROGRAM,
    "btcore.program_runner.ProgramResult": PROGRAM,
    "btcore.program_runner.RunCommand": PROGRAM,
    "btcore.program_runner.print_result": PROGRAM,
    "btcore.program_runner.require_resources": PROGRAM,
    "btcore.program_runner.run_program": PROGRAM,
    "btcore.xml.models.tree_nodes_model.subtree_models": "its parameters are parts of the loader",
    "btcore.values.PortDirection": "an enum that scripts use",
    "btcore.values.UserType": "a registry creates it for a class of the user",
    "btcore_monitor.breakpoints.HookReached": EVENT,
    "btcore_monitor.events.BlackboardSeen": EVENT,
    "btcore_monitor.events.ConnectionChanged": EVENT,
    "btcore_monitor.events.DataMissed": EVENT,
    "btcore_monitor.events.DataSource": EVENT,
    "btcore_monitor.events.ExceptionRaised": EVENT,
    "btcore_monitor.events.HooksFound": EVENT,
    "btcore_monitor.events.SceneMoving": EVENT,
    "btcore_monitor.events.SceneStatic": EVENT,
    "btcore_monitor.events.StatusChanged": EVENT,
    "btcore_monitor.events.Ticked": EVENT,
    "btcore_monitor.events.TransitionsLost": EVENT,
}


def module_name(path: Path) -> str:
    parent = next(parent for parent in api_pages.PARENTS[::-1] if path.is_relative_to(parent))
    return ".".join(path.relative_to(parent).with_suffix("").parts).removesuffix(".__init__")


def test_public_names_have_examples() -> None:
    source = api_pages.load_packages()
    missing, shown = [], set()
    names = [("btcore", name) for name in btcore.__all__]
    for module in api_pages.public_modules():
        if module.startswith(WITH_EXAMPLES):
            names += [(module, name) for name in api_pages.public_names(source[module])]
    for module, name in names:
        described = source[f"{module}.{name}"]
        if described.is_module or described.is_attribute or name.endswith("Error"):
            continue
        has_example = described.docstring is not None and ">>> " in described.docstring.value
        shown |= {f"{module}.{name}"} if has_example else set()
        missing += [] if has_example else [f"{module}.{name}"]
    assert sorted(set(missing)) == sorted({*SHOWN_BY, *WITHOUT})
    assert set(SHOWN_BY.values()) <= shown


@pytest.mark.parametrize("path", FILES, ids=module_name)
def test_examples_in_docstrings(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    module = importlib.import_module(module_name(path))
    # Without the globals of the module: an example imports what it uses.
    examples = doctest.DocTestFinder(exclude_empty=True).find(module, globs={"__name__": "__main__"})
    runner = doctest.DocTestRunner(optionflags=OPTIONS)
    for example in examples:
        runner.run(example)
    assert runner.tries
    assert runner.failures == 0
