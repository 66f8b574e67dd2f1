"""Which package and folder may import which, read from the source."""

import ast
import sys
from functools import cache
from pathlib import Path

import pytest

import btcore
from btcore_robot.robot import Robot

ROOT = Path(__file__).parent.parent
PARENTS = {
    "btcore": ".",
    "btcore_monitor": "monitor",
    "btcore_robot": "robot_nodes",
    "btcore_scene": "monitor",
    "btcore_sim": "sim",
}
# The engine's rooms from the ground floor up: a file imports from its own line and from those above it.
LAYERS = (
    {"status", "errors", "diagnostic_codes", "clock", "names", "suggestions", "builds", "flatbuffer"},
    {"values"},
    {"blackboard"},
    {"script"},
    {"engine"},
    {"nodes"},
    {"registry"},
    {"tree"},
    {"xml.read"},
    {"xml.models"},
    {"xml.plan"},
    {"xml.build"},
    {"xml.lint"},
    {"xml.convert"},
    {"xml.render"},
    {"xml.builder", "xml.schema"},
    {"loading"},
    {"logs"},
    {""},  # btcore/__init__.py
    {"testing"},
    {"batch"},
    {"run_extension", "bundled_trees"},
    {"cli", "__main__"},
    {"program_runner"},
    {"sweep"},
)
NAMELESS = {"utils", "util", "helpers", "helper", "common", "misc", "base", "manager"}


def module_name(path: Path, parent: Path) -> str:
    parts = path.relative_to(parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


SOURCES = {
    module_name(path, ROOT / parent): path
    for package, parent in PARENTS.items()
    for path in sorted((ROOT / parent / package).rglob("*.py"))
}


@cache
def imports(module: str, *, for_types: bool = False) -> set[str]:
    """The modules that *module* imports anywhere in its text; those for type checking only if asked for."""
    found: set[str] = set()
    pending: list[ast.AST] = [ast.parse(SOURCES[module].read_text(encoding="utf-8"))]
    while pending:
        node = pending.pop()
        if not for_types and isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            pending += node.orelse
            continue
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            source = origin(module, node)
            whole = [f"{source}.{alias.name}" for alias in node.names]
            found |= {name if name in SOURCES else source for name in whole}
        pending += ast.iter_child_nodes(node)
    return found


def origin(module: str, statement: ast.ImportFrom) -> str:
    """The absolute name of what *statement* imports from."""
    if not statement.level:
        return str(statement.module)
    package = module.split(".") if SOURCES[module].name == "__init__.py" else module.split(".")[:-1]
    here = package[: len(package) - statement.level + 1]
    return ".".join([*here, statement.module] if statement.module else here)


def offenders(importer: str, imported: str, *, but: tuple[str, ...] = ()) -> list[str]:
    """``importer → imported`` for every edge between two packages, *but* for importers below these."""
    return [
        f"{module} → {name}"
        for module in SOURCES
        if inside(module, importer) and not any(inside(module, one) for one in but)
        for name in imports(module)
        if inside(name, imported)
    ]


def inside(name: str, package: str) -> bool:
    return name == package or name.startswith(package + ".") or not package


def layer(module: str) -> int:
    rooms = module.split(".")[1:]
    names = {".".join(rooms[:1]), ".".join(rooms[:2])}
    if names == {"xml"}:
        return 0  # the package's docstring
    places = [rank for rank, rooms in enumerate(LAYERS) if names & rooms]
    assert places, f"{module}: give its folder a place in LAYERS"
    return places[0]


@pytest.mark.parametrize("stranger", ["btcore_monitor", "btcore_robot", "btcore_scene", "btcore_sim"])
def test_the_engine_does_not_know_the_packages_around_it(stranger: str) -> None:
    assert offenders("btcore", stranger) == []


def test_the_monitors_client_side_knows_nothing_of_the_engine() -> None:
    commands = (
        "btcore_monitor.run_extension",
        "btcore_monitor.commands.monitor",
        "btcore_monitor.log_writer",
        "btcore_monitor.commands.record",
        "btcore_monitor.commands.replay",
    )
    reached = offenders("btcore_monitor", "btcore", but=("btcore_monitor.serve", *commands))
    assert {edge.split(" → ")[1] for edge in reached} <= {"btcore.flatbuffer"}
    assert {name.split(".")[0] for name in imports("btcore.flatbuffer")} <= sys.stdlib_module_names
    assert offenders("btcore_monitor", "btcore_robot") + offenders("btcore_monitor", "btcore_sim") == []


def test_the_messages_of_a_scene_need_only_the_standard_library() -> None:
    assert {name.split(".")[0] for name in imports("btcore_scene")} <= set(sys.stdlib_module_names)


MAP = "btcore_robot.navigation.occupancy_map"


SHARED = (
    "btcore_robot.robot",
    "btcore_robot.rigid_transform",
    "btcore_robot.schedule",
    "btcore_robot.field_reader",
)


def test_the_body_knows_of_the_mind_only_the_robot_protocol_and_maps() -> None:
    assert (
        offenders("btcore_sim", "btcore")
        + offenders("btcore_sim", "btcore_monitor")
        + offenders("btcore_robot", "btcore_sim")
        == []
    )
    assert {edge.split(" → ")[1] for edge in offenders("btcore_sim", "btcore_robot")} <= {
        *SHARED,
        MAP,
    }
    for module in SHARED:
        assert strangers(module) <= {"numpy", "numpy.typing"}
    assert strangers(MAP) <= {"numpy", "numpy.typing", "cv2", "yaml"}
    assert imports("btcore_robot") == imports("btcore_robot.navigation") == set()


def strangers(module: str) -> set[str]:
    """What *module* imports, itself or by what it imports, that is neither ours nor Python's."""
    found: set[str] = set()
    for name in imports(module):
        if name in SOURCES:
            found |= strangers(name)
        elif name.split(".")[0] not in sys.stdlib_module_names:
            found.add(name)
    return found


def test_navigation_reaches_the_robot_by_its_protocol_alone() -> None:
    reached = {name for module in SOURCES if inside(module, "btcore_robot") for name in imports(module)}
    assert not any(
        inside(name, guest) for name in reached for guest in ("btcore_sim", "pybullet", "btcore_monitor")
    )
    promised = {name for name in vars(Robot) if not name.startswith("_")}
    assert not any("true" in name or name in {"place", "world", "contacts"} for name in promised)


SERVERS_WITH_TREES = ("btcore_robot.navigation.navigator", "btcore_robot.navigation.nodes")


def test_the_servers_of_the_robot_know_nothing_of_trees() -> None:
    for room in ("navigation", "control", "perception", "process"):
        assert offenders(f"btcore_robot.{room}", "btcore", but=SERVERS_WITH_TREES) == []


@pytest.mark.parametrize("package", ["btcore_monitor", "btcore_robot", "btcore_sim"])
def test_other_packages_import_nothing_of_the_command_line(package: str) -> None:
    assert offenders(package, "btcore.cli") == []


@pytest.mark.parametrize(("guest", "room"), [("rerun", "btcore_monitor.screen"), ("pybullet", "btcore_sim")])
def test_a_heavy_dependency_is_imported_in_one_package_only(guest: str, room: str) -> None:
    assert offenders("", guest, but=(room,)) == []


def test_inside_the_engine_imports_go_down_the_layers_only() -> None:
    upward = [
        f"{module} → {name}"
        for module in SOURCES
        if inside(module, "btcore")
        for name in imports(module)
        if inside(name, "btcore") and layer(name) > layer(module)
    ]
    assert upward == []


def test_no_module_imports_itself_by_a_detour() -> None:
    done: set[str] = set()

    def visit(module: str, trail: tuple[str, ...]) -> None:
        assert module not in trail, " → ".join([*trail[trail.index(module) :], module])
        if module not in done:
            for name in imports(module, for_types=True) & SOURCES.keys():
                visit(name, (*trail, module))
            done.add(module)

    for module in SOURCES:
        visit(module, ())


def test_a_built_in_node_imports_only_what_a_users_node_may() -> None:
    public = {*btcore._HOMES, "btcore.builds", "btcore.values"}
    for module in SOURCES:
        if inside(module, "btcore.nodes"):
            own = {name for name in imports(module) if inside(name, "btcore")}
            private = {name for name in own - public if not inside(name, "btcore.nodes")}
            assert private == set(), f"{module} imports what btcore/__init__.py doesn't offer"


def test_no_module_has_a_generic_name() -> None:
    assert [module for module in SOURCES if NAMELESS & set(module.split("."))] == []
