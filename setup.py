"""The compiled build of the engine: mypyc over its hot modules, one group, all or nothing.

``BTCORE_PURE=1`` builds without it; ``BTCORE_COMPILED=1`` makes its failure the install's failure.
Without either, a machine where the C compiler is missing or broken gets the pure build: the same
source, slower. A development install (``pip install -e``) is always pure, since a compiled file
would hide the source beside it.
"""

import os
import sys
import sysconfig
from pathlib import Path
from typing import Any

from setuptools import Extension, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build import build
from setuptools.command.build_ext import build_ext
from setuptools.command.build_py import build_py
from setuptools.command.editable_wheel import editable_wheel

HERE = Path(__file__).parent
GROUP = "btcore"

# The import packages' parent folders; pyproject.toml names the same.
ROOTS = (".", "monitor", "robot_nodes", "sim")
# Folders of data that belong to btcore: beside it in a checkout, inside it where it is installed.
DATA = ("benchmarks", "trees")

# Modules that run once, or only talk to people, stay interpreted. So does every __init__.py, and
# btcore/builds.py,
# which chooses the build.
COLD_FOLDERS = {"cli", "loading", "logs", "registry", "sweep", "testing", "xml"}
COLD_FILES = {
    "__init__.py",
    "btcore/__main__.py",
    "btcore/builds.py",
    "btcore/bundled_trees.py",
    "btcore/diagnostic_codes.py",
    "btcore/errors.py",
    "btcore/flatbuffer.py",
    "btcore/names.py",
    "btcore/program_runner.py",
    "btcore/run_extension.py",
    "btcore/suggestions.py",
    "btcore/tree/hooks.py",
    "btcore/tree/tick_thread.py",
    "btcore/engine/signature.py",
    "btcore/nodes/manual_selector.py",  # it has an __init__, whose parameters compiled code does not tell
    # Of a batch, what users call and derive from.
    "btcore/batch/blackboard.py",
    "btcore/batch/leaf_declaration.py",
    "btcore/batch/compile.py",
    "btcore/batch/tree.py",
}
# Compiled all the same: what every node of a document passes through while it is loaded.
HOT_FILES = {
    "btcore/registry/substitution.py",
    "btcore/xml/read/element.py",
    "btcore/xml/plan/structure_checks.py",
    "btcore/xml/plan/plan.py",
    "btcore/xml/build.py",
}


def says(variable: str) -> bool:
    """Whether the environment's *variable* says yes."""
    return os.environ.get(variable, "0") not in ("", "0")


def wanted() -> bool:
    """Whether this command is to compile at all."""
    if says("BTCORE_PURE"):
        return False
    # mypyc is made for CPython, and what it makes relies on the interpreter's lock.
    if sys.implementation.name != "cpython" or sysconfig.get_config_var("Py_GIL_DISABLED"):
        return False
    return not {"editable_wheel", "develop", "sdist", "egg_info", "dist_info"} & set(sys.argv)


def must_compile() -> bool:
    """Whether a build without compiled modules counts as a failure."""
    return says("BTCORE_COMPILED")


def hot_modules() -> list[str]:
    """The engine's source files that are compiled."""
    files = [path.relative_to(HERE) for path in sorted((HERE / "btcore").rglob("*.py"))]
    return [
        str(file)
        for file in files
        if file.as_posix() in HOT_FILES
        or not (COLD_FILES & {file.name, file.as_posix()} or COLD_FOLDERS & set(file.parts))
    ]


def extensions() -> list[Extension]:
    """The hot modules as C extensions, or nothing where mypyc can't make them."""
    if not wanted():
        return []
    try:
        from mypyc.build import mypycify

        made: list[Any] = mypycify(
            ["--follow-imports=silent", "--no-warn-unused-configs", *hot_modules()],
            # -O1 compiles in half the time of -O3, and ticks as fast within the noise (docs/performance.md).
            opt_level=os.environ.get("BTCORE_OPT_LEVEL", "1"),
            debug_level="0",
            group_name=GROUP,
        )
    except (Exception, SystemExit) as error:
        if must_compile():
            raise
        told(f"mypyc can't translate the engine ({error})")
        return []
    for extension in made:
        # Another compiler's new warning is no reason to go without the compiled build.
        extension.extra_compile_args = [
            flag for flag in extension.extra_compile_args if flag not in ("-Werror", "/WX")
        ]
    return made


def told(reason: str) -> None:
    """Say why this is the pure build."""
    print(f"warning: {reason}: this is the pure build of btcore", file=sys.stderr)


# --- commands


class Build(build):
    """Takes what an earlier build left out of the folder that is installed from."""

    def run(self) -> None:
        """Build, then remove each file of our packages that this build did not make."""
        super().run()
        parts: list[Any] = [self.get_finalized_command(name) for name in self.get_sub_commands()]
        made = {Path(file).resolve() for part in parts for file in part.get_outputs()}
        folder = Path(self.build_lib)
        for package in {name.partition(".")[0] for name in self.distribution.packages or ()}:
            for file in [*folder.joinpath(package).rglob("*"), *folder.glob(package + "__mypyc.*")]:
                if file.is_file() and file.resolve() not in made:
                    file.unlink()


class BuildWithData(build_py):
    """Copies the folders of data into the package."""

    def run(self) -> None:
        """Build the packages, then copy the data; an editable install finds them beside the package."""
        super().run()
        if not self.editable_mode:
            for source, target in self._data():
                target.parent.mkdir(parents=True, exist_ok=True)
                self.copy_file(str(source), str(target))

    def get_outputs(self, include_bytecode: bool = True) -> list[str]:
        """Return the paths of everything that this command makes, the data included."""
        return [*super().get_outputs(include_bytecode), *(str(target) for _, target in self._data())]

    def _data(self) -> list[tuple[Path, Path]]:
        into = Path(self.build_lib, "btcore")
        files = [path for folder in DATA for path in sorted((HERE / folder).rglob("*"))]
        return [(path, into / path.relative_to(HERE)) for path in files if path.suffix in {".py", ".xml"}]


class EditableRoots:
    """Makes an editable install of a plain ``.pth`` file that lists the parent folders of the packages.

    setuptools' own import hook for several folders comes too late in sys.meta_path where a folder beside
    the script is called btcore, and type checkers do not follow it.
    """

    def __enter__(self) -> "EditableRoots":
        return self

    def __exit__(self, *_: object) -> None: ...

    def __call__(self, wheel: Any, files: list[str], mapping: dict[str, str]) -> None:
        """Write the ``.pth`` file into *wheel*."""
        wheel.writestr("__editable__.btcore.pth", "".join(f"{(HERE / root).resolve()}\n" for root in ROOTS))


class Editable(editable_wheel):
    """Installs by :class:`EditableRoots` in every mode."""

    def _select_strategy(self, *_: object) -> Any:
        return EditableRoots()


class AllOrNothing(build_ext):
    """Removes what was built when a part failed: a module's shim without its group can't be imported."""

    def run(self) -> None:
        """Build every extension; at the first that fails give all of them up."""
        try:
            super().run()
        except Exception as error:
            if must_compile():
                raise
            for extension in self.extensions:
                Path(self.get_ext_fullpath(extension.name)).unlink(missing_ok=True)
            self.extensions.clear()
            told(f"the C compiler failed ({str(error) or type(error).__name__})")


class Wheel(bdist_wheel):
    """Tags a wheel by what is in it: one for every Python when nothing was compiled."""

    def run_command(self, command: str) -> None:
        """Run *command*; once the build is done it is known whether there are extensions."""
        super().run_command(command)
        if command == "build":
            self.root_is_pure = not self.distribution.has_ext_modules()


if __name__ == "__main__":
    if says("BTCORE_PURE") and must_compile():
        sys.exit("BTCORE_PURE=1 and BTCORE_COMPILED=1 contradict each other: set one of them")
    setup(
        ext_modules=extensions(),
        cmdclass={
            "build": Build,
            "build_py": BuildWithData,
            "build_ext": AllOrNothing,
            "bdist_wheel": Wheel,
            "editable_wheel": Editable,
        },
    )
