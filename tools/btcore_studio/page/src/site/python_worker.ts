// The page's side of the Web Worker, in which the language server runs.

import { signal } from "@preact/signals";
import type { Transport } from "../rpc";
import { announce } from "../state";
import { siteTexts } from "../texts";
import type { WorkerMessage } from "./worker";

/** Python that has not replied for this time may be ended by the user. */
const BUSY_MS = 5000;
const REQUEST_FAILED = -32803;

/** What Python does; "busy" if requests wait for a long time. */
export const python = signal<"starting" | "ready" | "busy" | "failed">("starting");
/** Why Python has not started. */
export const failure = signal("");

type Message = Parameters<Transport["receive"]>[0];
type LocalMethods = Record<string, (params: never) => unknown>;

/** Messages to the language server, and to the page itself. */
export class PythonWorker implements Transport {
  receive: Transport["receive"] = () => {};
  lost: Transport["lost"] = () => {};
  private worker: Worker | null = null;
  private readonly waiting = new Set<Message["id"]>();
  private timer = 0;

  /** @param local The requests that the page answers itself. */
  constructor(private readonly local: LocalMethods) {}

  /** Start Python; if it runs, end it first. All requests that wait for it are rejected. */
  start(): void {
    this.worker?.terminate();
    this.waiting.clear();
    clearTimeout(this.timer);
    this.lost();
    this.show("starting");
    // A worker that starts from a blob has the page's policy: it makes no request to another origin.
    const address = new URL("worker.js", location.href).href;
    const source = URL.createObjectURL(new Blob([`import ${JSON.stringify(address)};`], { type: "text/javascript" }));
    const worker = new Worker(source, { type: "module" });
    worker.onmessage = ({ data }: MessageEvent<WorkerMessage>) => this.handle(data);
    worker.onerror = (event) => this.fail(event.message || siteTexts.notLoaded);
    this.worker = worker;
  }

  send(message: Message): void {
    const method = message.method ? this.local[message.method] : undefined;
    if (method) {
      const { id } = message;
      Promise.resolve(message.params as never).then(method).then(
        (result) => this.receive({ id, result }),
        (error: Error) => this.receive({ id, error: { code: REQUEST_FAILED, message: error.message } }));
      return;
    }
    if (message.method && message.id !== undefined) this.waiting.add(message.id);
    this.watch();
    this.worker?.postMessage(JSON.stringify(message));
  }

  private handle(data: WorkerMessage): void {
    if (typeof data !== "string") {
      if (data.state === "failed") this.fail(data.reason);
      else this.show("ready");
      return;
    }
    const message = JSON.parse(data) as Message;
    if (!message.method) this.waiting.delete(message.id);
    clearTimeout(this.timer);
    this.timer = 0;
    this.watch();
    if (python.value === "busy") python.value = "ready";
    this.receive(message);
  }

  private watch(): void {
    if (!this.waiting.size || python.value !== "ready") return;
    this.timer ||= window.setTimeout(() => this.show("busy"), BUSY_MS);
  }

  private show(state: typeof python.value): void {
    this.timer = 0;
    python.value = state;
    announce(siteTexts.python[state]);
    this.watch();
  }

  private fail(reason: string): void {
    failure.value = reason;
    this.show("failed");
  }
}
