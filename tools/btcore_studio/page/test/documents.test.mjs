// Two pages edit the same files at random, and undo. The authority and the language server are simple models.
import assert from "node:assert/strict";
import { mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import path from "node:path";
import { after, test } from "node:test";
import { fileURLToPath, pathToFileURL } from "node:url";
import { build } from "esbuild";

const here = path.dirname(fileURLToPath(import.meta.url));
const folder = mkdtempSync(path.join(tmpdir(), "btcore-page-"));
after(() => rmSync(folder, { recursive: true }));
const source = `export * from "./documents"; export * from "./history"; export { ChangeSet } from "@codemirror/state";`;
const outfile = path.join(folder, "texts.mjs");
await build({ stdin: { contents: source, resolveDir: path.join(here, "../src"), loader: "ts" }, bundle: true, platform: "node", format: "esm", outfile });
const { ChangeSet, Documents, History, Mark, offsetAt, positionAt, textEdits, textOf } = await import(pathToFileURL(outfile).href);

// --- models

/** The offset of a position, as the language server computes it. */
function modelOffset(text, { line, character }) {
  const breaks = [...text.matchAll(/\r\n?|\n/g)];
  if (line > breaks.length) return text.length;
  const start = line ? breaks[line - 1].index + breaks[line - 1][0].length : 0;
  const end = line < breaks.length ? breaks[line].index : text.length;
  const offset = Math.min(start + character, end);
  return /^[\ud800-\udbff][\udc00-\udfff]$/.test(text.slice(offset - 1, offset + 1)) ? offset - 1 : offset;
}

/** Apply edits as the authority does: all positions are those of *text*. */
function applyEdits(text, edits) {
  let [result, done] = ["", 0];
  for (const { range, newText } of edits) {
    const [from, to] = [modelOffset(text, range.start), modelOffset(text, range.end)];
    assert.ok(done <= from && from <= to, "the edits are in order and do not overlap");
    result += text.slice(done, from) + newText;
    done = to;
  }
  return result + text.slice(done);
}

/** A server whose messages arrive in order, but late. */
class Server {
  constructor(texts) {
    this.files = new Map(Object.entries(texts).map(([uri, text]) => [uri, { text, version: 0 }]));
    this.peers = [];
    this.queue = [];
  }

  push(peer, { uri, version, edits }) {
    return new Promise((resolve) => this.queue.push(() => {
      const file = this.files.get(uri);
      if (version !== file.version) { peer.inbox.push(() => resolve("behind")); return; }
      file.text = applyEdits(file.text, edits);
      file.version += 1;
      const accepted = file.version;
      peer.inbox.push(() => resolve(accepted));
      for (const other of this.peers) if (other !== peer) other.inbox.push(() => other.documents.receive({ uri, version, edits }));
    }));
  }
}

class Page {
  constructor(server) {
    this.inbox = [];
    this.model = new Map();
    this.documents = new Documents({
      read: async (uri) => ({ ...server.files.get(uri), unsaved: false }),
      push: (pushed) => server.push(this, pushed),
      opened: (uri, text) => this.model.set(uri, text),
      changed: (uri, edits) => {
        // Sequentially, as textDocument/didChange.
        let text = this.model.get(uri);
        for (const edit of edits.toReversed()) text = applyEdits(text, [edit]);
        this.model.set(uri, text);
      },
    });
    this.history = new History(this.documents, undefined, undefined, () => 0);
    server.peers.push(this);
  }
}

const turn = () => new Promise(setImmediate);

async function deliver(server, pages, random) {
  const queues = [server.queue, ...pages.map((page) => page.inbox)].filter((queue) => queue.length);
  if (queues.length) queues[Math.floor(random() * queues.length)].shift()();
  await turn();
}

async function settle(server, pages, random) {
  for (let idle = 0; idle < 3;) {
    await deliver(server, pages, random);
    idle = server.queue.length || pages.some((page) => page.inbox.length) ? 0 : idle + 1;
  }
}

/** A small generator of random numbers, for tests that are the same every time. */
function mulberry(seed) {
  return () => {
    seed = (seed + 0x6d2b79f5) | 0;
    let value = Math.imul(seed ^ (seed >>> 15), 1 | seed);
    value = (value + Math.imul(value ^ (value >>> 7), 61 | value)) ^ value;
    return ((value ^ (value >>> 14)) >>> 0) / 4294967296;
  };
}

const PIECES = ["a", "<Sleep/>", "\n", "\r\n", "\r", "🤖", "é", "", "\u2028", "x\r\ny\nz"];
const START = '<root>\r\n  <!-- 🤖🤖 -->\r\n  <A name="é"/>\n  <B/>\r\n</root>';

function randomChanges(text, random) {
  const specs = [];
  let at = 0;
  while (specs.length < 3 && at <= text.length && (specs.length === 0 || random() < 0.4)) {
    const from = at + Math.floor(random() * (text.length - at + 1));
    const to = Math.min(text.length, from + Math.floor(random() * 4));
    const insert = PIECES[Math.floor(random() * PIECES.length)];
    specs.push({ from, to, insert: textOf(insert) });
    at = to + 1;
  }
  return ChangeSet.of(specs, text.length, "\n");
}

const check = (pages, server, uri) => {
  const { text } = server.files.get(uri);
  for (const page of pages) {
    assert.equal(page.documents.text(uri).toString(), text);
    assert.equal(page.model.get(uri), text);
  }
};

// --- tests

test("positions are those of the language server, and edits lose no byte", () => {
  const random = mulberry(1);
  for (let round = 0; round < 400; round++) {
    const text = textOf(Array.from({ length: 8 }, () => PIECES[Math.floor(random() * PIECES.length)]).join(""));
    const string = text.toString();
    for (let offset = 0; offset <= text.length; offset++) {
      const position = positionAt(text, offset);
      const isReachable = !/^(\r\n|[\ud800-\udbff][\udc00-\udfff])$/.test(string.slice(offset - 1, offset + 1));
      if (isReachable) assert.equal(modelOffset(string, position), offset, JSON.stringify([string, offset]));
      if (isReachable) assert.equal(offsetAt(text, position), offset);
    }
    const changes = randomChanges(text, random);
    assert.equal(applyEdits(string, textEdits(text, changes)), changes.apply(text).toString());
  }
});

test("two pages that edit at the same time end with the same texts", async () => {
  for (let seed = 0; seed < 60; seed++) {
    const random = mulberry(seed);
    const server = new Server({ a: START, b: "" });
    const pages = [new Page(server), new Page(server)];
    for (const page of pages) for (const uri of ["a", "b"]) await page.documents.load(uri);
    for (let step = 0; step < 40; step++) {
      const page = pages[Math.floor(random() * 2)], uri = random() < 0.8 ? "a" : "b", what = random();
      if (what < 0.45) page.documents.change(uri, randomChanges(page.documents.text(uri), random), "typing", "input.type");
      else if (what < 0.55) page.history.undo();
      else if (what < 0.6) page.history.redo();
      else await deliver(server, pages, random);
    }
    await settle(server, pages, random);
    check(pages, server, "a");
    check(pages, server, "b");
  }
});

test("undo to the start restores every byte, and redo the end", async () => {
  for (let seed = 0; seed < 60; seed++) {
    const random = mulberry(seed);
    const server = new Server({ a: START, b: START });
    const page = new Page(server);
    await page.documents.load("a");
    await page.documents.load("b");
    const texts = () => ["a", "b"].map((uri) => page.documents.text(uri).toString());
    const seen = [texts()];
    for (let step = 0; step < 20; step++) {
      const changes = ["a", "b"].filter(() => random() < 0.7)
        .map((uri) => [uri, randomChanges(page.documents.text(uri), random)]).filter(([, part]) => !part.empty);
      if (!changes.length) continue;
      page.history.apply(new Map(changes));
      seen.push(texts());
      if (random() < 0.3) { page.history.undo(); seen.pop(); assert.deepEqual(texts(), seen.at(-1)); }
    }
    for (const expected of seen.toReversed().slice(1)) { page.history.undo(); assert.deepEqual(texts(), expected); }
    assert.equal(page.history.canUndo, false);
    for (const expected of seen.slice(1)) { page.history.redo(); assert.deepEqual(texts(), expected); }
    page.history.undo();
    await settle(server, [page], random);
    check([page], server, "a");
    check([page], server, "b");
  }
});

test("undo keeps the edits of others", async () => {
  const server = new Server({ a: "one two three" });
  const [page, other] = [new Page(server), new Page(server)];
  await page.documents.load("a");
  await other.documents.load("a");
  page.history.apply(new Map([["a", ChangeSet.of({ from: 4, to: 7, insert: "2" }, 13)]]));
  await settle(server, [page, other], mulberry(0));
  other.history.apply(new Map([["a", ChangeSet.of({ from: 0, to: 3, insert: "1🤖" }, 11)]]));
  await settle(server, [page, other], mulberry(0));
  assert.equal(server.files.get("a").text, "1🤖 2 three");
  page.history.undo();
  assert.equal(page.documents.text("a").toString(), "1🤖 two three");
  page.history.redo();
  other.history.undo();
  await settle(server, [page, other], mulberry(0));
  assert.equal(server.files.get("a").text, "one 2 three");
  check([page, other], server, "a");
});

test("typing at one place is one step", async () => {
  const server = new Server({ a: "ab" });
  const page = new Page(server);
  await page.documents.load("a");
  const type = (from, insert) => page.documents.change(
    "a", ChangeSet.of({ from, insert }, page.documents.text("a").length), "typing", "input.type");
  type(1, "x"); type(2, "y"); type(0, "z");
  assert.equal(page.documents.text("a").toString(), "zaxyb");
  page.history.undo();
  assert.equal(page.documents.text("a").toString(), "axyb");
  page.history.undo();
  assert.equal(page.documents.text("a").toString(), "ab");
  page.history.redo();
  page.history.separate();
  type(3, "!");
  assert.equal(page.history.canRedo, false);
  page.history.undo();
  assert.equal(page.documents.text("a").toString(), "axyb");
});

test("an edit for an earlier text is applied to the present text", async () => {
  const server = new Server({ a: "<A/>\n<B/>" });
  const page = new Page(server);
  await page.documents.load("a");
  const mark = page.documents.mark();
  page.documents.change("a", ChangeSet.of({ from: 0, insert: textOf("\n\n") }, 9), "typing");
  const range = { start: { line: 1, character: 1 }, end: { line: 1, character: 2 } };
  page.history.apply(await page.documents.changesOf({ changes: { a: [{ range, newText: "C" }] } }, mark));
  assert.equal(page.documents.text("a").toString(), "\n\n<A/>\n<C/>");
  assert.deepEqual(page.documents.position("a", { line: 1, character: 0 }, mark), { line: 3, character: 0 });
  page.documents.change("a", ChangeSet.of({ from: 2, to: 7 }, 11), "command");
  assert.equal(page.documents.position("a", { line: 0, character: 0 }, mark), null);
  assert.ok(mark instanceof Mark);
});

test("edits without a connection arrive once, whether or not the server had them", async () => {
  for (const arrived of [false, true]) {
    const file = { text: "ab", version: 0 };
    let answer = "lost";
    const documents = new Documents({
      read: async () => ({ ...file, unsaved: false }),
      push: async ({ edits }) => {
        if (answer === "lost" && !arrived) return "lost";
        file.text = applyEdits(file.text, edits);
        file.version += 1;
        return answer === "lost" ? "lost" : file.version;
      },
      opened: () => {}, changed: () => {},
    });
    await documents.load("a");
    documents.change("a", ChangeSet.of({ from: 1, insert: "x" }, 2), "typing");
    await turn();
    documents.change("a", ChangeSet.of({ from: 2, insert: "y" }, 3), "typing");
    answer = "ok";
    await documents.reload();
    await documents.pushed("a");
    assert.equal(file.text, "axyb");
    assert.equal(documents.text("a").toString(), "axyb");
  }
});
