"""The compiled build of the engine: mypyc over its hot modules, one group, all or nothing.

``BTCORE_PURE=1`` builds without it; ``BTCORE_COMPILED=1`` makes its failure the install's failure.
Without either, a machine where the C compiler is missing or broken gets the pure build: the same
source, slower. A development install (``pip install -e``) is always pure, since a compiled file
hides the source beside it.
"""

import os
import sys
from pathlib import Path
from typing import Any

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

HERE = Path(__file__).parent
GROUP = "btcore"

# The cold part stays interpreted: what runs once, talks to people, or is the place where builds are chosen.
COLD_FOLDERS = {"batch", "cli", "logs", "sweep", "testing", "xml"}
COLD_FILES = {"__init__.py", "__main__.py", "builds.py", "errors.py", "names.py", "suggest.py"} | {
    "aside.py",
    "hooks.py",
    "declaration.py",
    "signature.py",
    "manifest.py",
    "registry.py",
    "manual.py",  # it has an __init__, whose parameters compiled code does not tell
}
# What every node of a document passes through while it is loaded.
HOT_FILES = {f"btcore/xml/{name}.py" for name in ("element", "node_plan", "shape", "plan", "build")}


def wanted() -> bool:
    """Whether this command is to compile at all."""
    if os.environ.get("BTCORE_PURE", "0") not in ("", "0"):
        return False
    return not {"editable_wheel", "develop", "sdist", "egg_info", "dist_info"} & set(sys.argv)


def must_compile() -> bool:
    """Whether a build without compiled modules counts as a failure."""
    return os.environ.get("BTCORE_COMPILED", "0") not in ("", "0")


def hot_modules() -> list[str]:
    """The engine's source files that are compiled."""
    files = [path.relative_to(HERE) for path in sorted((HERE / "btcore").rglob("*.py"))]
    return [
        str(file)
        for file in files
        if file.as_posix() in HOT_FILES
        or (file.name not in COLD_FILES and not COLD_FOLDERS & set(file.parts))
    ]


def extensions() -> list[Extension]:
    """The hot modules as C extensions, or nothing where mypyc can't make them."""
    if not wanted():
        return []
    try:
        from mypyc.build import mypycify

        made: list[Any] = mypycify(
            ["--follow-imports=silent", "--no-warn-unused-configs", *hot_modules()],
            opt_level=os.environ.get("BTCORE_OPT_LEVEL", "3"),
            group_name=GROUP,
        )
    except (ImportError, SystemExit) as error:
        if must_compile():
            raise
        print(f"warning: mypyc can't translate the engine ({error}): this is the pure build", file=sys.stderr)
        return []
    for extension in made:
        extension.optional = not must_compile()
    return made


class AllOrNothing(build_ext):
    """Removes what was built when a part failed: a module's shim without its group can't be imported."""

    def run(self) -> None:
        """Build every extension, then see whether every one is there."""
        super().run()
        files = [Path(self.get_ext_fullpath(extension.name)) for extension in self.extensions]
        if all(file.exists() for file in files):
            return
        for file in files:
            file.unlink(missing_ok=True)
        self.extensions.clear()
        print("warning: the C compiler failed: this is the pure build of btcore", file=sys.stderr)


setup(ext_modules=extensions(), cmdclass={"build_ext": AllOrNothing})
