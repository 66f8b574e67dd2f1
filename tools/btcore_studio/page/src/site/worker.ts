// The Web Worker of the site: it loads Pyodide, and passes messages to the language server in it.

interface FileSystem {
  mkdirTree(folder: string): void;
  writeFile(path: string, content: Uint8Array, options: { canOwn: boolean }): void;
}

/** What is used of Pyodide. */
interface Python {
  runPython(code: string): void;
  pyimport(module: string): { SiteSession: (post: (message: string) => void) => { receive(message: string): void } };
}
interface Pyodide {
  loadPyodide(options: {
    indexURL: string; env: Record<string, string>; fsInit: (files: FileSystem, folders: { sitePackages: string }) => Promise<void>;
  }): Promise<Python>;
}

/** A state of Python. A text is a message of the language server. */
export type WorkerMessage = string | { state: "ready" } | { state: "failed"; reason: string };

const folder = new URL("python/", import.meta.url).href;
const post = (message: WorkerMessage): void => self.postMessage(message);
/** The messages that the page has sent before Python was ready. */
let waiting: string[] = [];
let receive = (message: string): void => { waiting.push(message); };

self.onmessage = ({ data }: MessageEvent<string>) => receive(data);

/** Return the Python modules: a line of JSON with the name and the size of each file, and then the files. */
async function fetchModules(): Promise<[name: string, content: Uint8Array][]> {
  const response = await fetch(`${folder}modules.bin`);
  if (!response.ok || !response.body) throw new Error(`modules.bin: ${response.status} ${response.statusText}`);
  const unpacked = new Response(response.body.pipeThrough(new DecompressionStream("gzip")));
  const bytes = new Uint8Array(await unpacked.arrayBuffer());
  let at = bytes.indexOf(10) + 1;
  const index = JSON.parse(new TextDecoder().decode(bytes.subarray(0, at))) as [string, number][];
  return index.map(([name, size]) => [name, bytes.subarray(at, at += size)]);
}

async function start(): Promise<void> {
  const modules = fetchModules();
  const { loadPyodide } = await import(`${folder}pyodide.mjs`) as Pyodide;
  const python = await loadPyodide({
    indexURL: folder,
    // Of the extensions of btcore, the runs with mock leaves need no packages that are not here.
    env: { HOME: "/home/pyodide", BTCORE_ENTRY_POINTS: "mock" },
    fsInit: async (files, { sitePackages }) => {
      for (const [name, content] of await modules) {
        const path = `${sitePackages}/${name}`;
        files.mkdirTree(path.slice(0, path.lastIndexOf("/")));
        files.writeFile(path, content, { canOwn: true });
      }
    },
  });
  python.runPython("import gc; gc.disable()"); // the session enables it
  const session = python.pyimport("btcore_studio.site.session").SiteSession(post);
  post({ state: "ready" });
  for (const message of waiting) session.receive(message);
  waiting = [];
  receive = (message) => session.receive(message);
}

start().catch((error: unknown) => post({ state: "failed", reason: error instanceof Error ? error.message : String(error) }));
