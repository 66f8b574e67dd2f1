// The page: its layout, and what its parts share.

import "../studio.css";
import { batch, effect, signal, untracked } from "@preact/signals";
import { render } from "preact";
import { Announcer, followPage, notice, postponeReport } from "./announcer";
import { Canvas } from "./canvas";
import { ComparisonPage, loadComparison } from "./comparison";
import { Dialog } from "./dialog";
import { Mark } from "./documents";
import { Breadcrumbs, createFile, Files } from "./files";
import { keepFocus, movePane } from "./focus";
import { Form } from "./form";
import type { Done } from "./history";
import { BrowserHome, type EditorApi, EditorHome, type Home, isConnected, PageHome } from "./home";
import { Blackboard, call, drawnCall, LiveControls, noteChange, RunHint } from "./live";
import { noteEdit, receiveLive } from "./mock_run";
import { cursor } from "./operations";
import { Palette } from "./palette";
import { complete } from "./picture";
import { checked, followProblems, Problems } from "./problems";
import type {
  Command, Diagnostic, DiskConflict, Drawing, DrawingParams, EditParams, EditResult, Live, Palette as PaletteData, Place, Preview, ProofProgress,
  RealRun, SharedFile, WorkspaceEdit,
} from "./protocol";
import {
  actions, awaitDrawing, diagnostics, drawing, files, folded, isSamePlace, message, palette, reasonOf, refusedField, selectedNodes,
  selection, showError, start, tree, uri,
} from "./state";
import { noteProofEdit, Proof, receiveProgress } from "./proof";
import { LeafPlanForm } from "./question";
import { createQueue } from "./queue";
import { realRun, receiveRealRun } from "./real_run";
import { RpcError } from "./rpc";
import { RunBar } from "./run_bar";
import { SceneView } from "./scene";
import { ShownRunBar } from "./shown_run";
import { SiteHome } from "./site/home";
import { LinkedRecording, PythonNotice } from "./site/site_tools";
import { Splitter } from "./splitter";
import { revealText, TextPane } from "./text_pane";
import { texts, treeTexts } from "./texts";
import { Timeline } from "./timeline";
import { fileName, hiddenPanes, Toolbar } from "./toolbar";
import { view } from "./view";
import { WhatIfForm } from "./what_if";
import { Explanation } from "./why";

/** A drawing that takes longer waits for a pause in typing. */
const QUICK_MS = 100;
const TYPING_WAIT_MS = 60;
const PALETTE_WAIT_MS = 1000;

declare const acquireVsCodeApi: undefined | (() => EditorApi);

/** Return the home of this page: that of VS Code, of a site of static files, or of `btcore studio`. */
function findHome(): Home {
  if (typeof acquireVsCodeApi === "function") return new EditorHome(acquireVsCodeApi());
  return document.querySelector("script[data-home=site]") ? new SiteHome() : new BrowserHome();
}

const home = findHome();
const conflicts = signal<readonly DiskConflict[]>([]);

// --- the drawing

/** The changes since the texts of the drawing. */
let sinceDrawing = new Mark();
/** The number of drawings that were requested. Only one is awaited at a time; what was requested meanwhile is drawn once. */
let requested = 0;
/** Resolves when the last requested drawing is shown. */
let running: Promise<void> | null = null;
/** How long the last drawing took. */
let drawingMs = 0;
/** Whether the drawing of a text that changes is here already. */
let isDrawn = false;
/** The places to select when they are drawn. */
let toSelect: Place[] = [];

function redraw(): Promise<void> {
  requested += 1;
  running ??= awaitDrawing(drawAll()).finally(() => { running = null; });
  return running;
}

async function drawAll(): Promise<void> {
  for (let seen = -1; seen !== requested;) {
    seen = requested;
    if (uri.value) await draw();
  }
}

const drawingParams = (): DrawingParams => {
  const params = { textDocument: { uri: uri.value }, tree: tree.value, folded: [...folded.value], call: call.value?.key ?? "" };
  // VS Code's extension reads all nodes.
  return home.documents && drawing.value ? { ...params, since: drawing.value.number } : params;
};

async function draw(): Promise<void> {
  const mark = home.mark();
  const begun = performance.now();
  try {
    // A text that is open is drawn without a wait, before the parts of the page show its change.
    if (home.documents?.isOpen(uri.value) === false) await home.documents.load(uri.value);
    const [params, before] = [drawingParams(), drawing.value];
    const reply = await actions.request<Drawing>("btcore/drawing", params);
    if (params.textDocument.uri !== uri.value || params.tree !== tree.value) return;
    show(complete(reply, before), params, mark);
    drawingMs = performance.now() - begun;
  } catch (error) {
    if (isConnected.value) notice.value = texts.stale(reasonOf(error));
  }
}

/** @param mark What changes from the drawn texts on. */
function show(data: Drawing, params: DrawingParams, mark: Mark): void {
  sinceDrawing = mark;
  batch(() => {
    drawing.value = data;
    drawnCall.value = params.call;
  });
  notice.value = data.broken && texts.broken(data.broken);
  if (!mark.changes.size) selectPlaces(data);
}

function selectPlaces({ nodes }: Drawing): void {
  const keys = toSelect.flatMap((wanted) => {
    const node = nodes.find(({ place }) => isSamePlace(place, wanted));
    return node ? [node.key] : [];
  });
  if (keys.length) {
    selection.value = keys;
    view.value?.select(keys, true);
  }
  toSelect = [];
}

// --- commands

const commands = createQueue();
/** Run a command after the others, because each needs the text after the last. */
const inOrder = <T,>(run: () => Promise<T>): Promise<T> => awaitDrawing(commands(run));

/** Return the command with its places in the present text; null if an element is gone. */
function present(command: Command, since: Mark): Command | null {
  let isGone = false;
  const move = (place: Place): Place => {
    const position = home.documents ? home.documents.position(place.uri, place.position, since) : place.position;
    if (!position) isGone = true;
    return { uri: place.uri, position: position ?? place.position };
  };
  const moved = Object.fromEntries(Object.entries(command).map(([name, value]) => {
    if (name === "parent" || name === "node") return [name, move(value as Place)];
    return [name, name === "nodes" ? (value as Place[]).map(move) : value];
  })) as Command;
  return isGone ? null : moved;
}

function edit(command: Command): Promise<EditResult | null> {
  // The places are those of the present drawing, which earlier commands may replace.
  const [since, versions] = [sinceDrawing, drawing.value?.versions];
  return inOrder(async () => {
    if (start.value?.readOnly) {
      message.value = texts.readOnly;
      return null;
    }
    const moved = present(command, since);
    if (!moved) {
      message.value = texts.gone;
      return null;
    }
    try {
      const mark = home.mark();
      // VS Code may change the texts of the edit, and then draws them.
      const [wanted, shown, selected] = [drawingParams(), drawing.value, selection.value];
      const params: EditParams = { command: moved, ...(home.documents && { drawing: wanted }), ...(versions && { versions }) };
      const result = await actions.request<EditResult>("btcore/edit", params);
      toSelect = selection.value === selected ? result.select : []; // what the user has selected meanwhile stays
      const isSame = JSON.stringify(wanted) === JSON.stringify(drawingParams());
      const next = result.drawing && isSame && !mark.changes.size ? result.drawing : null;
      const before = requested;
      isDrawn = next !== null;
      await home.apply(result.edit, mark).finally(() => { isDrawn = false; });
      if (next) show(complete(next, shown), wanted, home.mark());
      if (moved.kind === "set_model" || moved.kind === "remove_model") waitForPalette(0);
      // A changed text is being drawn, or was drawn before VS Code replied.
      if (requested !== before) await running;
      else if (!next) await redraw();
      message.value = [treeTexts.edited(moved, selectedNodes.value.length, whereIsCursor()), ...result.notes].filter(Boolean).join(" ");
      if (result.drawing) showWarnings().catch(showError);
      return result;
    } catch (error) {
      showError(error);
      refusedField.value = error instanceof RpcError ? (error.data as { field?: string } | null)?.field ?? "" : "";
      return null;
    }
  });
}

/** Add the warnings of the last edit to its message. The next edit is requested later. */
async function showWarnings(): Promise<void> {
  const shown = message.value;
  const { messages } = await actions.request<{ messages: string[] }>("btcore/warnings", {});
  if (messages.length && message.value === shown) message.add(messages.join(" "));
}

/** Return the place of the selected node among its siblings in words, or "". */
function whereIsCursor(): string {
  const structure = view.value?.structure;
  const index = cursor();
  const parent = structure?.nodes[structure.parent(index)];
  return structure && parent ? treeTexts.placeOf(structure.positions[index]!, structure.siblings(index).length, parent.name) : "";
}

async function preview(command: Command): Promise<Preview> {
  const [moved, versions] = [present(command, sinceDrawing), drawing.value?.versions];
  if (!moved) throw new Error(texts.gone);
  return actions.request<Preview>("btcore/preview", { command: moved, ...(versions && { versions }) });
}

const apply = (change: WorkspaceEdit) => void inOrder(async () => {
  try {
    await home.apply(change, home.mark());
  } catch (error) {
    showError(error);
  }
});

async function move(step: () => Promise<Done | null>, moved: string, nothing: string): Promise<void> {
  await inOrder(async () => {
    const done = await step();
    if (!done) {
      if (home.documents) message.value = nothing;
      return;
    }
    const [first] = done.uris;
    if (first && !done.uris.includes(uri.value)) revealText({ uri: first, position: { line: 0, character: 0 } }, false);
    await (running ?? redraw()); // a changed text is being drawn already
    // In the text, the cursor shows what has changed.
    if (!document.activeElement?.closest(".text")) selection.value = done.selection;
    message.value = moved;
  });
}

/** The documents that this page has changed since it saved them. */
const changed = new Set<string>();

/** Save every file with changes: a command can change several. */
async function save(): Promise<void> {
  const unsaved = files.value.filter((file) => file.unsaved).map((file) => file.uri);
  const wanted = home.documents ? [...new Set([...unsaved, ...changed])] : [uri.value];
  const written: string[] = [];
  try {
    for (const address of wanted) {
      if (await home.save(address)) written.push(fileName(address));
      changed.delete(address);
    }
    message.value = written.length ? texts.saved(written.join(", ")) : texts.nothingToSave;
  } catch (error) {
    message.value = texts.saveRefused(reasonOf(error));
  }
}

Object.assign(actions, {
  request: (method, params) => home.connection.request(method, params),
  edit,
  preview,
  apply,
  undo: () => move(() => home.undo(), texts.undone, texts.nothingToUndo),
  redo: () => move(() => home.redo(), texts.redone, texts.nothingToRedo),
  save: () => inOrder(save),
  reveal: (place) => {
    if (home.documents) revealText(place);
    else home.reveal(place);
  },
} satisfies typeof actions);

// --- what the server notifies

home.connection.on<{ uri: string; diagnostics: Diagnostic[] }>("textDocument/publishDiagnostics", (params) => {
  const all = new Map(diagnostics.value);
  if (params.diagnostics.length) all.set(params.uri, params.diagnostics);
  else all.delete(params.uri);
  diagnostics.value = all;
  if (!checked.value.has(params.uri)) checked.value = new Set([...checked.value, params.uri]);
});
home.connection.on<Live>("btcore/live", receiveLive);
home.connection.on<ProofProgress>("btcore/proofProgress", receiveProgress);
home.connection.on<RealRun>("btcore/realRun", receiveRealRun);
home.connection.on<SharedFile[]>("btcore/files", (list) => { files.value = list; });
home.connection.on<DiskConflict>("btcore/disk", (conflict) => {
  conflicts.value = [...conflicts.value.filter((other) => other.uri !== conflict.uri), conflict];
});
home.connection.on<{ message: string }>("window/showMessage", (params) => { message.value = params.message; });
home.connection.on("workspace/semanticTokens/refresh", () => {
  if (start.value?.versions) {
    void loadComparison();
    return;
  }
  void redraw();
  waitForPalette(0);
});
home.connection.on("btcore/compared", () => void loadComparison());

async function resolve(conflict: DiskConflict, keep: "disk" | "page"): Promise<void> {
  try {
    await actions.request("btcore/resolve", { uri: conflict.uri, keep });
    conflicts.value = conflicts.value.filter((other) => other.uri !== conflict.uri);
  } catch (error) {
    showError(error);
  }
}

// --- what follows from changes

let typingTimer = 0, paletteTimer = 0;

function waitForPalette(ms: number): void {
  clearTimeout(paletteTimer);
  paletteTimer = window.setTimeout(async () => {
    const found = await actions.request<PaletteData>("btcore/palette", { textDocument: { uri: uri.value } }).catch(() => null);
    if (found && JSON.stringify(found) !== JSON.stringify(palette.value)) palette.value = found;
  }, ms);
}

home.onChange((address, origin) => {
  noteChange();
  noteEdit();
  noteProofEdit();
  if (origin !== "remote") changed.add(address);
  clearTimeout(typingTimer);
  postponeReport();
  if (origin === "typing" && drawingMs > QUICK_MS) typingTimer = window.setTimeout(redraw, TYPING_WAIT_MS);
  else if (!isDrawn || running) void redraw();
  waitForPalette(PALETTE_WAIT_MS);
});

// --- keys

/** How often the text of the field was undone by the browser, and can be repeated. */
const undone = new WeakMap<EventTarget, number>();
/** The text before the user changed it. A field of the form has the file's text in `data-text`. */
const before = new WeakMap<EventTarget, string>();
type TextField = HTMLInputElement | HTMLTextAreaElement;
const isTextField = (target: EventTarget | undefined): target is TextField =>
  target instanceof HTMLTextAreaElement
  || (target instanceof HTMLInputElement && !["checkbox", "radio", "range", "button", "submit"].includes(target.type));

addEventListener("focusin", ({ target }) => {
  if (target && isTextField(target)) before.set(target, target.value);
});
addEventListener("change", ({ target }) => {
  if (target && isTextField(target)) before.set(target, target.value);
});
addEventListener("input", (event) => {
  const { target } = event;
  if (!target || !isTextField(target) || !(event instanceof InputEvent)) return;
  const steps = { historyUndo: 1, historyRedo: -1 }[event.inputType];
  undone.set(target, steps ? (undone.get(target) ?? 0) + steps : 0);
});

/** Handle the keys of the page. Returns whether a key is the page's, or that of one of its fields. */
function handleKey(event: KeyboardEvent): boolean {
  if (event.defaultPrevented) return true;
  if (event.key === "F6" && home.documents && !event.ctrlKey && !event.altKey && !document.querySelector("dialog[open]")) {
    movePane(event.shiftKey ? -1 : 1);
    event.preventDefault();
    return true;
  }
  if (event.altKey || !(event.ctrlKey || event.metaKey)) return false;
  const key = event.key.toLowerCase();
  const isUndo = key === "z" && !event.shiftKey;
  const isRedo = key === "y" || (key === "z" && event.shiftKey);
  const target = event.composedPath()[0];
  if (isTextField(target)) {
    // In a field: first its own text, then the file.
    if (isUndo && target.value !== (target.dataset.text ?? before.get(target))) return true;
    if (isRedo && (undone.get(target) ?? 0) > 0) return true;
    undone.delete(target);
  }
  if (isUndo) void actions.undo();
  else if (isRedo) void actions.redo();
  else if (key === "s" && !event.shiftKey) void actions.save();
  else return false;
  event.preventDefault();
  return true;
}

// VS Code listens at the window. It would undo the file on Ctrl+Z in a field, too (its issue 227849).
document.addEventListener("keydown", (event) => {
  if (handleKey(event) && !home.documents) event.stopPropagation();
});
addEventListener("beforeunload", (event) => {
  if (!isConnected.value && home.documents) event.preventDefault();
});

// --- the layout

function Notices() {
  return (
    <div class="notices">
      {!isConnected.value && <p>{texts.lost}</p>}
      {home instanceof SiteHome && <PythonNotice home={home} />}
      {home instanceof SiteHome && <LinkedRecording home={home} />}
      {notice.value && <p>{notice.value}</p>}
      {start.value?.uri === "" && !uri.value && (
        <p>{texts.emptyFolder}{!start.value.readOnly && <> <button class="small" onClick={() => createFile()}>{texts.newFile}</button></>}</p>
      )}
      {conflicts.value.map((conflict) => (
        <p key={conflict.uri}>
          {texts.diskConflict(fileName(conflict.uri))}{" "}
          <button class="small" onClick={() => resolve(conflict, "disk")}>{texts.keepDisk}</button>{" "}
          <button class="small" onClick={() => resolve(conflict, "page")}>{texts.keepPage}</button>
        </p>
      ))}
    </div>
  );
}

function Page() {
  if (start.value?.versions) return <ComparisonPage versions={start.value.versions} />;
  return (
    <>
      <a class="skip" href="#picture">{texts.skip}</a>
      <header>
        <Toolbar home={home} />
        <span class="space" />
        <LiveControls />
      </header>
      <Notices />
      <div class={["panes", home.documents ? "" : "editor", ...[...hiddenPanes.value].map((name) => `no-${name}`)].join(" ")}>
        <aside class="left" aria-label={texts.palette}>
          <Files home={home} />
          <Palette />
          <Splitter name="left" label={texts.sizes.left} axis="x" direction={1} initial={230} min={140} />
        </aside>
        <main id="picture" tabIndex={-1}>
          <Breadcrumbs />
          <Canvas />
          <ShownRunBar home={home} />
          <Timeline />
          <RunBar home={home} />
          <Splitter name="right" label={texts.sizes.right} axis="x" direction={-1} initial={400} min={200} />
        </main>
        <aside class="right" aria-label={texts.node}>
          <div class="scrolled">
            <LeafPlanForm />
            <Explanation />
            <WhatIfForm />
            <Proof home={home} />
            <Form />
            {!realRun.value && <RunHint />}
            <SceneView />
            <Blackboard />
          </div>
          <Splitter name="form" label={texts.sizes.form} axis="y" direction={1} initial={340} min={80} />
        </aside>
        {home instanceof PageHome && <TextPane home={home} />}
      </div>
      <footer>
        {home.documents && <Problems />}
        <p class="message">{message.value}</p>
      </footer>
      <Announcer />
      <Dialog />
    </>
  );
}

async function begin(): Promise<void> {
  render(<Page />, document.body);
  keepFocus();
  followPage();
  try {
    const begun = await home.begin();
    start.value = begun;
    tree.value = begun.tree;
    uri.value = begun.uri;
    if (begun.versions) await loadComparison(begun.tree);
    else files.value = await actions.request<SharedFile[]>("btcore/files", {});
  } catch (error) {
    showError(error);
  }
}

effect(() => {
  const shown = fileName(uri.value || start.value?.versions?.findLast(Boolean) || "");
  document.title = shown ? `${shown} – ${texts.title}` : texts.title;
  if (uri.value) waitForPalette(0);
});
effect(() => {
  const shown = [uri.value, tree.value, folded.value, call.value?.key];
  untracked(() => void (shown[0] && redraw()));
});
// The language server reads files of the disk; it gets the texts that others have changed.
effect(() => {
  for (const file of files.value) if (file.unsaved) void home.documents?.load(file.uri).catch(() => {});
});
if (home.documents) followProblems(home);
void begin();
