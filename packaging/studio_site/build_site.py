"""Build the studio's site, which consists of static files: `make studio-site` runs this script.

Usage: build_site.py PARTS SITE. PARTS is a folder with the wheels of btcore and of what the language server
needs, and with the worker.js of the page. Pyodide is beside this script.
"""

import gzip
import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from btcore import Registry
from btcore.entry_points import LIMIT_VARIABLE
from btcore_drawing.svg import drawing_style
from btcore_studio.language.node_models import models_of

ROOT: Final = Path(__file__).parents[2]
NPM: Final = ROOT / ".ci" / "npm"
PAGE: Final = ROOT / "tools" / "btcore_studio" / "page" / "built"
PYODIDE: Final = Path(__file__).parent / "node_modules" / "pyodide"
PYODIDE_FILES: Final = ("pyodide.mjs", "pyodide.asm.mjs", "pyodide.asm.wasm", "pyodide-lock.json")
STANDARD_LIBRARY: Final = "python_stdlib.zip"
UNUSED: Final = {
    # They need packages that Pyodide does not have, or a robot.
    *("btcore_bags", "btcore_batch", "btcore_monitor", "btcore_navigation", "btcore_robot", "btcore_ros2"),
    *("btcore_scene", "btcore_sim", "btcore_sweep"),
}
UNUSED_PARTS: Final = ("btcore/docs/", "btcore_studio/page/", "btcore_studio/agents/")
MAX_SIZE: Final = 25_000_000
"""Maximum size of the site as a server that compresses sends it (bytes)."""


def unpack(wheel: Path, folder: Path) -> None:
    """Unpack the used files of a wheel."""
    with zipfile.ZipFile(wheel) as archive:
        for name in archive.namelist():
            if name.partition("/")[0] not in UNUSED and not name.startswith(UNUSED_PARTS):
                archive.extract(name, folder)


def library_models() -> dict[str, object]:
    """Return the models of btcore's libraries and their enums, without the places in the source."""
    os.environ[LIMIT_VARIABLE] = "robot_nodes navigation nav2 ros2 ros2_nav2"
    nodes = Registry.standard()
    nodes.add_installed_libraries()
    models = [{**model.as_data(), "file": "", "line": 0} for model in models_of(nodes)]
    return {"models": models, "enums": nodes.types.enums}


def pack(folder: Path, archive: Path) -> None:
    """Pack the files of a folder for `load_python.mjs`. The same files make the same archive."""
    files = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    contents = [path.read_bytes() for path in files]
    index = [
        (path.relative_to(folder).as_posix(), len(content))
        for path, content in zip(files, contents, strict=True)
    ]
    archive.write_bytes(
        gzip.compress(b"\n".join([json.dumps(index).encode(), b"".join(contents)]), 9, mtime=0)
    )


def pack_standard_library(folder: Path, archive: Path) -> None:
    """Write the compiled modules of Python's standard library: the archive of Pyodide has the sources."""
    with zipfile.ZipFile(PYODIDE / STANDARD_LIBRARY) as sources:
        sources.extractall(folder)
    compile_files(folder, "beside")
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as compiled:
        for path in sorted(folder.rglob("*.pyc")):
            # Without the time of the file: the same files make the same archive.
            entry = zipfile.ZipInfo(path.relative_to(folder).as_posix())
            compiled.writestr(entry, path.read_bytes(), zipfile.ZIP_DEFLATED)


def compile_files(folder: Path, *place: str) -> None:
    """Compile the Python files in a folder. `compile_modules.mjs` describes *place*."""
    command: list[str | Path] = [NPM, "run", "--silent", "compile", "--", folder.resolve(), *place]
    subprocess.run(command, cwd=Path(__file__).parent, check=True)


def main(parts: Path, site: Path) -> int:
    """Build the site. Return the exit code: 1 if it is too large."""
    shutil.rmtree(site, ignore_errors=True)
    python = site / "python"
    python.mkdir(parents=True)
    modules = parts / "modules"
    shutil.rmtree(modules, ignore_errors=True)
    for wheel in sorted(parts.glob("*.whl")):
        unpack(wheel, modules)
    (modules / "btcore_studio" / "site" / "models.json").write_text(
        json.dumps(library_models()), encoding="utf-8", newline="\n"
    )
    compile_files(modules)
    pack(modules, python / "modules.bin")
    with TemporaryDirectory() as folder:
        pack_standard_library(Path(folder), python / STANDARD_LIBRARY)
    for name in PYODIDE_FILES:
        shutil.copy(PYODIDE / name, python)
    shutil.copy(Path(__file__).with_name("load_python.mjs"), python)
    shutil.copy(PAGE / "studio.js", site)
    shutil.copy(parts / "worker.js", site)
    style = (PAGE / "studio.css").read_text(encoding="utf-8")
    (site / "studio.css").write_text(drawing_style() + style, encoding="utf-8", newline="\n")
    shutil.copy(Path(__file__).with_name("index.html"), site)
    size = sum(len(gzip.compress(path.read_bytes(), 6)) for path in site.rglob("*") if path.is_file())
    print(f"  {site / 'index.html'}: {size / 1e6:.1f} MB compressed")
    if size > MAX_SIZE:
        print(f"error: the site has more than {MAX_SIZE / 1e6:.0f} MB", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2])))
