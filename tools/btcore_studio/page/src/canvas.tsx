// The picture of the tree: it is scrolled, zoomed, searched, and edited by mouse, touch and keys.

import "./tree.css";
import { useEffect, useRef } from "preact/hooks";
import { followPointers } from "./drag";
import { backTo } from "./files";
import { type Action, actionOf, type Direction, isForPage, keyOf, neighbour, type PageAction } from "./keyboard";
import { CallChoice, durationOf, liveIndex, notes } from "./live";
import { Help, Menu } from "./menu";
import { advance, answerQuestion, mockRun, step, togglePlay } from "./mock_run";
import { ModelForm } from "./model_form";
import { cursor, edit, inTurn, openTree, paste, run } from "./operations";
import { Question } from "./question";
import { Quick } from "./quick";
import { help, menu } from "./quick_state";
import { drawing, selection, start, uri } from "./state";
import { treeTexts } from "./texts";
import { shownRun } from "./timeline";
import { explain } from "./why";
import { draw, focusPicture, followWheel, found, query, View, view, ZOOM_STEP } from "./view";

/** The picture of the tree, and what opens above it. */
export function Canvas() {
  const frame = useRef<HTMLDivElement>(null);
  useEffect(() => {
    const shown = new View(frame.current!);
    view.value = shown;
    if (document.activeElement === document.body && document.hasFocus()) focusPicture();
    const ends = [
      followPointers(shown, (index, event) => click(shown, index, event)), followKeys(shown), showDurations(shown),
      followWheel(shown.frame, (factor, x, y) => shown.zoomTo(shown.zoom * factor, x, y)),
    ];
    return () => {
      for (const end of ends) end();
      shown.close();
      view.value = null;
    };
  }, []);
  const contextMenu = (event: MouseEvent) => {
    event.preventDefault();
    const shown = view.value!;
    const index = shown.nodeAt(event.target);
    if (index >= 0 && !selection.value.includes(shown.structure.nodes[index]!.key)) shown.select([shown.structure.nodes[index]!.key]);
    menu.value = { x: event.clientX, y: event.clientY };
  };
  const doubleClick = (event: MouseEvent) => {
    const shown = view.value!;
    const index = shown.nodeAt(event.target);
    const node = shown.structure.nodes[index];
    if (!node || (event.target as Element).closest(".fold, .adds")) return;
    if (node.calls) openTree(node);
    else run("rename");
  };
  return (
    <section class="canvas-pane" aria-label={treeTexts.picture}>
      <div
        ref={frame} class={`canvas ${drawing.value?.broken ? "broken" : ""}`} role="tree" tabIndex={0}
        aria-label={treeTexts.treeLabel(drawing.value?.tree ?? "")} aria-multiselectable="true"
        onContextMenu={contextMenu} onDblClick={doubleClick}
      />
      <EmptyTree />
      <Controls />
      <div class="canvas-notes">
        <CallChoice />
        <div role="status">{notes.value.map((note) => <p key={note}>{note}</p>)}</div>
      </div>
      <Question />
      <Quick />
      <Menu />
      <Help />
      <ModelForm />
    </section>
  );
}

/** What is shown in place of a tree without nodes. */
function EmptyTree() {
  const shown = drawing.value;
  if (!shown || shown.nodes.length || start.value?.readOnly) return null;
  if (!shown.trees.length) {
    return (
      <div class="empty-tree">
        <p>{treeTexts.noTree}</p>
        <button class="primary" onClick={() => void edit({ kind: "add_tree", uri: uri.value, id: "Main" })}>{treeTexts.createTree}</button>
      </div>
    );
  }
  return (
    <div class="empty-tree">
      <p>{treeTexts.emptyTree}</p>
      <button class="primary" onClick={() => run("insert")}>{treeTexts.insertRoot}</button>
    </div>
  );
}

export function ZoomButtons({ zoom, fit }: { zoom: (factor: number) => void; fit: () => void }) {
  return (
    <>
      <button title={treeTexts.zoomOut} aria-label={treeTexts.zoomOut} onClick={() => zoom(1 / ZOOM_STEP)}>−</button>
      <button title={treeTexts.fitTitle} onClick={fit}>{treeTexts.fit}</button>
      <button title={treeTexts.zoomIn} aria-label={treeTexts.zoomIn} onClick={() => zoom(ZOOM_STEP)}>+</button>
    </>
  );
}

/** Search and zoom. */
function Controls() {
  const keys = found.value;
  const at = keys.indexOf(selection.value.at(-1) ?? "");
  const go = (step: number) => {
    if (keys.length) view.value?.select([keys[(at + step + keys.length) % keys.length]!], true);
  };
  const searchKey = (event: KeyboardEvent) => {
    if (event.key === "Enter") { event.preventDefault(); go(event.shiftKey ? -1 : 1); }
    if (event.key === "Escape") { query.value = ""; focusPicture(); }
  };
  return (
    <>
      <div class="canvas-search">
        <input
          id="search" type="search" placeholder={`${treeTexts.search}   /`} aria-label={treeTexts.search} value={query.value}
          onInput={(event) => { query.value = event.currentTarget.value; }} onKeyDown={searchKey}
        />
        <output>{query.value.trim() && (keys.length ? `${at + 1}/${keys.length}` : treeTexts.noneFound)}</output>
      </div>
      <div class="canvas-controls" role="group" aria-label={treeTexts.zoom}>
        <ZoomButtons zoom={(factor) => view.value?.zoomTo(view.value.zoom * factor)} fit={() => view.value?.fit()} />
        <button title={treeTexts.foldTitle} onClick={() => view.value?.foldSubtrees()}>{treeTexts.fold}</button>
        <button title={treeTexts.unfoldTitle} onClick={() => view.value?.unfoldAll()}>{treeTexts.unfold}</button>
        <button title={treeTexts.helpTitle} aria-label={treeTexts.helpTitle} onClick={() => { help.value = true; }}>?</button>
      </div>
    </>
  );
}

// --- clicks

function click(shown: View, index: number, event: PointerEvent): void {
  focusPicture();
  const target = event.target as Element;
  const node = shown.structure.nodes[index];
  if (!node) {
    if (!event.shiftKey && !event.ctrlKey) shown.select([]);
    return;
  }
  if (target.closest(".adds")) run("insert");
  else if (target.closest(".fold")) shown.toggleFold(index);
  else if (event.ctrlKey || event.metaKey) {
    const others = selection.value.filter((key) => key !== node.key);
    shown.select(others.length < selection.value.length ? others : [...others, node.key]);
  } else if (event.shiftKey) shown.select(between(shown, index));
  else shown.select([node.key]);
}

/** Return the keys of the siblings from the cursor to a node; of the node alone, if they are not siblings. */
function between(shown: View, index: number): string[] {
  const { structure } = shown;
  const siblings = structure.siblings(index);
  const [start, end] = [siblings.indexOf(cursor()), siblings.indexOf(index)];
  if (start < 0) return [...new Set([...selection.value, structure.nodes[index]!.key])];
  const row = siblings.slice(Math.min(start, end), Math.max(start, end) + 1);
  return (start > end ? row.reverse() : row).map((other) => structure.nodes[other]!.key);
}

// --- keys

/** Whether an event belongs to a field, also to the editor in its shadow root. */
function isField(event: Event): boolean {
  const target = event.composedPath()[0];
  return target instanceof Element && target.closest("input, textarea, select, [contenteditable], dialog, [role=menu]") !== null;
}

function followKeys(shown: View): () => void {
  const down = (event: KeyboardEvent) => {
    if (isField(event) || event.defaultPrevented || event.isComposing) return;
    const action = actionOf(keyOf(event));
    if (!action) return;
    const target = event.target instanceof Element ? event.target : null;
    // A click beside a field of the form must not make typed letters operations.
    const isHere = shown.frame.contains(target);
    if (!isHere && !isForPage(action)) return;
    // Text that is selected elsewhere is copied by the browser.
    if ("operation" in action && action.operation === "copy" && getSelection()?.toString()) return;
    event.preventDefault();
    act(shown, action);
  };
  const pasted = (event: ClipboardEvent) => {
    if (isField(event) || !shown.frame.contains(document.activeElement)) return;
    event.preventDefault();
    const xml = event.clipboardData?.getData("text/plain") ?? "";
    inTurn(() => paste(xml));
  };
  addEventListener("keydown", down);
  addEventListener("paste", pasted);
  return () => {
    removeEventListener("keydown", down);
    removeEventListener("paste", pasted);
  };
}

function act(shown: View, action: Action): void {
  if ("operation" in action) run(action.operation);
  else if ("select" in action) inTurn(() => selectNeighbour(shown, action));
  else {
    const { structure } = shown;
    const box = shown.boxes[cursor()];
    const place = box ? shown.screen(box) : shown.frame.getBoundingClientRect();
    const page: Record<PageAction, () => unknown> = {
      all: () => { selection.value = structure.nodes.map((node) => node.key); },
      none: () => { if (selection.value.length || !backTo()) shown.select([]); },
      search: () => document.getElementById("search")?.focus(),
      larger: () => shown.zoomTo(shown.zoom * ZOOM_STEP), smaller: () => shown.zoomTo(shown.zoom / ZOOM_STEP),
      fit: () => shown.fit(), help: () => { help.value = true; },
      menu: () => { menu.value = { x: place.left + 20, y: Math.min(place.bottom, innerHeight - 80) }; },
      back: () => step(-1), forth: () => step(1), play: togglePlay, why: explain,
      into: () => advance("into"), over: () => advance("over"), outOf: () => advance("out"),
      succeed: () => answerQuestion("S"), fail: () => answerQuestion("F"), keepRunning: () => answerQuestion("R"),
      form: () => document.querySelector<HTMLElement>(".form input, .form textarea, .form select")?.focus(),
    };
    void page[action.page]();
  }
}

function selectNeighbour(shown: View, { select, isExtending }: { select: Direction; isExtending: boolean }): void {
  const { structure } = shown;
  const node = structure.nodes[neighbour(structure, cursor(), select)];
  if (!node) return;
  const others = isExtending ? selection.value.filter((key) => key !== node.key) : [];
  shown.select([...others, node.key], true);
}

// --- durations of running nodes

function showDurations(shown: View): () => void {
  const timer = setInterval(() => {
    if (document.hidden || start.value?.recording || shownRun.value || mockRun.value) return;
    if (!liveIndex.peek().size) for (const label of shown.frame.querySelectorAll(".duration")) label.remove();
    for (const [key] of liveIndex.peek()) {
      const index = shown.structure.at(key);
      const group = shown.group(index);
      const box = shown.boxes[index];
      if (!group || !box) continue;
      const duration = durationOf(key);
      let label = group.querySelector(":scope > .duration");
      if (!duration || duration.seconds < 0.05) { label?.remove(); continue; }
      if (!label) {
        label = draw("text", { class: "duration", x: box.width, y: box.height + 12 });
        group.append(label);
      }
      label.textContent = treeTexts.seconds(duration.seconds);
      label.classList.toggle("runs", duration.isRunning);
    }
  }, 200);
  return () => clearInterval(timer);
}

