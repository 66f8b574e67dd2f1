// The Web Worker of the site: it loads Pyodide, and passes messages to the language server in it.

/** What is used of Pyodide. */
interface Python {
  runPython(code: string): string;
  unpackArchive(archive: ArrayBuffer, format: "zip", options: { extractDir: string }): void;
  pyimport(module: string): { SiteSession: (post: (message: string) => void) => { receive(message: string): void } };
}

/** A state of Python. A text is a message of the language server. */
export type WorkerMessage = string | { state: "python" } | { state: "ready" } | { state: "failed"; reason: string };

const folder = new URL("python/", import.meta.url).href;
const post = (message: WorkerMessage): void => self.postMessage(message);
/** The messages that the page has sent before Python was ready. */
let waiting: string[] = [];
let receive = (message: string): void => { waiting.push(message); };

self.onmessage = ({ data }: MessageEvent<string>) => receive(data);

async function fetched(name: string): Promise<ArrayBuffer> {
  const response = await fetch(folder + name);
  if (!response.ok) throw new Error(`${name}: ${response.status} ${response.statusText}`);
  return response.arrayBuffer();
}

async function start(): Promise<void> {
  const modules = fetched("modules.zip");
  const { loadPyodide } = await import(`${folder}pyodide.mjs`) as { loadPyodide(options: { indexURL: string }): Promise<Python> };
  const python = await loadPyodide({ indexURL: folder });
  post({ state: "python" });
  // The session enables the garbage collector again.
  const extractDir = python.runPython("import gc, site; gc.disable(); site.getsitepackages()[0]");
  python.unpackArchive(await modules, "zip", { extractDir });
  const session = python.pyimport("btcore_studio.site.session").SiteSession(post);
  post({ state: "ready" });
  for (const message of waiting) session.receive(message);
  waiting = [];
  receive = (message) => session.receive(message);
}

start().catch((error: unknown) => post({ state: "failed", reason: error instanceof Error ? error.message : String(error) }));
