// Compile the Python files in a folder with the Python of Pyodide: the site starts faster.
// Usage: node compile_modules.mjs FOLDER [beside]. With "beside", FILE.py becomes FILE.pyc, as in archives.
import { loadPyodide } from "pyodide";

const [folder, place] = process.argv.slice(2);
const python = await loadPyodide();
python.FS.mkdir("/modules");
python.mountNodeFS("/modules", folder);
python.globals.set("replaces", place === "beside");
python.runPython(`
import py_compile
from pathlib import Path

for source in Path("/modules").rglob("*.py"):
    py_compile.compile(
        str(source),
        str(source.with_suffix(".pyc")) if replaces else None,
        dfile=str(source.relative_to("/modules")),
        doraise=True,
        # The times of the files are not kept.
        invalidation_mode=py_compile.PycInvalidationMode.UNCHECKED_HASH,
    )
    if replaces:
        source.unlink()
`);
