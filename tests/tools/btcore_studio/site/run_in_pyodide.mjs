// Run the function `main` of a Python file in the Pyodide of the built site, with the site's modules.
// Usage: node run_in_pyodide.mjs SITE FOLDER FILE [ARGUMENT ...]. FOLDER is the current folder of the function; FILE is in it.
import { readFileSync } from "node:fs";
import path from "node:path";
import { pathToFileURL } from "node:url";
import { gunzipSync } from "node:zlib";

const [site, folder, file, ...given] = process.argv.slice(2);
const indexURL = path.join(path.resolve(site), "python/");
const { loadPython } = await import(pathToFileURL(path.join(indexURL, "load_python.mjs")).href);
const modules = new Uint8Array(gunzipSync(readFileSync(path.join(indexURL, "modules.bin"))));
const python = await loadPython(indexURL, Promise.resolve(modules));
python.FS.mkdir("/given");
python.mountNodeFS("/given", path.resolve(folder));
python.globals.set("command", python.toPy([file, ...given]));
const result = python.runPythonAsync(`
import inspect, os, runpy
os.chdir("/given")
result = runpy.run_path(command[0], run_name="tested")["main"](command[1:])
if inspect.isawaitable(result):
    result = await result
result
`);
// The place of an error in Pyodide is a line of 1 MB.
// Timers of asyncio that were cancelled would keep Node waiting.
process.exit(await result.catch((error) => {
  console.error(error.message);
  return 1;
}));
