import { type ChildProcess, spawn } from "node:child_process";
import * as http from "node:http";
import { createInterface } from "node:readline";

const START_WITHIN_MS = 60_000;
const MAX_ERRORS = 4_000;

/** A running `btcore preview`: its server on this machine, and requests to it. */
export class PreviewProcess {
  private readonly child: ChildProcess;
  private readonly url: Promise<string>;
  private errors = "";
  private events: http.ClientRequest | undefined;

  /** Start `btcore preview`; *ended* is called with a reason if it ends by itself. */
  constructor(command: string, args: string[], folder: string, ended: (reason: string) => void) {
    this.child = spawn(command, ["preview", "--json", ...args], { cwd: folder, stdio: ["ignore", "pipe", "pipe"] });
    this.child.stderr?.on("data", (data) => (this.errors = (this.errors + String(data)).slice(-MAX_ERRORS)));
    this.url = new Promise((resolve, reject) => {
      const limit = setTimeout(() => reject(new Error("it does not answer")), START_WITHIN_MS);
      const fail = (reason: string): void => {
        clearTimeout(limit);
        reject(new Error(reason));
        if (!this.isClosed) ended(reason);
      };
      this.child.on("error", (error) => fail(error.message));
      this.child.on("exit", (code) => fail(this.errors.trim() || `exit code ${code}`));
      if (this.child.stdout) {
        createInterface(this.child.stdout).once("line", (line) => {
          clearTimeout(limit);
          try {
            resolve(String((JSON.parse(line) as { url: unknown }).url));
          } catch {
            reject(new Error(`unexpected output: ${line.slice(0, 200)}`));
          }
        });
      }
    });
    this.url.catch(() => undefined);
  }

  private isClosed = false;

  /** Return a file of the page. */
  async get(name: string): Promise<string> {
    return this.request("GET", name);
  }

  /** Execute an action of the page, and return its result. */
  async post(name: string, body: unknown): Promise<unknown> {
    return JSON.parse(await this.request("POST", name, JSON.stringify(body)));
  }

  /** Call *receive* for every event, until `close`. */
  async listen(receive: (name: string, value: unknown) => void): Promise<void> {
    const url = await this.url;
    this.events?.destroy();
    this.events = http.get(`${url}events`, { agent: false }, (reply) => {
      let name = "";
      const lines = createInterface(reply);
      lines.on("line", (line) => {
        if (line.startsWith("event: ")) name = line.slice(7);
        else if (line.startsWith("data: ")) receive(name, JSON.parse(line.slice(6)));
      });
      // The end of the process breaks the connection.
      lines.on("error", () => undefined);
      reply.on("error", () => undefined);
    });
    this.events.on("error", () => undefined);
  }

  private async request(method: string, name: string, body?: string): Promise<string> {
    const url = await this.url;
    const headers = body === undefined ? {} : { "Content-Type": "application/json", "Content-Length": Buffer.byteLength(body) };
    return new Promise((resolve, reject) => {
      const request = http.request(`${url}${name}`, { method, headers, agent: false }, (reply) => {
        const parts: Buffer[] = [];
        reply.on("data", (part: Buffer) => parts.push(part));
        reply.on("end", () => resolve(Buffer.concat(parts).toString()));
        reply.on("error", reject);
      });
      request.on("error", reject);
      request.end(body);
    });
  }

  /** End the process. */
  close(): void {
    this.isClosed = true;
    this.events?.destroy();
    this.child.kill();
  }
}
