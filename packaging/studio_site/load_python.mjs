// Load Pyodide with the Python modules of the site. The site has this file beside Pyodide.
import { loadPyodide } from "./pyodide.mjs";

/**
 * @param {string} indexURL The folder of Pyodide.
 * @param {Promise<Uint8Array>} modules The unpacked content of modules.bin, which `pack` in build_site.py writes: a
 *   line of JSON with the name and the size of each file, and then the files.
 */
export function loadPython(indexURL, modules) {
  return loadPyodide({
    indexURL,
    // Of the extensions of btcore, runs with mock leaves, proofs and recordings need no packages that are not here.
    env: { HOME: "/home/pyodide", BTCORE_ENTRY_POINTS: "mock search run btrec.txt changed" },
    fsInit: async (files, { sitePackages }) => {
      const bytes = await modules;
      let at = bytes.indexOf(10) + 1;
      const index = JSON.parse(new TextDecoder().decode(bytes.subarray(0, at)));
      const folders = new Set();
      for (const [name, size] of index) {
        const path = `${sitePackages}/${name}`;
        const folder = path.slice(0, path.lastIndexOf("/"));
        if (!folders.has(folder)) files.mkdirTree(folder);
        folders.add(folder);
        files.writeFile(path, bytes.subarray(at, at += size), { canOwn: true });
      }
    },
  });
}
