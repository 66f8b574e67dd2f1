// The Web Worker of the site: it loads Pyodide, and passes messages to the language server in it.

/** What is used of Pyodide. */
interface Python {
  runPython(code: string): void;
  pyimport(module: string): { SiteSession: (post: (message: string) => void) => { receive(message: string): void } };
}
/** `packaging/studio_site/load_python.mjs`. */
interface Loader { loadPython(indexURL: string, modules: Promise<Uint8Array>): Promise<Python> }

/** A state of Python. A text is a message of the language server. */
export type WorkerMessage = string | { state: "ready" } | { state: "failed"; reason: string };

const folder = new URL("python/", import.meta.url).href;
const post = (message: WorkerMessage): void => self.postMessage(message);
/** The messages that the page has sent before Python was ready. */
let waiting: string[] = [];
let receive = (message: string): void => { waiting.push(message); };

self.onmessage = ({ data }: MessageEvent<string>) => receive(data);

async function fetchModules(): Promise<Uint8Array> {
  const response = await fetch(`${folder}modules.bin`);
  if (!response.ok || !response.body) throw new Error(`modules.bin: ${response.status} ${response.statusText}`);
  const unpacked = new Response(response.body.pipeThrough(new DecompressionStream("gzip")));
  return new Uint8Array(await unpacked.arrayBuffer());
}

async function start(): Promise<void> {
  const modules = fetchModules();
  const { loadPython } = await import(`${folder}load_python.mjs`) as Loader;
  const python = await loadPython(folder, modules);
  python.runPython("import gc; gc.disable()"); // the session enables it
  const session = python.pyimport("btcore_studio.site.session").SiteSession(post);
  post({ state: "ready" });
  for (const message of waiting) session.receive(message);
  waiting = [];
  receive = (message) => session.receive(message);
}

start().catch((error: unknown) => post({ state: "failed", reason: error instanceof Error ? error.message : String(error) }));
