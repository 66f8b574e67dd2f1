"""Compile the hot modules with mypyc, and install the packages and their data.

``BTCORE_PURE=1`` or ``BTCORE_COMPILED=0`` skips the compilation. ``BTCORE_COMPILED=1`` makes the installation
fail if the compilation fails. Without either variable, the pure build is installed where the C compiler is
missing or fails: the same source, slower. An editable install (``pip install -e``) is always pure, because a
compiled file would hide the source beside it.
"""

import os
import re
import sys
import sysconfig
import tomllib
from pathlib import Path
from typing import Any

from setuptools import Extension, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build import build
from setuptools.command.build_ext import build_ext
from setuptools.command.build_py import build_py
from setuptools.command.editable_wheel import editable_wheel

HERE = Path(__file__).parent

# The parent folders of the import packages, as in pyproject.toml.
ROOTS = (".", "monitor", "robot_nodes", "ros2", "sim", "tools")
# Data files of btcore, by folder: beside the package in a checkout, inside the package in an installation.
DATA = {"docs": "*.md", "trees": "*.xml"}

# The packages with compiled modules. Each is a group: calls between its modules are C calls.
GROUPS = {"btcore": "btcore", "btcore_batch": "tools/btcore_batch"}
# What is compiled, because a tick or the loading of every node passes through it: these files, and the files
# of these folders except __init__.py.
HOT = {
    "btcore/blackboard",
    "btcore/clock.py",
    "btcore/engine",
    "btcore/loading/instantiate.py",
    "btcore/nodes",
    "btcore/script",
    "btcore/status.py",
    "btcore/tree",
    "btcore/values",
    "btcore/xml/plan/tree_plan.py",
    "btcore/xml/plan/tree_planner.py",
    "btcore/xml/read/element.py",
    "tools/btcore_batch",
}
# Files of these folders that run once, or only for people, and some that cannot be compiled.
COLD = {
    "btcore/engine/node_spec.py",  # a dataclass that is a descriptor
    "btcore/engine/recorded_events.py",  # recordings are read by the types of its fields, which mypyc drops
    "btcore/engine/signature.py",
    "btcore/nodes/manual_selector.py",  # compiled code hides the parameters of its __init__
    "btcore/tree/drawing.py",
    "btcore/tree/hooks.py",
    "btcore/tree/tick_thread.py",
    # The classes of a batch that users call and subclass.
    "tools/btcore_batch/blackboard.py",
    "tools/btcore_batch/leaf_declaration.py",
    "tools/btcore_batch/tree.py",
}


def env_flag(variable: str) -> bool:
    """Return whether the environment *variable* is set, but not to 0."""
    return os.environ.get(variable, "0") not in ("", "0")


def should_compile() -> bool:
    """Return whether this command compiles, where that is possible."""
    if env_flag("BTCORE_PURE") or os.environ.get("BTCORE_COMPILED") == "0":
        return False
    # mypyc supports CPython only, and its code relies on the global interpreter lock.
    if sys.implementation.name != "cpython" or sysconfig.get_config_var("Py_GIL_DISABLED"):
        return False
    return not {"editable_wheel", "develop", "sdist", "egg_info", "dist_info"} & set(sys.argv)


def must_compile() -> bool:
    """Return whether the build fails if the modules cannot be compiled."""
    return env_flag("BTCORE_COMPILED")


def hot_modules(group: str) -> list[str]:
    """Return the source files of the package *group* that are compiled."""
    files = [path.relative_to(HERE) for path in sorted((HERE / GROUPS[group]).rglob("*.py"))]
    return [
        str(file)
        for file in files
        if file.name != "__init__.py"
        and file.as_posix() not in COLD
        and any(file.is_relative_to(hot) for hot in HOT)
    ]


def extensions() -> list[Extension]:
    """Return the hot modules as C extensions, or an empty list if mypyc fails."""
    if not should_compile():
        return []
    try:
        from mypyc.build import mypycify

        extensions: list[Any] = []
        for group in GROUPS:
            extensions += mypycify(
                ["--follow-imports=silent", "--no-warn-unused-configs", *hot_modules(group)],
                # -O1 compiles in a sixth less time, but ticks bump-and-go a tenth slower. -O3 makes no
                # measurable difference (`make bench`).
                opt_level=os.environ.get("BTCORE_OPT_LEVEL", "2"),
                debug_level="0",
                group_name=group,
            )
    except (Exception, SystemExit) as error:
        if must_compile():
            raise
        warn(f"mypyc failed ({error})")
        return []
    for extension in extensions:
        # Compilers differ in their warnings, so a warning must not fail the build.
        extension.extra_compile_args = [
            flag for flag in extension.extra_compile_args if flag not in ("-Werror", "/WX")
        ]
        if sys.platform != "win32":
            # Without alignment, the places of functions, which any change moves, make the benchmark's trees
            # up to 10 % faster or slower.
            extension.extra_compile_args += ["-falign-functions=64", "-falign-loops=32"]
            # This warning of -Wall takes GCC longer than compiling a file of 27 MB.
            extension.extra_compile_args.append("-Wno-misleading-indentation")
    return extensions


def warn(reason: str) -> None:
    """Print a warning that the pure build is installed, with the reason."""
    print(f"warning: {reason}: installing the pure build of btcore", file=sys.stderr)


def data_files() -> list[Path]:
    """Return the data files of btcore."""
    return [path for folder, names in DATA.items() for path in sorted((HERE / folder).rglob(names))]


def readme_with_absolute_links() -> str:
    """Return README.md for PyPI, where links to files and pictures of the repository must be absolute."""
    project = tomllib.loads((HERE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    repository = project["urls"]["Repository"]

    def absolute(link: re.Match[str]) -> str:
        return f"{link[0]}{repository}/{'raw' if link[1] else 'blob'}/main/"

    text = (HERE / "README.md").read_text(encoding="utf-8")
    return re.sub(r"(!?)\[[^\]]*\]\((?![a-z]+:|#)", absolute, text)


# --- commands


class Build(build):
    """Remove files of earlier builds from the build folder: they would be installed otherwise."""

    def run(self) -> None:
        """Build, then remove the files of our packages that this build did not create."""
        super().run()
        parts: list[Any] = [self.get_finalized_command(name) for name in self.get_sub_commands()]
        outputs = {Path(file).resolve() for part in parts for file in part.get_outputs()}
        folder = Path(self.build_lib)
        for package in {name.partition(".")[0] for name in self.distribution.packages or ()}:
            for file in [*folder.joinpath(package).rglob("*"), *folder.glob(package + "__mypyc.*")]:
                if file.is_file() and file.resolve() not in outputs:
                    file.unlink()


class BuildWithData(build_py):
    """Copy the data folders into the package."""

    def run(self) -> None:
        """Build the packages, then copy the data. An editable install finds the data beside the package."""
        super().run()
        if not self.editable_mode:
            for source, target in self._data():
                target.parent.mkdir(parents=True, exist_ok=True)
                self.copy_file(str(source), str(target))

    def get_outputs(self, include_bytecode: bool = True) -> list[str]:
        """Return the paths of all files that this command creates, including the data."""
        return [*super().get_outputs(include_bytecode), *(str(target) for _, target in self._data())]

    def _data(self) -> list[tuple[Path, Path]]:
        into = Path(self.build_lib, "btcore")
        return [(path, into / path.relative_to(HERE)) for path in data_files()]


class EditableRoots:
    """A strategy for editable installs: a plain ``.pth`` file with the parent folders of the packages.

    setuptools' own import hook comes too late in sys.meta_path if a folder beside the script is called
    btcore, and type checkers do not follow it.
    """

    def __enter__(self) -> "EditableRoots":
        return self

    def __exit__(self, *_: object) -> None: ...

    def __call__(self, wheel: Any, files: list[str], mapping: dict[str, str]) -> None:
        """Write the ``.pth`` file into *wheel*."""
        wheel.writestr("__editable__.btcore.pth", "".join(f"{(HERE / root).resolve()}\n" for root in ROOTS))


class Editable(editable_wheel):
    """Use :class:`EditableRoots` in every mode."""

    def _select_strategy(self, *_: object) -> Any:
        return EditableRoots()


class AllOrNothing(build_ext):
    """Remove all extensions if one fails: the extension of a module cannot be imported without its group."""

    def run(self) -> None:
        """Build the extensions. After the first failure, remove them all."""
        try:
            super().run()
        except Exception as error:
            if must_compile():
                raise
            for extension in self.extensions:
                Path(self.get_ext_fullpath(extension.name)).unlink(missing_ok=True)
            self.extensions.clear()
            warn(f"the C compiler failed ({str(error) or type(error).__name__})")


class Wheel(bdist_wheel):
    """Tag the wheel as independent of the Python version if nothing was compiled."""

    def run_command(self, command: str) -> None:
        """Run *command*. Only after the build it is known whether there are extensions."""
        super().run_command(command)
        if command == "build":
            self.root_is_pure = not self.distribution.has_ext_modules()


if __name__ == "__main__":
    if env_flag("BTCORE_PURE") and must_compile():
        sys.exit("BTCORE_PURE=1 and BTCORE_COMPILED=1 contradict each other: set one of them")
    setup(
        long_description=readme_with_absolute_links(),
        long_description_content_type="text/markdown",
        ext_modules=extensions(),
        cmdclass={
            "build": Build,
            "build_py": BuildWithData,
            "build_ext": AllOrNothing,
            "bdist_wheel": Wheel,
            "editable_wheel": Editable,
        },
    )
