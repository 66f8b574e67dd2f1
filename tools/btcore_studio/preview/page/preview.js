// The page of `btcore preview`, in a browser or in a web view of VS Code. Texts of trees reach the page only
// through textContent and the server's drawing, which escapes them.
"use strict";

const SVG = "http://www.w3.org/2000/svg";
const STATUS_NAMES = ["IDLE", "RUNNING", "SUCCESS", "FAILURE", "SKIPPED"];
const MAX_ENTRIES = 500;
const MAX_COLOURED_LINES = 5000;
const MIN_ZOOM = 0.08, MAX_ZOOM = 3;

const byId = (id) => document.getElementById(id);
const canvas = byId("canvas");
const make = (tag, text = "", name = "") => {
  const element = document.createElement(tag);
  element.textContent = text;
  if (name) element.className = name;
  return element;
};
const draw = (tag, attributes) => {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  return element;
};

// --- the connection to the server: HTTP in a browser, messages to the extension in VS Code

const editor = typeof acquireVsCodeApi === "function" ? acquireVsCodeApi() : null;
const replies = new Map();
let lastRequest = 0;

async function post(name, body = {}) {
  if (editor) {
    const id = ++lastRequest;
    editor.postMessage({ type: "request", id, name, body });
    return new Promise((resolve) => replies.set(id, resolve));
  }
  const reply = await fetch(name, {
    method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body),
  });
  return reply.json();
}

function listen() {
  if (editor) {
    window.addEventListener("message", ({ data }) => {
      if (data.type === "reply") {
        replies.get(data.id)?.(data.value);
        replies.delete(data.id);
      } else if (data.type === "event") receive(data.name, data.value);
      else if (data.type === "cursor") selectLine(data.file, data.line, false);
      else if (data.type === "tree") { state.tree = data.tree; load(); }
      else if (data.type === "address") byId("address").placeholder = data.address;
    });
    document.body.classList.add("editor");
    editor.postMessage({ type: "ready" });
    return;
  }
  const events = new EventSource("events");
  events.addEventListener("document", (event) => receive("document", JSON.parse(event.data)));
  events.addEventListener("live", (event) => receive("live", JSON.parse(event.data)));
  events.onerror = () => { state.offline = true; showNotice(); };
  events.onopen = () => { state.offline = false; showNotice(); };
}

function receive(name, data) {
  if (name === "document") showDocument(data);
  else showLive(data);
}

// --- state

const state = {
  tree: null,
  folded: new Set(),
  document: null,
  drawing: null,
  live: null,
  liveKeys: [],
  moment: null,
  position: 0,
  keys: new Map(),
  groups: new Map(),
  selected: "",
  found: [],
  at: -1,
  zoom: 0,
  offline: false,
  shownFile: -1,
};

// --- the document

function showDocument(data) {
  const first = state.document === null;
  state.document = data;
  const name = data.file.split(/[\\/]/).pop();
  document.title = `${name} – btcore preview`;
  byId("file").textContent = name;
  byId("file").title = data.file;
  byId("unsaved").hidden = !data.unsaved;
  byId("live").hidden = !data.live;
  if (first && data.recorded) showTimeline(data.recorded);
  if (first && data.tree) state.tree = data.tree;
  showTrees();
  // The page has requested the first drawing already.
  if (!first && data.drawable) load();
  else {
    if (data.text) showSource(state.shownFile, true);
    markProblems();
  }
  canvas.classList.toggle("stale", !data.drawable);
  showNotice();
  showProblems();
}

// Show the trees of the file to choose from, and the tree that is drawn, which the file may lack by now.
function showTrees() {
  const select = byId("tree"), drawn = state.drawing?.tree, trees = state.document?.trees ?? [];
  if (trees.length) {
    const shown = new Set(drawn ? [...trees, drawn] : trees);
    select.replaceChildren(...Array.from(shown, (id) => new Option(id, id)));
    select.hidden = shown.size < 2;
  }
  if (drawn) select.value = drawn;
}

function showProblems() {
  const { diagnostics, more } = state.document;
  const errors = diagnostics.filter((item) => item.severity === "error").length;
  const warnings = diagnostics.length - errors;
  const count = (number, noun) => `${number} ${noun}${number === 1 ? "" : "s"}`;
  const summary = byId("summary");
  summary.textContent = diagnostics.length
    ? [errors && `✘ ${count(errors, "error")}`, warnings && `⚠ ${count(warnings, "warning")}`].filter(Boolean).join("   ")
    : "✔ No errors or warnings";
  summary.className = errors ? "errors" : warnings ? "warnings" : "";
  const items = diagnostics.map((item) => {
    const row = make("li", "", item.severity);
    const text = make("span", item.message);
    if (item.hint) text.append(" ", make("em", item.hint));
    const place = `${item.file.split(/[\\/]/).pop()}:${item.line}:${item.column}`;
    row.append(make("code", item.code), text, make("small", place));
    row.onclick = () => selectLine(item.file, item.line, true);
    return row;
  });
  byId("problems").replaceChildren(...items, ...more.map((text) => make("li", text)));
}

function showNotice() {
  const notices = [];
  if (state.offline) notices.push("The preview's process does not answer. Start btcore preview again.");
  else if (state.document && !state.document.drawable && state.drawing?.svg) {
    notices.push("The file has errors. This is the last picture without errors.");
  }
  if (state.refusal) notices.push(state.refusal);
  const live = state.live;
  if (live?.problem) notices.push(live.problem);
  if (live?.connection && live.connection !== "connected") notices.push(live.detail);
  notices.push(...(state.document?.recorded?.warnings ?? []).map((text) => `This recording: ${text}.`));
  if (live?.connection && !state.document?.recorded && state.liveKeys.length && state.drawing?.nodes) {
    const missing = state.liveKeys.filter((key) => !state.keys.has(key)).length;
    if (missing) {
      const nodes = missing === 1 ? "1 node of the running tree is" : `${missing} nodes of the running tree are`;
      notices.push(`The file differs from the running tree: ${nodes} not in this picture.`);
    }
  }
  if (state.rejected) notices.push(state.rejected);
  byId("notice").replaceChildren(...notices.map((text) => make("p", text)));
  byId("notice").hidden = !notices.length;
}

// --- the drawing

let loading = false, again = false;

async function load(anchor = "") {
  if (loading) { again = true; return; }
  loading = true;
  try {
    // The page has preloaded the first drawing.
    const data = state.drawing || editor ? await post("drawing", { tree: state.tree, folded: [...state.folded] })
      : await (await fetch("drawing")).json();
    state.refusal = data.error && state.drawing?.svg ? data.error : "";
    if (data.error) {
      if (!state.drawing?.svg) canvas.replaceChildren(make("p", data.error));
      state.drawing ??= {};
      showTrees();
    } else show(data, anchor);
    showNotice();
  } catch {
    state.offline = true;
    showNotice();
  } finally {
    loading = false;
    if (again) { again = false; load(); }
  }
}

function show(data, anchor) {
  const old = canvas.querySelector("svg");
  anchor = anchor || state.selected || data.nodes[0].key;
  const before = state.groups.get(anchor)?.getBoundingClientRect();
  const otherTree = state.drawing?.tree !== data.tree;
  // Chromium parses HTML three times as fast as XML. The server has escaped every text of the drawing.
  const template = document.createElement("template");
  template.innerHTML = data.svg;
  const svg = template.content.firstElementChild;
  const focused = focusedNode()?.key;
  state.drawing = data;
  state.keys = new Map(data.nodes.map((node, index) => [node.key, { ...node, index }]));
  const view = svg.viewBox.baseVal;
  state.size = [view.width, view.height];
  showTrees();
  if (!state.zoom || otherTree) state.zoom = startZoom();
  setSize(svg);
  state.groups = new Map();
  for (const group of svg.querySelectorAll("g[data-uid]")) {
    const node = data.nodes[group.dataset.uid - 1];
    state.groups.set(node.key, group);
  }
  canvas.replaceChildren(svg);
  if (focused) {
    describe();
    (state.groups.get(focused) ?? canvas).focus({ preventScroll: true });
  } else mark(state.selected);
  const after = before && state.groups.get(anchor)?.getBoundingClientRect();
  if (old && after && !otherTree) {
    canvas.scrollBy(after.left - before.left, after.top - before.top);
  } else if (state.size[0] * state.zoom > canvas.clientWidth) {
    const root = state.groups.values().next().value.getBoundingClientRect();
    const box = canvas.getBoundingClientRect();
    canvas.scrollLeft += root.left + root.width / 2 - box.left - box.width / 2;
  }
  performance.mark("drawn");
  markProblems();
  search(false);
  paintLive();
  // The picture is painted first.
  const later = window.requestIdleCallback ?? setTimeout;
  requestAnimationFrame(() => later(() => {
    describe();
    showSource(state.shownFile < 0 ? mainFile() : state.shownFile, true);
    showNode();
  }));
}

// Describe the drawing to screen readers, as a tree: Tab reaches one of its nodes, and arrows the others.
function describe() {
  const svg = canvas.querySelector("svg");
  svg.setAttribute("role", "tree");
  svg.setAttribute("aria-label", `Tree ${state.drawing.tree}`);
  const { nodes } = state.drawing;
  const levels = [];
  for (const [index, node] of nodes.entries()) {
    levels.push(node.parent ? levels[node.parent - 1] + 1 : 1);
    const group = state.groups.get(node.key);
    if (!group) continue;
    const attributes = {
      role: "treeitem", tabindex: -1, "aria-level": levels[index], "aria-selected": false,
      "aria-label": `${node.name}, ${node.kind}${node.name === node.id ? "" : ` ${node.id}`}${node.calls ? ` ${node.calls}` : ""}`,
    };
    if (!node.leaf) attributes["aria-expanded"] = !node.hidden;
    for (const [name, value] of Object.entries(attributes)) group.setAttribute(name, value);
  }
  mark(state.selected);
}

function setSize(svg) {
  svg.setAttribute("width", Math.round(state.size[0] * state.zoom));
  svg.setAttribute("height", Math.round(state.size[1] * state.zoom));
}

function fitZoom() {
  const [width, height] = state.size;
  return Math.min((canvas.clientWidth - 4) / width, (canvas.clientHeight - 4) / height);
}

function startZoom() {
  // A tree that is too large for readable texts is scrolled.
  const zoom = fitZoom();
  return zoom < 0.5 ? 0.6 : Math.min(1.15, zoom);
}

function zoomTo(zoom, x = canvas.clientWidth / 2, y = canvas.clientHeight / 2) {
  const svg = canvas.querySelector("svg");
  if (!svg) return;
  zoom = Math.max(MIN_ZOOM, Math.min(MAX_ZOOM, zoom));
  const box = svg.getBoundingClientRect(), frame = canvas.getBoundingClientRect();
  const at = [(frame.left + x - box.left) / state.zoom, (frame.top + y - box.top) / state.zoom];
  state.zoom = zoom;
  setSize(svg);
  const now = svg.getBoundingClientRect();
  canvas.scrollLeft += now.left + at[0] * zoom - frame.left - x;
  canvas.scrollTop += now.top + at[1] * zoom - frame.top - y;
}

// Add the button that folds a node. The drawing has the badges of folded nodes.
function addFold(group) {
  const card = group.querySelector(".card");
  const [width, height] = [card.width.baseVal.value, card.height.baseVal.value];
  const button = draw("g", { class: "fold passing", transform: `translate(${width / 2} ${height})` });
  const label = draw("text", { class: "count", y: 4 });
  label.textContent = "−";
  const hint = draw("title", {});
  hint.textContent = "Hide the nodes below";
  button.append(hint, draw("rect", { class: "pill", x: -8, y: -8, width: 16, height: 16, rx: 8 }), label);
  group.append(button);
}

function toggleFold(key) {
  const node = state.keys.get(key);
  if (!node || node.leaf) return;
  if (node.hidden) state.folded.delete(key);
  else state.folded.add(key);
  load(key);
}

function foldSubtrees() {
  for (const node of state.keys.values()) if (node.calls && node.parent) state.folded.add(node.key);
  load();
}

function unfoldAll() {
  state.folded.clear();
  load();
}

// --- selection

const nodeOf = (target) => {
  const group = target.closest?.("g[data-uid]");
  return group ? state.drawing.nodes[group.dataset.uid - 1] : null;
};

const focusedNode = () => (canvas.contains(document.activeElement) ? nodeOf(document.activeElement) : null);

function mark(key) {
  for (const group of canvas.querySelectorAll("g.selected, g[tabindex='0']")) {
    group.classList.remove("selected");
    group.setAttribute("aria-selected", "false");
    group.setAttribute("tabindex", "-1");
  }
  const group = state.groups.get(key), reached = group ?? state.groups.values().next().value;
  reached?.setAttribute("tabindex", "0");
  if (!group) return;
  group.classList.add("selected");
  group.setAttribute("aria-selected", "true");
  if (canvas.contains(document.activeElement)) group.focus({ preventScroll: true });
}

function select(key, { scroll = false, source = true } = {}) {
  state.selected = key;
  const node = state.keys.get(key);
  if (!node) return;
  const hidden = ancestors(node).filter((parent) => parent.hidden);
  if (hidden.length && scroll) {
    for (const parent of hidden) state.folded.delete(parent.key);
    load(key);
  }
  mark(key);
  if (scroll) state.groups.get(key)?.scrollIntoView({ block: "nearest", inline: "nearest" });
  showNode();
  if (!source) return;
  if (editor) editor.postMessage({ type: "reveal", file: state.drawing.files[node.file].name, line: node.line, column: node.column });
  else { showSource(node.file); goToLine(node.line); }
}

function ancestors(node) {
  const found = [];
  while (node.parent) {
    node = state.drawing.nodes[node.parent - 1];
    found.push(node);
  }
  return found;
}

// Select the last node that begins in the line or above it.
function selectLine(name, line, scroll) {
  const { nodes = [], files = [] } = state.drawing ?? {};
  const file = nodes.length ? files.findIndex((item) => item.name === name) : 0;
  let best = null;
  for (const node of nodes) {
    if (node.file === file && node.line <= line && (!best || node.line > best.line)) best = node;
  }
  if (best) select(best.key, { scroll: true, source: false });
  if (!editor && file >= 0) { showSource(file); goToLine(line, scroll); }
  else if (editor && scroll) editor.postMessage({ type: "reveal", file: name, line, column: 1 });
}

function showNode() {
  const panel = byId("node"), node = state.keys.get(state.selected);
  panel.parentElement.classList.toggle("used", Boolean(node) || !byId("entries").hidden);
  if (!node) {
    panel.replaceChildren(make("div", "Select a node to see its ports, and where it is written.", "kind"));
    return;
  }
  const title = make("div", node.name, "name");
  const status = state.live?.connection ? liveStatus(node.key) : null;
  if (status !== null) title.append(make("span", STATUS_NAMES[status], `status s${status}`));
  const place = `${state.drawing.files[node.file].name.split(/[\\/]/).pop()}:${node.line}`;
  const kind = make("div", `${node.kind} · ${node.calls ? `${node.id} ${node.calls}` : node.id} · ${place}`, "kind");
  const ports = make("dl");
  const leaf = state.moment?.leaves[node.key];
  for (const [name, text] of node.ports) ports.append(make("dt", name), showPort(text, leaf?.inputs[name], leaf?.outputs[name]));
  const named = new Set(node.ports.map(([name]) => name));
  for (const name of Object.keys({ ...leaf?.inputs, ...leaf?.outputs })) {
    if (!named.has(name)) ports.append(make("dt", name), showPort("", leaf.inputs[name], leaf.outputs[name]));
  }
  if (leaf?.error) ports.append(make("dt", "raised"), make("dd", leaf.error, "raised"));
  const actions = make("div", "", "actions");
  if (!node.leaf) {
    const fold = make("button", node.hidden ? `Show ${node.hidden} nodes` : "Fold");
    fold.onclick = () => toggleFold(node.key);
    actions.append(fold);
  }
  if (state.document?.live) {
    const stop = make("button", state.live?.wanted.includes(node.key) ? "Remove breakpoint" : "Set breakpoint");
    stop.onclick = () => toggleBreakpoint(node.key);
    actions.append(stop);
  }
  const about = state.drawing.about[node.id];
  const parts = [title, kind, ...(ports.childElementCount ? [ports] : []), actions];
  if (state.moment?.tick && node.leaf && !leaf) parts.splice(2, 0, make("div", "It was not ticked in this tick.", "kind"));
  if (about) {
    // Docstrings have code between backquotes.
    const text = make("p", "", "about");
    text.append(...about.split("`").map((part, index) => (index % 2 ? make("code", part) : part)));
    parts.push(text);
  }
  panel.replaceChildren(...parts);
}

// Return the text of a port with the values that a recorded tick has read and written.
function showPort(text, input, output) {
  const cell = make("dd", text);
  if (input !== undefined && input !== text) cell.append(" ", make("span", input, "value"));
  if (output !== undefined && output !== input) cell.append(" ", make("span", output, "value out"));
  return cell;
}

// --- the source

const mainFile = () => Math.max(0, state.drawing.files.findIndex((file) => file.name === state.drawing.file));

function sourceFile(number) {
  // A drawing has the texts that it was made from; the present text of a broken file is another.
  const { file, text } = state.document ?? {};
  const known = state.drawing?.files?.[number];
  return text && (!known || known.name === file) ? { name: file, text } : known;
}

function showSource(number, again = false) {
  if (editor) return;
  number = Math.max(0, Math.min(number, (state.drawing?.files?.length ?? 1) - 1));
  if (number === state.shownFile && !again) return;
  const file = sourceFile(number);
  if (!file) return;
  if (number === state.shownFile && state.shownText === file.text) return;
  state.shownFile = number;
  state.shownText = file.text;
  byId("sourcename").textContent = file.name.split(/[\\/]/).pop();
  const lines = file.text.split(/\r\n?|\n/);
  const coloured = lines.length <= MAX_COLOURED_LINES;
  let comment = false;
  const panel = byId("lines"), scroll = panel.scrollTop;
  panel.replaceChildren(...lines.map((line, index) => {
    const row = document.createElement("div");
    row.dataset.line = index + 1;
    if (!coloured) row.textContent = line;
    else comment = colour(row, line, comment);
    return row;
  }));
  panel.scrollTop = scroll;
  const node = state.keys.get(state.selected);
  if (node?.file === number) goToLine(node.line, false);
  markProblems();
  paintStops();
}

// Append *line* to *row*, with tags, values and comments in colours. Return whether a comment goes on.
function colour(row, line, comment) {
  const token = /<!--|-->|<\/?[\w:.-]+|\/?>|"[^"]*"|'[^']*'/g;
  let at = 0, match;
  const add = (text, name) => text && row.append(name ? make("i", text, name) : text);
  while ((match = token.exec(line))) {
    const text = match[0];
    if (comment || text === "<!--") {
      add(line.slice(at, match.index), comment ? "c" : "");
      add(text, "c");
      comment = text !== "-->";
    } else {
      add(line.slice(at, match.index));
      add(text, /^["']/.test(text) ? "v" : "t");
    }
    at = match.index + text.length;
  }
  add(line.slice(at), comment ? "c" : "");
  return comment;
}

function goToLine(line, scroll = true) {
  const panel = byId("lines");
  panel.querySelector(".here")?.classList.remove("here");
  const row = panel.children[line - 1];
  row?.classList.add("here");
  if (row && scroll) {
    const top = row.offsetTop - panel.offsetTop;
    if (top < panel.scrollTop || top > panel.scrollTop + panel.clientHeight - 40) panel.scrollTop = top - panel.clientHeight / 3;
  }
}

function markProblems() {
  const diagnostics = state.document?.diagnostics ?? [];
  const rows = byId("lines").children;
  for (const row of byId("lines").querySelectorAll(".error, .warning")) row.classList.remove("error", "warning");
  for (const group of canvas.querySelectorAll("g.error, g.warning")) group.classList.remove("error", "warning");
  const shown = sourceFile(state.shownFile)?.name;
  for (const item of diagnostics) if (item.file === shown) rows[item.line - 1]?.classList.add(item.severity);
  // While the file is broken, its lines and the nodes of the last picture do not match.
  if (!state.document?.drawable || !state.drawing?.nodes) return;
  for (const item of diagnostics) {
    const file = state.drawing.files.findIndex((other) => other.name === item.file);
    const isIn = (node) => node.file === file && node.line <= item.line && item.line <= node.last
      && (node.line < item.line || node.column <= item.column);
    // Of several nodes in a line, the last that begins before the place. A tree may be called several times.
    const column = Math.max(...state.drawing.nodes.filter(isIn).map((node) => node.column));
    for (const node of state.drawing.nodes) {
      if (isIn(node) && node.column === column) state.groups.get(node.key)?.classList.add(item.severity);
    }
  }
}

// --- search

function search(moving = true) {
  const words = byId("search").value.trim().toLowerCase();
  canvas.classList.toggle("searching", Boolean(words));
  for (const group of canvas.querySelectorAll("g.found")) group.classList.remove("found");
  state.found = [];
  if (words && state.drawing?.nodes) {
    for (const node of state.drawing.nodes) {
      const texts = [node.name, node.id, node.calls, ...node.ports.flat()];
      if (!texts.some((text) => text.toLowerCase().includes(words))) continue;
      state.found.push(node.key);
      state.groups.get(node.key)?.classList.add("found");
    }
  }
  if (moving) { state.at = -1; if (state.found.length) nextFound(1); }
  byId("found").textContent = words ? (state.found.length ? `${state.at + 1}/${state.found.length}` : "none") : "";
}

function nextFound(step) {
  if (!state.found.length) return;
  state.at = (state.at + step + state.found.length) % state.found.length;
  select(state.found[state.at], { scroll: true });
  byId("found").textContent = `${state.at + 1}/${state.found.length}`;
}

// --- the running tree

function showLive(data) {
  if (data.keys) {
    state.liveKeys = data.keys;
    state.liveIndex = new Map(data.keys.map((key, index) => [key, index]));
  }
  state.live = data;
  const light = byId("light"), address = byId("address");
  light.className = data.connection;
  light.title = data.detail || "not connected";
  if (data.address && document.activeElement !== address) address.value = data.address;
  byId("connect").textContent = data.address ? "Disconnect" : "Connect";
  byId("continue").hidden = !data.stopped;
  paintLive();
  showEntries();
  showNotice();
  const node = state.keys.get(state.selected);
  if (node && byId("node").dataset.shown !== `${liveStatus(node.key)} ${data.wanted.includes(node.key)}`) {
    byId("node").dataset.shown = `${liveStatus(node.key)} ${data.wanted.includes(node.key)}`;
    showNode();
  }
}

const liveStatus = (key) => {
  const index = state.liveIndex?.get(key);
  return index === undefined ? null : Number(state.live.statuses[index]);
};

function paintLive() {
  const live = state.live;
  if (!live || !state.drawing?.nodes) return;
  const on = Boolean(live.connection) && state.liveKeys.length > 0;
  canvas.classList.toggle("live", on);
  for (const [key, group] of state.groups) {
    const index = on ? state.liveIndex.get(key) : undefined;
    const status = index === undefined ? "" : live.statuses[index];
    const result = status === "0" ? live.results[index] : "0";
    const code = on ? `${status}${result}` : "";
    if (group.dataset.live === code) continue;
    group.dataset.live = code;
    group.classList.remove("s0", "s1", "s2", "s3", "s4", "r2", "r3", "absent");
    group.removeAttribute("aria-description");
    if (!on) continue;
    if (status === "") group.classList.add("absent");
    else group.classList.add(`s${status}`);
    if (result !== "0") group.classList.add(`r${result}`);
    group.setAttribute("aria-description", STATUS_NAMES[status] ?? "not in the running tree");
  }
  canvas.querySelector("g.stopped")?.classList.remove("stopped");
  state.groups.get(live.stopped)?.classList.add("stopped");
  if (live.stopped && live.stopped !== state.stopped) state.groups.get(live.stopped)?.scrollIntoView({ block: "nearest", inline: "nearest" });
  state.stopped = live.stopped;
  paintStops();
}

function paintStops() {
  for (const dot of canvas.querySelectorAll(".stop")) dot.remove();
  for (const row of byId("lines").querySelectorAll(".stop")) row.classList.remove("stop");
  for (const key of state.live?.wanted ?? []) {
    const group = state.groups.get(key), node = state.keys.get(key);
    const pending = state.live.breakpoints.includes(key) ? "" : " pending";
    group?.append(draw("circle", { class: `stop${pending}`, r: 6.5 }));
    if (node && node.file === state.shownFile) byId("lines").children[node.line - 1]?.classList.add("stop");
  }
}

const shownValues = new Map();

function showEntries() {
  const { entries, connection } = state.live;
  byId("entries").hidden = !connection || !entries.length;
  if (!connection) return;
  const rows = [];
  let scope = null;
  for (const [path, key, value] of entries.slice(0, MAX_ENTRIES)) {
    if (path !== scope) {
      scope = path;
      if (path) {
        const head = make("tr", "", "scope"), cell = make("td", path);
        cell.colSpan = 2;
        head.append(cell);
        rows.push(head);
      }
    }
    const row = make("tr"), place = `${path}\0${key}`;
    if (shownValues.has(place) && shownValues.get(place) !== value) row.className = "new";
    shownValues.set(place, value);
    row.append(make("td", key), make("td", value));
    rows.push(row);
  }
  if (shownValues.size > 10 * MAX_ENTRIES) shownValues.clear();
  byId("entries").querySelector("tbody").replaceChildren(...rows);
}

async function toggleBreakpoint(key) {
  if (editor) {
    // The editor's margin has the breakpoints.
    const node = state.keys.get(key);
    editor.postMessage({ type: "breakpoint", file: state.drawing.files[node.file].name, line: node.line });
    return;
  }
  const wanted = new Set(state.live?.wanted ?? []);
  if (!wanted.delete(key)) wanted.add(key);
  await post("breakpoints", { keys: [...wanted] });
  showNode();
}

// --- the recording

let moving = false;

function showTimeline({ keys, count, start, width, colours }) {
  state.liveKeys = keys;
  state.liveIndex = new Map(keys.map((key, index) => [key, index]));
  byId("timeline").hidden = false;
  byId("summary").parentElement.hidden = true;
  byId("position").max = count;
  // The results of the root over time, a rectangle for each run of equal results.
  const strip = byId("colours");
  strip.setAttribute("viewBox", `0 0 ${Math.max(1, count)} 1`);
  for (const { 0: run, index } of colours.matchAll(/(.)\1*/g)) {
    strip.append(draw("rect", { class: `s${run[0]}`, x: index * width, width: run.length * width, height: 1 }));
  }
  goTo(start);
}

// Show the moment after a number of steps. While the pointer is dragged, the newest position counts.
async function goTo(position) {
  const { count } = state.document.recorded;
  state.position = Math.max(0, Math.min(count, position));
  byId("position").value = state.position;
  if (moving) return;
  moving = true;
  try {
    for (let shown = -1; shown !== state.position;) {
      const wanted = state.position;
      const data = await post("moment", { position: wanted });
      if (data.error) throw new Error(data.error);
      showMoment(data, wanted);
      // A part that is shown for the first time is run in several replies.
      if (data.position === wanted || data.problem) shown = wanted;
    }
  } catch {
    state.offline = true;
    showNotice();
  } finally {
    moving = false;
  }
}

function showMoment(data, wanted) {
  state.moment = data;
  const name = data.tick ? `Tick ${data.tick}` : data.position ? "Halt" : "Start";
  const time = `${data.time.toFixed(data.time < 100 ? 2 : 1)} s`;
  const label = byId("moment");
  label.replaceChildren(make("b", name), ` · ${time}`);
  if (data.position !== wanted && !data.problem) label.append(make("small", `  running to step ${wanted} …`));
  else if (data.tick) label.append(make("span", STATUS_NAMES[data.root], `status s${data.root}`));
  byId("position").setAttribute("aria-valuetext", `${name}, ${time}, ${STATUS_NAMES[data.root]}`);
  byId("back").disabled = !state.position;
  byId("forth").disabled = state.position === state.document.recorded.count;
  const problem = data.problem && `The recording cannot be run again from here on: ${data.problem}`;
  showLive({ ...data, problem, address: "", connection: "connected", detail: "", wanted: [], breakpoints: [], stopped: "" });
  showNode();
}

// --- controls

byId("back").onclick = () => goTo(state.position - 1);
byId("forth").onclick = () => goTo(state.position + 1);
byId("position").oninput = (event) => goTo(Number(event.target.value));

byId("tree").onchange = (event) => { state.tree = event.target.value; state.selected = ""; load(); };
byId("fold").onclick = foldSubtrees;
byId("unfold").onclick = unfoldAll;
byId("smaller").onclick = () => zoomTo(state.zoom / 1.25);
byId("larger").onclick = () => zoomTo(state.zoom * 1.25);
byId("fit").onclick = () => zoomTo(fitZoom());
byId("summary").onclick = () => {
  const list = byId("problems");
  list.hidden = !list.hidden;
  byId("summary").setAttribute("aria-expanded", String(!list.hidden));
};
byId("export").onclick = async () => {
  const data = await post("drawing", { tree: state.tree, folded: [...state.folded], styled: true });
  if (data.error) return;
  const name = `${data.tree.replace(/[^\w.-]+/g, "_") || "tree"}.svg`;
  if (editor) { editor.postMessage({ type: "export", name, svg: data.svg }); return; }
  const link = make("a");
  link.href = URL.createObjectURL(new Blob([data.svg], { type: "image/svg+xml" }));
  link.download = name;
  link.click();
  URL.revokeObjectURL(link.href);
};
byId("live").onsubmit = async (event) => {
  event.preventDefault();
  const address = state.live?.address ? "" : byId("address").value.trim() || byId("address").placeholder;
  state.rejected = (await post("watch", { address })).error ?? "";
  showNotice();
};
byId("continue").onclick = () => post("release");
byId("search").oninput = () => search();
byId("search").onkeydown = (event) => {
  if (event.key === "Enter") { nextFound(event.shiftKey ? -1 : 1); event.preventDefault(); }
  if (event.key === "Escape") { event.target.value = ""; search(); (canvas.querySelector("g[tabindex='0']") ?? canvas).focus(); }
};
byId("lines").onclick = (event) => {
  const row = event.target.closest("[data-line]");
  if (row && !getSelection().toString()) selectLine(sourceFile(state.shownFile).name, Number(row.dataset.line), false);
};

// The button that folds a node exists only while the pointer is on the node.
canvas.addEventListener("pointerover", (event) => {
  const group = event.target.closest?.("g[data-uid]");
  const node = group && nodeOf(group);
  for (const other of canvas.querySelectorAll("g.fold.passing")) if (other.parentNode !== group) other.remove();
  if (node && !node.leaf && !group.querySelector(".fold")) addFold(group);
});

let drag = null;
canvas.addEventListener("pointerdown", (event) => {
  if (event.button === 0) drag = { x: event.clientX, y: event.clientY, left: canvas.scrollLeft, top: canvas.scrollTop, moved: false };
});
window.addEventListener("pointermove", (event) => {
  if (!drag) return;
  const [dx, dy] = [event.clientX - drag.x, event.clientY - drag.y];
  drag.moved ||= Math.abs(dx) + Math.abs(dy) > 4;
  if (!drag.moved) return;
  canvas.classList.add("dragging");
  canvas.scrollTo(drag.left - dx, drag.top - dy);
});
window.addEventListener("pointerup", (event) => {
  const moved = drag?.moved;
  drag = null;
  canvas.classList.remove("dragging");
  if (moved || !canvas.contains(event.target) || event.button !== 0) return;
  const node = nodeOf(event.target);
  if (!node) return;
  if (event.target.closest(".fold")) toggleFold(node.key);
  else select(node.key);
});
canvas.addEventListener("dblclick", (event) => { const node = nodeOf(event.target); if (node) toggleFold(node.key); });
canvas.addEventListener("wheel", (event) => {
  if (!event.ctrlKey && !event.metaKey) return;
  event.preventDefault();
  const frame = canvas.getBoundingClientRect();
  zoomTo(state.zoom * Math.exp(-event.deltaY / 300), event.clientX - frame.left, event.clientY - frame.top);
}, { passive: false });
window.addEventListener("keydown", (event) => {
  if (event.target.matches("input, select") || event.ctrlKey || event.metaKey || event.altKey) return;
  const focused = focusedNode()?.key;
  const node = state.keys.get(focused ?? state.selected), nodes = state.drawing?.nodes ?? [];
  const siblings = node ? nodes.filter((other) => other.parent === node.parent) : [];
  const beside = (step) => siblings[siblings.findIndex((other) => other.key === node.key) + step];
  const go = {
    ArrowUp: () => node?.parent ? nodes[node.parent - 1] : nodes[0],
    ArrowDown: () => node ? (node.hidden ? null : nodes.find((other) => other.parent === node.index + 1)) : nodes[0],
    ArrowLeft: () => node && beside(-1),
    ArrowRight: () => node && beside(1),
  }[event.key];
  const isRecorded = Boolean(state.document?.recorded);
  const steps = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
  if (isRecorded && steps && !event.shiftKey) {
    goTo(state.position + steps);
    event.preventDefault();
    return;
  }
  const act = {
    "/": () => byId("search").focus(),
    "+": () => zoomTo(state.zoom * 1.25),
    "-": () => zoomTo(state.zoom / 1.25),
    0: () => zoomTo(fitZoom()),
    " ": () => node && toggleFold(node.key),
    Enter: () => focused && select(focused),
    b: () => node && state.document?.live && toggleBreakpoint(node.key),
  }[event.key];
  const onButton = event.target.matches("button") && (event.key === " " || event.key === "Enter");
  const inTree = !byId("lines").contains(event.target) && !onButton;
  if (go && inTree) { const next = go(); if (next) select(next.key, { scroll: true }); event.preventDefault(); }
  if (act && (inTree || event.key === "/") && (event.key !== "Enter" || focused)) { act(); event.preventDefault(); }
});

showNode();
listen();
load();
