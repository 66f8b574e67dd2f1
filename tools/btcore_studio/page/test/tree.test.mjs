// The picture's pieces, the places to drop nodes, the search for node types, the keys, and the order of steps.
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
const source = ["picture", "drop_targets", "fuzzy", "keyboard", "markdown", "queue", "tree"].map((name) => `export * from "./${name}";`).join("\n");
const outfile = path.join(folder, "tree.mjs");
await build({ stdin: { contents: source, resolveDir: path.join(here, "../src"), loader: "ts" }, bundle: true, platform: "node", format: "esm", outfile });
const { actionOf, complete, createQueue, DropTargets, isSamePicture, longestRise, match, neighbour, outline, search, Structure, plain } = await import(pathToFileURL(outfile).href);

// --- a tree: 0 root(1 a, 2 loop(3 b), 4 c), where "loop" is a decorator

const LIMITS = { root: [1, null], loop: [1, 1] };
const node = (name, parent, more = {}) => ({
  key: name, parent, id: name, name, kind: "action", calls: "", ports: [], hidden: 0, leaf: !(name in LIMITS), disabled: false,
  children: LIMITS[name] ?? [0, 0], ...more,
});
const NODES = [node("root", 0), node("a", 1), node("loop", 1), node("b", 3), node("c", 1)];
const STRUCTURE = new Structure(NODES);
const box = (x, y, width = 100, height = 40) => ({ x, y, width, height });
const BOXES = [box(150, 0), box(0, 100), box(150, 100), box(150, 200), box(300, 100)];
const NEW_LEAF = { moved: [], count: 1, canWrap: false };
const NEW_PARENT = { moved: [], count: 1, canWrap: true };
const targetAt = (load, x, y) => {
  const target = new DropTargets(STRUCTURE, BOXES, load).at(x, y);
  if (!target) return null;
  return target.kind === "around" ? `around ${NODES[target.node].name}` : `${target.kind} ${NODES[target.parent].name} ${target.index}`;
};

test("a structure knows places and limits", () => {
  assert.deepEqual(STRUCTURE.children, [[1, 2, 4], [], [3], [], []]);
  assert.deepEqual(STRUCTURE.levels, [1, 2, 2, 3, 2]);
  assert.deepEqual(STRUCTURE.positions, [1, 1, 2, 1, 3]);
  assert.ok(STRUCTURE.isWithin(3, 2) && STRUCTURE.isWithin(3, 0) && !STRUCTURE.isWithin(4, 2));
  assert.deepEqual(STRUCTURE.roots([4, 3, 2, 1, 3]), [1, 2, 4]);
  assert.ok(STRUCTURE.canTake(0, 5) && !STRUCTURE.canTake(2, 1) && !STRUCTURE.canTake(1, 1));
  assert.ok(STRUCTURE.canTake(2, 1, [3]), "a moved node leaves its place");
  assert.ok(!new Structure([node("root", 0, { calls: "root" })]).canTake(0, 1), "the children of a call are another tree's");
});

test("nodes below a disabled node are disabled", () => {
  const structure = new Structure(NODES.map((item) => item.name === "loop" ? { ...item, disabled: true } : item));
  assert.deepEqual(structure.disabled, [false, false, true, true, false]);
});

test("between two children", () => {
  assert.equal(targetAt(NEW_LEAF, 125, 120), "between root 1");
  assert.equal(targetAt(NEW_LEAF, 270, 130), "between root 2");
  assert.equal(targetAt(NEW_LEAF, -10, 120), "between root 0");
  assert.equal(targetAt(NEW_LEAF, 412, 120), "between root 3");
});

test("on the sides of a leaf", () => {
  assert.equal(targetAt(NEW_LEAF, 10, 120), "between root 0");
  assert.equal(targetAt(NEW_LEAF, 90, 120), "between root 1");
});

test("a node with enough children takes no other", () => {
  assert.equal(targetAt(NEW_LEAF, 200, 130), "between root 2");
  assert.equal(targetAt(NEW_LEAF, 200, 195), null);
});

test("on a node that can have children", () => {
  assert.equal(targetAt(NEW_LEAF, 200, 20), "inside root 3");
  assert.equal(targetAt(NEW_PARENT, 200, 5), "around root");
  assert.equal(targetAt(NEW_PARENT, 200, 17), "around root");
  assert.equal(targetAt(NEW_PARENT, 200, -20), "around root");
  assert.equal(targetAt(NEW_LEAF, 200, -20), null);
  assert.equal(targetAt(NEW_PARENT, 200, 30), "inside root 3");
  assert.equal(targetAt(NEW_PARENT, 200, 215), "around b");
});

test("far from all nodes there is no target", () => {
  assert.equal(targetAt(NEW_LEAF, 900, 900), null);
});

test("a moved node keeps out of itself, and leaves its place", () => {
  const load = { moved: [2], count: 1, canWrap: false };
  assert.equal(targetAt(load, 200, 215), null);
  assert.equal(targetAt(load, 200, 120), null);
  assert.equal(targetAt(load, 412, 120), "between root 3");
  assert.equal(targetAt({ moved: [3], count: 1, canWrap: false }, 270, 130), "between root 2");
});

test("an empty tree takes a root", () => {
  assert.deepEqual(new DropTargets(new Structure([]), [], NEW_LEAF).at(3, 4), { kind: "root" });
});

test("children in columns have places above and below", () => {
  const boxes = [box(150, 0), box(150, 60), box(150, 115), box(170, 170), box(150, 225)];
  const targets = new DropTargets(STRUCTURE, boxes, NEW_LEAF);
  const at = (x, y) => { const target = targets.at(x, y); return target && [target.kind, target.index, target.mark.y1 === target.mark.y2]; };
  assert.deepEqual(at(200, 107), ["between", 1, true]);
  assert.deepEqual(at(200, 269), ["between", 3, true]);
});

// --- the picture

const CARD = '<title>a</title><rect class="card action" width="120.5" height="46.0" rx="7"/><text class="uid"></text>';
const drawn = (key, x) => ({
  key, parent: 0, place: { uri: "file:///t.xml", position: { line: 1, character: 2 } }, end: { line: 1, character: 9 }, x, y: 0, card: CARD,
});

test("a drawing is completed from the earlier one", () => {
  const before = { number: 1, svg: "<svg/>", nodes: [drawn("a", 0), drawn("b", 50)], moved: [] };
  const after = complete({ number: 2, svg: "<svg/>", nodes: [drawn("c", 0)], moved: [[1, 1, 1, 3, 4, 3, 11, 70, 20, "m0 0"]] }, before);
  const moved = { ...drawn("b", 70), y: 20, parent: 1, edge: "m0 0", end: { line: 3, character: 11 } };
  moved.place = { uri: "file:///t.xml", position: { line: 3, character: 4 } };
  assert.deepEqual(after.nodes, [drawn("c", 0), moved]);
  assert.deepEqual([isSamePicture(before, before), isSamePicture(before, after)], [true, false]);
});

test("a card has no texts from afar", () => {
  assert.equal(outline(CARD), '<rect class="card action" width="120.5" height="46.0" rx="7"/>');
});

test("as few elements as possible move", () => {
  assert.deepEqual([...longestRise([3, 4, 0, 1, 2])].sort(), [2, 3, 4]);
  assert.deepEqual([...longestRise([9, 0, 1, 2])].sort(), [1, 2, 3]);
  assert.deepEqual([...longestRise([])], []);
});

// --- search

test("letters match in their order, best at the beginnings of words", () => {
  const ids = ["Sequence", "ReactiveSequence", "AsyncSequence", "RetryUntilSuccessful", "ForceSuccess", "Sleep"];
  const best = (query) => search(query, ids, (id) => id).map(({ item }) => item);
  assert.equal(best("seq")[0], "Sequence");
  assert.equal(best("rseq")[0], "ReactiveSequence");
  assert.equal(best("rus")[0], "RetryUntilSuccessful");
  assert.equal(best("fs")[0], "ForceSuccess");
  assert.equal(best("slp")[0], "Sleep");
  assert.deepEqual(best("zzz"), []);
  assert.deepEqual(best(""), ids);
});

test("a match names its letters", () => {
  assert.deepEqual(match("rs", "ReactiveSequence").at, [0, 8]);
  assert.deepEqual(match("is d", "IsDone").at, [0, 1, 2]);
  assert.equal(match("x", "Sleep"), null);
});

// --- keys

const press = (name) => {
  const parts = name.split("+");
  return actionOf({ key: parts.at(-1), ctrl: parts.includes("Ctrl"), shift: parts.includes("Shift"), alt: parts.includes("Alt") });
};

test("keys and operations", () => {
  const expected = {
    i: "insert", w: "wrap", u: "unwrap", e: "toggle", F2: "rename", t: "type", Delete: "remove", Backspace: "remove",
    "Ctrl+d": "duplicate", "Ctrl+x": "cut", "Ctrl+c": "copy", "Alt+ArrowLeft": "earlier", "Alt+ArrowDown": "in", " ": "fold",
    "Shift+X": "inline", x: "extract", "Ctrl+Enter": "text", "Ctrl+w": null, "Ctrl+v": null, "Alt+d": null, q: null,
  };
  for (const [key, operation] of Object.entries(expected)) {
    assert.equal(press(key)?.operation ?? null, operation, key);
  }
});

test("signs need no particular shift key", () => {
  for (const shift of [false, true]) {
    assert.deepEqual(actionOf({ key: "?", ctrl: false, shift, alt: false }), { page: "help" });
    assert.deepEqual(actionOf({ key: "/", ctrl: false, shift, alt: false }), { page: "search" });
  }
});

test("arrows follow the tree", () => {
  assert.deepEqual(press("Shift+ArrowDown"), { select: "down", isExtending: true });
  const names = { up: [3, 2], down: [0, 1], left: [2, 1], right: [2, 4], first: [4, 0], last: [0, 4] };
  for (const [direction, [from, to]] of Object.entries(names)) assert.equal(neighbour(STRUCTURE, from, direction), to, direction);
  assert.equal(neighbour(STRUCTURE, 0, "up"), -1);
  assert.equal(neighbour(STRUCTURE, 4, "right"), -1);
  assert.equal(neighbour(STRUCTURE, -1, "down"), 0);
});

test("docstrings are shown without the marks of emphasis", () => {
  assert.equal(plain("Succeeds if *low* or less; *wait_duration* of `a*b*c`, 2 * 3 * 4."), "Succeeds if low or less; wait_duration of `a*b*c`, 2 * 3 * 4.");
});

// --- the order of steps

test("a step begins at once, or when the earlier steps have ended", async () => {
  const queue = createQueue();
  const seen = [];
  let end;
  const first = queue(async () => {
    seen.push("first begins");
    await new Promise((resolve) => { end = resolve; });
    throw new Error("refused");
  });
  assert.deepEqual(seen, ["first begins"]);
  const second = queue(async () => { seen.push("second"); return 2; });
  const third = queue(async () => { seen.push("third"); });
  await null;
  assert.deepEqual(seen, ["first begins"]);
  end();
  await assert.rejects(first, /refused/);
  assert.equal(await second, 2);
  await third;
  await new Promise(setImmediate);
  const last = queue(async () => { seen.push("at once"); });
  assert.deepEqual(seen, ["first begins", "second", "third", "at once"]);
  await last;
});
