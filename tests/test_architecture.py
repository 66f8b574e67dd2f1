"""Checks of the imports between packages and folders, read from the source code."""

import ast
import re
import sys
from functools import cache
from pathlib import Path

import pytest

import btcore
from btcore_robot.robot import Robot

ROOT = Path(__file__).parent.parent
PARENTS = {
    "btcore": ".",
    "btcore_bags": "tools",
    "btcore_batch": "tools",
    "btcore_drawing": "monitor",
    "btcore_monitor": "monitor",
    "btcore_navigation": "robot_nodes",
    "btcore_proof": "tools",
    "btcore_recorder": "tools",
    "btcore_robot": "robot_nodes",
    "btcore_ros2": "ros2",
    "btcore_scene": "monitor",
    "btcore_sim": "sim",
    "btcore_studio": "tools",
    "btcore_sweep": "tools",
}
# The tiers of the engine from the bottom up: a file imports from its own tier and from lower tiers.
TIERS = (
    {
        "status",
        "errors",
        "diagnostics",
        "diagnostic_codes",
        "documentation_site",
        "entry_points",
        "enum_members",
        "clock",
        "escaping",
        "exit_codes",
        "extras",
        "fixes",
        "names",
        "options",
        "suggestions",
        "typed_data",
        "builds",
        "input_files",
        "json_text",
        "output_files",
        "signals",
    },
    {"values", "blackboard", "script", "xml.read"},
    {"engine", "nodes", "registry"},
    {"xml"},
    {"tree", "loading", "lint", "logs", ""},  # "" is btcore/__init__.py
    {"testing", "bundled_trees", "runs", "cli", "field_options", "program_runner", "__main__"},
)
ROBOT_PACKAGES = ("btcore_navigation", "btcore_robot", "btcore_sim")
GENERIC_NAMES = {"utils", "util", "helpers", "helper", "common", "misc", "base", "manager"}


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
    """Return the modules that *module* imports; imports for type checking only if *for_types*."""
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
    """Return the absolute name of the module that *statement* imports from."""
    if not statement.level:
        return str(statement.module)
    package = module.split(".") if SOURCES[module].name == "__init__.py" else module.split(".")[:-1]
    here = package[: len(package) - statement.level + 1]
    return ".".join([*here, statement.module] if statement.module else here)


def violations(importer: str, imported: str, *, but: tuple[str, ...] = ()) -> list[str]:
    """Return ``importer → imported`` for each import between two packages, except for importers in *but*."""
    return [
        f"{module} → {name}"
        for module in SOURCES
        if inside(module, importer) and not any(inside(module, excluded) for excluded in but)
        for name in imports(module)
        if inside(name, imported)
    ]


def inside(name: str, package: str) -> bool:
    return name == package or name.startswith(package + ".") or not package


def tier(module: str) -> int:
    """Return the index of the tier of *module*: that of its folder, or of the folder within its folder."""
    packages = module.split(".")[1:]
    for package in (".".join(packages[:2]), ".".join(packages[:1])):
        for rank, names in enumerate(TIERS):
            if package in names:
                return rank
    raise AssertionError(f"{module}: give its folder a place in TIERS")


OTHERS = sorted(PARENTS.keys() - {"btcore"})


@pytest.mark.parametrize("package", OTHERS)
def test_engine_does_not_import_the_other_packages(package: str) -> None:
    assert violations("btcore", package) == []


TOOLS = [package for package, folder in PARENTS.items() if folder == "tools" and package != "btcore_bags"]


@pytest.mark.parametrize("tool", TOOLS)
def test_no_other_package_imports_a_tool(tool: str) -> None:
    assert violations("", tool, but=(tool,)) == []


def test_texts_of_the_engine_do_not_name_the_other_packages() -> None:
    named = re.compile(rf"\b({'|'.join(OTHERS)})\b")
    assert [
        f"{module}: {text}"
        for module in SOURCES
        if inside(module, "btcore")
        for text in texts(module)
        if named.search(text)
    ] == []


def texts(module: str) -> list[str]:
    """Return the texts in the code of *module*, without docstrings."""
    tree = ast.parse(SOURCES[module].read_text(encoding="utf-8"))
    ignored = {node.value for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    nodes = (node for node in ast.walk(tree) if node not in ignored)
    return [node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)]


def test_monitor_client_imports_only_basic_modules_of_the_engine() -> None:
    commands = (
        "btcore_monitor.__main__",
        "btcore_monitor.providers",
        "btcore_monitor.monitor_processes",
        "btcore_monitor.monitor_settings",
        "btcore_monitor.environment_checks",
        "btcore_monitor.live_extension",
        "btcore_monitor.client_options",
        "btcore_monitor.viewer_options",
        "btcore_monitor.commands.hook",
        "btcore_monitor.commands.monitor",
        "btcore_monitor.log_writer",
        "btcore_monitor.logs",
        "btcore_monitor.commands.record",
        "btcore_monitor.log_viewer",
    )
    reached = violations("btcore_monitor", "btcore", but=("btcore_monitor.serve", *commands))
    shared = {
        "btcore.errors",
        "btcore.escaping",
        "btcore.exit_codes",
        "btcore.extras",
        "btcore.output_files",
        "btcore.signals",
        "btcore.suggestions",
    }
    assert {edge.split(" → ")[1] for edge in reached} <= shared
    drawing = {edge.split(" → ")[1] for edge in violations("btcore_monitor", "btcore_drawing")}
    assert drawing == {f"btcore_drawing.{name}" for name in ("folding", "layout", "symbols")}
    for module in shared | drawing:
        assert third_party_imports(module) == set()
        assert all(tier(name) == 0 for name in imports(module) if inside(name, "btcore"))
    assert [
        violation for dependency in ROBOT_PACKAGES for violation in violations("btcore_monitor", dependency)
    ] == []


def test_log_formats_of_the_monitor_need_no_extra() -> None:
    assert third_party_imports("btcore_monitor.logs") <= {"mypy_extensions"}


def test_scene_messages_need_only_the_standard_library() -> None:
    assert {name.split(".")[0] for name in imports("btcore_scene")} <= set(sys.stdlib_module_names)


MAPS = ("btcore_robot.occupancy_map", "btcore_robot.waypoint_file")


SHARED = (
    "btcore_robot.command_multiplexer",
    "btcore_robot.robot",
    "btcore_robot.rigid_transform",
    "btcore_robot.scene_messages",
    "btcore_robot.schedule",
    "btcore_robot.data_files",
    "btcore_robot.urdf",
)


def test_simulation_imports_only_the_robot_protocol_and_maps() -> None:
    assert (
        violations("btcore_sim", "btcore_monitor")
        + violations("btcore_sim", "btcore_navigation")
        + violations("btcore_robot", "btcore_sim")
        == []
    )
    engine = violations("btcore_sim", "btcore", but=("btcore_sim.errors", "btcore_sim.providers"))
    reached = {edge.split(" → ")[1] for edge in engine}
    assert reached == {"btcore.clock", "btcore.suggestions", "btcore.typed_data"}
    assert {edge.split(" → ")[1] for edge in violations("btcore_sim", "btcore_robot")} <= {*SHARED, *MAPS}
    libraries = {"numpy", "numpy.typing", "msgspec", "mypy_extensions", "yaml"}
    for module in SHARED:
        assert third_party_imports(module) <= libraries
    for module in MAPS:
        assert third_party_imports(module) <= {*libraries, "cv2"}
    assert imports("btcore_robot") == set()


def third_party_imports(module: str) -> set[str]:
    """Return the third-party modules that *module* imports directly or indirectly."""
    found: set[str] = set()
    for name in imports(module):
        if name in SOURCES:
            found |= third_party_imports(name)
        elif name.split(".")[0] not in sys.stdlib_module_names:
            found.add(name)
    return found


def test_navigation_uses_the_robot_only_through_its_protocol() -> None:
    reached = {
        name
        for module in SOURCES
        if module.startswith(("btcore_robot", "btcore_navigation"))
        for name in imports(module)
    }
    assert not any(
        inside(name, dependency)
        for name in reached
        for dependency in ("btcore_sim", "pybullet", "btcore_monitor")
    )
    promised = {name for name in vars(Robot) if not name.startswith("_")}
    assert not any("true" in name or name in {"place", "world", "contacts"} for name in promised)


WITH_TREES = tuple(
    f"btcore_navigation.{name}" for name in ("drive_command", "leaves", "navigator", "nodes", "providers")
)


FILES_AND_ERRORS = {
    f"btcore.{name}"
    for name in ("clock", "errors", "input_files", "output_files", "suggestions", "typed_data")
}


def test_robot_servers_do_not_import_the_engine() -> None:
    for package in (
        "btcore_navigation",
        "btcore_robot.control",
        "btcore_robot.perception",
        "btcore_robot.components",
    ):
        found = violations(package, "btcore", but=WITH_TREES)
        assert {text.partition(" → ")[2] for text in found} <= FILES_AND_ERRORS


@pytest.mark.parametrize(
    "package",
    ["btcore_drawing", "btcore_monitor", "btcore_navigation", "btcore_robot", "btcore_ros2", "btcore_sim"],
)
def test_other_packages_do_not_import_the_command_line(package: str) -> None:
    assert violations(package, "btcore.cli", but=("btcore_drawing.command",)) == []


def test_robots_do_not_import_their_navigation() -> None:
    assert violations("btcore_robot", "btcore_navigation") == []


@pytest.mark.parametrize(
    ("dependency", "package"),
    [("rerun", "btcore_monitor.screen"), ("pybullet", "btcore_sim"), ("rclpy", "btcore_ros2")],
)
def test_a_heavy_dependency_is_imported_in_one_package_only(dependency: str, package: str) -> None:
    assert violations("", dependency, but=(package,)) == []


def test_engine_imports_follow_the_tiers() -> None:
    upward = [
        f"{module} → {name}"
        for module in SOURCES
        if inside(module, "btcore")
        for name in imports(module)
        if inside(name, "btcore") and tier(name) > tier(module)
    ]
    assert upward == []


def test_there_are_no_import_cycles() -> None:
    done: set[str] = set()

    def visit(module: str, trail: tuple[str, ...]) -> None:
        assert module not in trail, " → ".join([*trail[trail.index(module) :], module])
        if module not in done:
            for name in imports(module, for_types=True) & SOURCES.keys():
                visit(name, (*trail, module))
            done.add(module)

    for module in SOURCES:
        visit(module, ())


def test_built_in_nodes_import_only_the_public_api() -> None:
    public = {*btcore._HOMES, "btcore.builds", "btcore.escaping", "btcore.values"}
    for module in SOURCES:
        if inside(module, "btcore.nodes"):
            own = {name for name in imports(module) if inside(name, "btcore")}
            private = {name for name in own - public if not inside(name, "btcore.nodes")}
            assert private == set(), f"{module} imports what btcore/__init__.py doesn't offer"


def test_type_checkers_see_the_public_names_of_btcore() -> None:
    text = Path(btcore.__file__).read_text(encoding="utf-8")
    [block] = [node for node in ast.parse(text).body if isinstance(node, ast.If)]
    imported = [node for node in block.body if isinstance(node, ast.ImportFrom)]
    names = sorted((node.module, name.asname) for node in imported for name in node.names)
    assert names == sorted((module, name) for module, names in btcore._HOMES.items() for name in names)


def test_no_module_has_a_generic_name() -> None:
    assert [module for module in SOURCES if GENERIC_NAMES & set(module.split("."))] == []


# --- the tables in docs/architecture.md

PAGE = (ROOT / "docs/architecture.md").read_text(encoding="utf-8")


def names_in(cell: str) -> set[str]:
    """Return the words in backticks."""
    return set(re.findall(r"`([^`]*)`", cell))


def test_documented_tiers_are_the_checked_tiers() -> None:
    rows = re.findall(r"^\| (\d+) \| (.*?) \|", PAGE, re.MULTILINE)
    assert [int(number) for number, _ in rows] == list(range(1, len(TIERS) + 1))
    documented = [names_in(cell) for _, cell in rows]
    assert documented == [{name or "__init__" for name in names} for names in TIERS]


def test_documented_imports_of_the_packages_are_those_of_the_source() -> None:
    rows = re.findall(r"^\| `(btcore\w*)` \| `(\w+)/` \|(.*?)\|", PAGE, re.MULTILINE)
    assert {package: folder for package, folder, _ in rows} == {
        package: package if parent == "." else parent for package, parent in PARENTS.items()
    }
    found: dict[str, set[str]] = {package: set() for package in PARENTS}
    for module in SOURCES:
        package = module.partition(".")[0]
        reached = {name.partition(".")[0] for name in imports(module, for_types=True)}
        found[package] |= reached & PARENTS.keys() - {package}
    assert {package: names_in(cell) for package, _, cell in rows} == found


def test_diagram_and_its_omissions_show_the_imports_of_the_table() -> None:
    [diagram] = re.findall(r"^  bags .*", PAGE, re.MULTILINE)
    words = re.findall(r"\w+|◄─|─►", diagram)
    shown = {(words[i - 1], words[i + 1]) for i, word in enumerate(words) if word == "─►"}
    shown |= {(words[i + 1], words[i - 1]) for i, word in enumerate(words) if word == "◄─"}
    omissions = re.findall(r"^- `(\w+)` also imports (.*)\.$", PAGE, re.MULTILINE)
    shown |= {(package, name) for package, names in omissions for name in names_in(names)}
    rows = re.findall(r"^\| `btcore_(\w+)` \| `\w+/` \|(.*?)\|", PAGE, re.MULTILINE)
    listed = {(package, name.removeprefix("btcore_")) for package, cell in rows for name in names_in(cell)}
    assert shown == {(package, name) for package, name in listed if name not in ("btcore", "scene")}


def test_documented_methods_exist() -> None:
    words = {word for path in SOURCES.values() for word in re.findall(r"\w+", path.read_text("utf-8"))}
    named = re.findall(r"`([A-Z]\w+)\.(\w+)`", PAGE)
    assert len(named) > 10
    assert [names for names in named if not words.issuperset(names)] == []


def test_documented_generic_names_are_refused() -> None:
    sentence = re.search(r"No module is called ([\w, ]+)\.", (ROOT / "CONTRIBUTING.md").read_text("utf-8"))
    assert sentence is not None
    assert set(re.split(r", | or ", sentence[1])) <= GENERIC_NAMES


def test_documented_private_names_of_built_in_nodes_are_those_of_the_source() -> None:
    listed = (ROOT / "docs/reference/public_api.md").read_text(encoding="utf-8")
    public_modules = set(re.findall(r"^\| `(btcore\.[\w.]+)` \|", listed, re.MULTILINE))
    used = set()
    for path in (ROOT / "btcore/nodes").glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("btcore."):
                is_private = not (node.module or "").startswith(("btcore.nodes", *public_modules))
                used |= {name.name for name in node.names if is_private and name.name not in btcore.__all__}
    section = PAGE.partition("The built-in nodes are written like the nodes of users")[2]
    assert used == names_in(section.partition("\n\nA class and its file")[0])
