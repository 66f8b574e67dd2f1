// The picture of the tree as elements: only visible cards exist. No card has listeners of its own.

import { effect, type ReadonlySignal, type Signal, signal } from "@preact/signals";
import { liveIndex } from "./live";
import { around, type Box, outline, overlaps } from "./picture";
import type { Change, Drawing, DrawnNode } from "./protocol";
import { drawing, folded, live, selection, severities } from "./state";
import { comparisonTexts, statuses, treeTexts } from "./texts";
import { inOrder, Structure } from "./tree";

const SVG = "http://www.w3.org/2000/svg";
export const ZOOM_STEP = 1.25;
const MIN_ZOOM = 0.08;
const MAX_ZOOM = 3;
/** Below this zoom the texts of many cards cannot be read, and are not drawn. */
const FAR = 0.28;
const MANY = 250;
/** Up to this number, all cards exist. */
const FEW = 60;
/** The least zoom with texts that can be read. */
const READABLE = 0.45;
/** Pixels around the visible part in which cards exist, too. */
const MARGIN = 300;
const MOVE_MS = 130;
/** The symbols ▶ ✔ ✘ ↷ of the statuses, and that of a tree that waits at a breakpoint. */
const MARKS: Record<string, string> = {
  1: "M-1.8-3.2L3.4 0L-1.8 3.2Z", 2: "M-3.6 .2L-1.1 2.8L3.6-2.8", 3: "M-3-3L3 3M3-3L-3 3",
  4: "M-3.6 2.4C-3-3 2-3.6 3.2 .8M.6 .4L3.3 1.4L4.2-1.4", stop: "M-1.8-3.2L-1.8 3.2M1.8-3.2L1.8 3.2",
};
const EMPTY = "<svg><g></g></svg>";

export const query = signal("");
/** The keys of the nodes that match the query. */
export const found = signal<readonly string[]>([]);

export function draw(tag: string, attributes: Record<string, string | number>, ...children: (Element | string)[]): SVGElement {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, String(value));
  element.append(...children);
  return element;
}

/** What a view shows. */
interface Source {
  drawing: ReadonlySignal<Drawing | null>;
  selection: Signal<readonly string[]>;
  folded: Signal<ReadonlySet<string>>;
  /** How the nodes differ from those of another version, by key. A view with changes is not edited. */
  changes?: ReadonlySignal<ReadonlyMap<string, readonly Change[]>>;
  /** Begins the IDs of elements. */
  prefix: string;
}

const PAGE: Source = { drawing, selection, folded, prefix: "node" };
export const CHANGE_SIGNS: Record<Change, string> = { added: "+", removed: "−", moved: "↔", changed: "≠" };

/** The elements of a card. They are kept in the next drawing if they have the same content. */
interface Group { element: SVGGElement; content: string }

export class View {
  drawing: Drawing | null = null;
  structure = new Structure([]);
  /** The box of each node in the drawing; undefined below a folded node. */
  boxes: (Box | undefined)[] = [];
  zoom = 0;
  /** The indices of the nodes with cards. */
  private cards: number[] = [];
  private svg: SVGSVGElement | null = null;
  /**
   * Has the size of the drawing. That of the SVG element follows from the zoom alone, because Chromium lays out
   * all texts of an SVG element again whenever its size is set.
   */
  private readonly extent = document.createElement("div");
  private layer: Element | null = null;
  /** The edges whose ends may be visible. */
  private readonly edges = draw("path", { class: "edge" });
  /** Insertion marks and other passing shapes, above the cards. */
  readonly marks = draw("g", { class: "marks" });
  /** Changes after each change of what is visible, and where. */
  readonly refreshed = signal(0);
  /** The cards that exist, by the index of their node. */
  private groups = new Map<number, Group>();
  private readonly foundKeys = new Set<string>();
  private refreshing = false;
  private readonly ends: (() => void)[] = [];

  constructor(readonly frame: HTMLElement, private readonly source = PAGE) {
    const later = () => this.refreshSoon();
    frame.addEventListener("scroll", later, { passive: true });
    const observer = new ResizeObserver(later);
    observer.observe(frame);
    this.extent.setAttribute("role", "none");
    frame.append(this.extent);
    this.ends.push(
      () => { frame.removeEventListener("scroll", later); observer.disconnect(); this.extent.remove(); },
      effect(() => this.show(source.drawing.value)),
      effect(() => { void [source.selection.value, source.changes?.value, severities.value, live.value, liveIndex.value]; this.dressAll(); }),
      effect(() => this.search(query.value)),
    );
  }

  close(): void {
    for (const end of this.ends) end();
  }

  // --- the drawing

  private show(next: Drawing | null): void {
    const before = this.drawing;
    if (next === before) return;
    const old = this.structure;
    const anchor = this.cursor;
    const oldBox = this.boxes[Math.max(0, anchor)];
    const oldPlace = oldBox && this.screen(oldBox);
    const isOther = !before || before.tree !== next?.tree;
    const isMoving = !isOther && !matchMedia("(prefers-reduced-motion: reduce)").matches;
    const places = isMoving ? this.placesByKey() : null;
    const wasWhole = Boolean(this.svg) && this.zoom <= this.fitZoom();
    this.drawing = next;
    if (!next) {
      this.svg?.remove();
      this.svg = null;
      this.extent.removeAttribute("style");
      this.structure = new Structure([]);
      this.boxes = [];
      return;
    }
    const structure = new Structure(next.nodes);
    this.structure = structure;
    this.boxes = next.nodes.map((node) => node.card ? node : undefined);
    this.cards = [...this.boxes.keys()].filter((index) => this.boxes[index]);
    if (next.svg !== before?.svg || !this.svg) this.build(next.svg);
    this.reuse(old);
    if (!this.zoom || isOther || !old.nodes.length) this.zoom = this.startZoom();
    // A picture that was wholly visible stays so, as long as its texts can be read.
    else if (wasWhole) this.zoom = Math.min(this.zoom, Math.max(READABLE, this.fitZoom()));
    this.resize();
    const kept = this.keep(old, isOther);
    const newBox = this.boxes[Math.max(0, structure.at(kept))];
    if (isOther || !old.nodes.length) this.centre(this.boxes[0]);
    else if (oldPlace && newBox) {
      const now = this.screen(newBox);
      this.frame.scrollBy(now.left - oldPlace.left, now.top - oldPlace.top);
    }
    // Before the cards exist, because a question about places lays out all elements.
    if (kept && anchor >= 0 && !isOther) this.reveal(structure.at(kept));
    this.find(query.peek());
    this.refresh();
    if (places) this.animate(places);
    performance.mark("drawn");
  }

  /** Keep the selection where the keys have changed, by the nodes' places in the tree. Return the cursor's key. */
  private keep(old: Structure, isOther: boolean): string {
    const keys = this.source.selection.peek();
    if (isOther || keys.length === 0 || keys.some((key) => this.structure.at(key) >= 0)) return keys.at(-1) ?? "";
    let index = old.at(keys.at(-1)!);
    if (index < 0) return "";
    const path: number[] = [];
    for (; old.parent(index) >= 0; index = old.parent(index)) path.unshift(old.positions[index]! - 1);
    let at = 0;
    for (const position of path) {
      const children = this.structure.children[at] ?? [];
      if (!children.length) break;
      at = children[Math.min(position, children.length - 1)]!;
    }
    const key = this.structure.nodes[at]?.key;
    this.source.selection.value = key ? [key] : [];
    return key ?? "";
  }

  /** Make what is around the cards and edges. */
  private build(text: string): void {
    // Chromium parses HTML three times as fast as XML. The server has escaped every text of the drawing.
    const template = document.createElement("template");
    template.innerHTML = text || EMPTY;
    const svg = template.content.firstElementChild as SVGSVGElement;
    svg.classList.add("picture");
    svg.setAttribute("role", "none");
    svg.setAttribute("viewBox", "0 0 1 1");
    svg.setAttribute("overflow", "visible");
    svg.querySelector(":scope > title")?.remove();
    const layer = svg.querySelector(":scope > g");
    if (!this.svg || !this.layer || !layer) {
      svg.prepend(hatching());
      layer?.append(this.edges, this.marks);
      this.svg?.remove();
      this.svg = svg;
      this.layer = layer;
      this.groups.clear();
      // Chromium makes groups of items that have an element without a role above them.
      layer?.setAttribute("role", "none");
      this.extent.append(svg);
      return;
    }
    // The layer with the cards stays where it is, so that the cards keep their layout.
    this.layer.setAttribute("transform", layer.getAttribute("transform") ?? "");
    for (const frame of this.layer.querySelectorAll(":scope > .frame")) frame.remove();
    this.layer.prepend(...layer.children);
    for (const other of [...this.svg.children]) if (other !== this.layer && other.tagName !== "defs") other.remove();
    const around = [...svg.children];
    const at = around.indexOf(layer);
    this.layer.before(...around.slice(0, at));
    this.layer.after(...around.slice(at + 1));
  }

  /** Keep the cards of the last drawing whose nodes and contents are the same, in their new places. */
  private reuse(old: Structure): void {
    const before = this.groups;
    this.groups = new Map();
    for (const [index, group] of before) {
      const next = this.structure.at(old.nodes[index]!.key);
      const node = this.structure.nodes[next];
      if (node?.card && group.content === this.contentOf(node) && !this.groups.has(next)) this.place(next, group);
      else group.element.remove();
    }
  }

  /** What the elements of a card depend on, besides its place and its number. */
  private contentOf({ card, id }: DrawnNode, isFar = this.isFar): string {
    return isFar ? outline(card) : `${card}\n${this.drawing!.about[id] ?? ""}`;
  }

  private place(index: number, group: Group): void {
    const { element } = group;
    const { x, y } = this.structure.nodes[index]!;
    this.groups.set(index, group);
    const number = String(index + 1);
    if (element.dataset.uid !== number) {
      element.dataset.uid = number;
      const written = element.querySelector(":scope > .uid");
      if (written) written.textContent = number;
    }
    set(element, "transform", `translate(${x} ${y})`);
    this.describe(index, element);
    this.dress(index, element);
  }

  /** Whether the texts of the cards cannot be read, and are not drawn. */
  private get isFar(): boolean {
    return this.zoom < FAR && this.cards.length > MANY;
  }

  /** The index of the node with the cursor, or -1. */
  private get cursor(): number {
    return this.structure.at(this.source.selection.peek().at(-1) ?? "");
  }

  /** Whether the cards show the statuses of a running tree. */
  private get isLive(): boolean {
    return Boolean(live.peek()?.connection) && liveIndex.peek().size > 0;
  }

  private get left(): number { return this.drawing?.left ?? 0; }
  private get top(): number { return this.drawing?.top ?? 0; }

  private get size(): { width: number; height: number } {
    return this.drawing?.svg ? this.drawing : { width: 100, height: 100 };
  }

  private resize(): void {
    if (!this.svg) return;
    for (const name of ["width", "height"] as const) {
      set(this.svg, name, String(this.zoom));
      this.extent.style[name] = `${Math.round(this.size[name] * this.zoom)}px`;
    }
  }

  private refreshSoon(): void {
    if (this.refreshing) return;
    this.refreshing = true;
    requestAnimationFrame(() => { this.refreshing = false; this.refresh(); });
  }

  /** Make the cards in the visible part, and remove the others. */
  refresh(): void {
    if (!this.layer || !this.svg) return;
    const { isFar } = this;
    const all = this.cards.length <= FEW;
    const area = this.visible(MARGIN);
    const { cursor } = this;
    const shown = this.cards.filter((index) => all || index === cursor || overlaps(this.boxes[index]!, area));
    const wanted = new Set(shown);
    for (const [index, { element }] of this.groups) {
      if (wanted.has(index) && (element.dataset.far === "1") === isFar) continue;
      element.remove();
      this.groups.delete(index);
    }
    const missing = shown.filter((index) => !this.groups.has(index));
    const { nodes } = this.structure;
    if (missing.length) {
      const template = document.createElement("template");
      template.innerHTML = `<svg>${missing.map((index) => `<g>${isFar ? outline(nodes[index]!.card) : nodes[index]!.card}</g>`).join("")}</svg>`;
      Array.from(template.content.firstElementChild!.children).forEach((made, position) => {
        const element = made as SVGGElement;
        const index = missing[position]!;
        if (isFar) element.dataset.far = "1";
        const about = this.drawing!.about[nodes[index]!.id];
        if (about) element.querySelector(":scope > title")?.append(`\n${about}`);
        this.place(index, { element, content: this.contentOf(nodes[index]!, isFar) });
      });
    }
    // The groups are in the order of the tree, for screen readers.
    inOrder(this.layer, shown.map((index) => this.groups.get(index)!.element), this.marks);
    set(this.edges, "d", this.visibleEdges(area, all));
    this.markActive();
    this.refreshed.value = this.refreshed.peek() + 1;
  }

  /** Return the edges in a part of the drawing as one path. An edge is in the box around both of its cards. */
  private visibleEdges(area: Box, all: boolean): string {
    return this.cards.map((index) => {
      const { x, y, edge } = this.structure.nodes[index]!;
      const [box, parent] = [this.boxes[index]!, this.boxes[this.structure.parent(index)]];
      return edge && (all || (parent && overlaps(around(box, parent), area))) ? `M${x} ${y}${edge}` : "";
    }).join("");
  }

  /** Describe a node to screen readers: a flat tree, whose items have levels and positions. */
  private describe(index: number, group: SVGGElement): void {
    const node = this.structure.nodes[index]!;
    set(group, "id", `${this.source.prefix}-${index + 1}`);
    set(group, "role", "treeitem");
    set(group, "aria-level", String(this.structure.levels[index]));
    set(group, "aria-posinset", String(this.structure.positions[index]));
    set(group, "aria-setsize", String(this.structure.siblings(index).length));
    if (node.leaf) group.removeAttribute("aria-expanded");
    else set(group, "aria-expanded", String(!node.hidden));
  }

  /** Give a group the classes of its present state. */
  private dress(index: number, group: SVGGElement): void {
    const node = this.structure.nodes[index]!;
    const keys = this.source.selection.peek();
    const isSelected = keys.includes(node.key);
    const classes = ["node"];
    if (isSelected) classes.push("selected");
    if (keys.at(-1) === node.key) classes.push("cursor");
    if (this.structure.disabled[index]) classes.push("disabled");
    if (this.foundKeys.has(node.key)) classes.push("found");
    const severity = severities.peek().get(node.key);
    if (severity) classes.push(severity === 1 ? "error" : "warning");
    const state = live.peek();
    const { isLive } = this;
    const isRaised = isLive && state?.raised === node.key;
    const isStopped = isLive && state?.stopped === node.key;
    const spoken = severity ? [treeTexts.severity[severity]] : [];
    let status = "", result = "0";
    const changes = this.source.changes?.peek().get(node.key) ?? [];
    classes.push(...changes);
    if (changes.length) spoken.unshift(comparisonTexts.list(changes));
    const sign = changes.map((change) => CHANGE_SIGNS[change]).join(" ");
    const badge = group.querySelector(":scope > .change");
    if (badge?.lastElementChild?.textContent !== sign) {
      badge?.remove();
      if (sign) group.append(changeBadge(sign));
    }
    if (isLive && state) {
      const at = liveIndex.peek().get(node.key);
      if (at !== undefined) status = state.statuses[at] ?? "";
      if (status === "0") result = state.results[at!] ?? "0";
      classes.push(status === "" ? "absent" : `s${status}`);
      if (result !== "0") {
        classes.push(`r${result}`);
        spoken.unshift(treeTexts.lastResult(statuses[Number(result)]!));
      }
      if (isStopped) classes.push("stopped");
      if (isRaised) {
        classes.push("raised");
        spoken.unshift(treeTexts.raised);
      }
      spoken.unshift(status === "" ? treeTexts.absent : statuses[Number(status)]!);
    }
    this.mark(index, group, isStopped ? "stop" : isRaised ? "3" : result !== "0" ? result : status);
    const stop = state?.wanted.includes(node.key) ? (state.breakpoints.includes(node.key) ? "set" : "pending") : "";
    const dot = group.querySelector(":scope > .stop");
    if (stop && !dot) group.append(draw("circle", { class: "stop", r: 6.5 }));
    else if (!stop) dot?.remove();
    if (stop) group.querySelector(":scope > .stop")!.classList.toggle("pending", stop === "pending");
    const name = classes.join(" ");
    set(group, "class", name);
    set(group, "aria-selected", String(isSelected));
    set(group, "aria-label", treeTexts.nodeLabel(node, this.structure.disabled[index]!, stop, isStopped));
    // The ports distinguish nodes with the same name.
    spoken.push(...node.ports.map(([name, text]) => `${name} ${text}`));
    if (spoken.length) set(group, "aria-description", spoken.join(", "));
    else group.removeAttribute("aria-description");
    this.dressButtons(index, group, keys.length === 1 && isSelected);
  }

  /** Show the symbol of a status on a card, so that statuses differ by more than their colours. */
  private mark(index: number, group: SVGGElement, status: string): void {
    const path = group.dataset.far === "1" ? "" : MARKS[status] ?? "";
    const mark = group.querySelector(":scope > .mark");
    if (!path) mark?.remove();
    else if (mark) set(mark.lastElementChild!, "d", path);
    else {
      group.append(draw("g", { class: "mark", transform: `translate(14 ${this.boxes[index]!.height})`, "aria-hidden": "true" },
        draw("circle", { r: 7.5 }), draw("path", { d: path })));
    }
  }

  dressAll(): void {
    this.frame.classList.toggle("live", this.isLive);
    for (const [index, { element }] of this.groups) this.dress(index, element);
    const { cursor } = this;
    if (cursor >= 0 && !this.groups.has(cursor)) this.refresh();
    this.markActive();
  }

  private markActive(): void {
    const { cursor } = this;
    if (cursor >= 0 && this.groups.has(cursor)) this.frame.setAttribute("aria-activedescendant", `${this.source.prefix}-${cursor + 1}`);
    else this.frame.removeAttribute("aria-activedescendant");
  }

  // --- the buttons of a card, while it is selected or under the pointer

  hovered = -1;

  hover(index: number): void {
    if (index === this.hovered) return;
    const before = this.hovered;
    this.hovered = index;
    for (const other of [before, index]) {
      const group = this.group(other);
      if (group) this.dress(other, group);
    }
  }

  private dressButtons(index: number, group: SVGGElement, isSelected: boolean): void {
    if (this.source.changes) return;
    const node = this.structure.nodes[index]!;
    const card = this.boxes[index]!;
    const isFar = group.dataset.far === "1";
    const hasFold = !isFar && (isSelected || this.hovered === index) && !node.leaf && !node.hidden;
    const hasAdd = !isFar && isSelected && this.structure.canTake(index, 1);
    const fold = group.querySelector(":scope > .fold.passing");
    const add = group.querySelector(":scope > .adds");
    if (!hasFold) fold?.remove();
    else if (!fold) group.append(button("fold passing", card.width / 2, card.height + 4, "M-4 0L4 0", treeTexts.hideNodes));
    if (!hasAdd) add?.remove();
    else if (!add) group.append(button("adds", card.width - 16, card.height + 4, "M-4 0L4 0M0-4L0 4", treeTexts.addChild));
  }

  // --- geometry

  /** Return the point of the drawing at a point of the screen. */
  point(clientX: number, clientY: number): [number, number] {
    const box = this.svg?.getBoundingClientRect() ?? new DOMRect();
    return [(clientX - box.left) / this.zoom - this.left, (clientY - box.top) / this.zoom - this.top];
  }

  /** Return a box of the drawing on the screen. */
  screen(box: Box): DOMRect {
    const outer = this.svg?.getBoundingClientRect() ?? new DOMRect();
    return new DOMRect(
      outer.left + (box.x + this.left) * this.zoom, outer.top + (box.y + this.top) * this.zoom,
      box.width * this.zoom, box.height * this.zoom);
  }

  private visible(margin: number): Box {
    const frame = this.frame.getBoundingClientRect();
    const [x, y] = this.point(frame.left - margin, frame.top - margin);
    return { x, y, width: (frame.width + 2 * margin) / this.zoom, height: (frame.height + 2 * margin) / this.zoom };
  }

  /** Return the index of the node under an element, or -1. */
  nodeAt(target: EventTarget | null): number {
    const group = target instanceof Element ? target.closest<SVGGElement>("g[data-uid]") : null;
    return group && this.frame.contains(group) ? Number(group.dataset.uid) - 1 : -1;
  }

  group(index: number): SVGGElement | undefined {
    return this.groups.get(index)?.element;
  }

  /** Scroll so that a node is visible. */
  reveal(index: number): void {
    const box = this.boxes[index];
    if (!box) return;
    const [card, frame] = [this.screen(box), this.frame.getBoundingClientRect()];
    const margin = 24;
    const shift = (low: number, high: number, from: number, to: number) =>
      low < from + margin ? low - from - margin : high > to - margin ? Math.min(high - to + margin, low - from - margin) : 0;
    this.frame.scrollBy(
      shift(card.left, card.right, frame.left, frame.right), shift(card.top, card.bottom, frame.top, frame.bottom));
  }

  private centre(box: Box | undefined): void {
    if (!box) return;
    const [card, frame] = [this.screen(box), this.frame.getBoundingClientRect()];
    this.frame.scrollLeft += card.left + card.width / 2 - frame.left - frame.width / 2;
  }

  // --- zoom

  private fitZoom(): number {
    const { width, height } = this.size;
    return Math.min((this.frame.clientWidth - 4) / width, (this.frame.clientHeight - 4) / height);
  }

  private startZoom(): number {
    // A tree that is too large for readable texts is scrolled.
    const zoom = this.fitZoom();
    return zoom < READABLE ? 0.6 : Math.min(1.15, zoom);
  }

  fit(): void {
    this.zoomTo(this.fitZoom());
  }

  /** Zoom, so that a point of the screen keeps its place; by default the middle. */
  zoomTo(zoom: number, clientX?: number, clientY?: number): void {
    if (!this.svg) return;
    const frame = this.frame.getBoundingClientRect();
    const [atX, atY] = [clientX ?? frame.left + frame.width / 2, clientY ?? frame.top + frame.height / 2];
    const [x, y] = this.point(atX, atY);
    this.zoom = Math.max(MIN_ZOOM, Math.min(MAX_ZOOM, zoom));
    this.resize();
    const now = this.screen({ x, y, width: 0, height: 0 });
    this.frame.scrollBy(now.left - atX, now.top - atY);
    this.refreshSoon();
  }

  // --- movement of the cards to their new places

  private placesByKey(): Map<string, Box> {
    const places = new Map<string, Box>();
    for (const index of this.groups.keys()) places.set(this.structure.nodes[index]!.key, this.boxes[index]!);
    return places;
  }

  private animate(before: Map<string, Box>): void {
    if (this.groups.size > MANY / 2) return;
    for (const [index, { element: group }] of this.groups) {
      const box = this.boxes[index]!;
      const old = before.get(this.structure.nodes[index]!.key);
      if (!old) group.animate([{ opacity: 0 }, { opacity: 1 }], MOVE_MS);
      else if (old.x !== box.x || old.y !== box.y) {
        const frames = [old, box].map(({ x, y }) => ({ transform: `translate(${x}px, ${y}px)` }));
        group.animate(frames, { duration: MOVE_MS, easing: "ease-out" });
      }
    }
  }

  // --- search

  private search(words: string): void {
    this.find(words);
    for (const [index, { element }] of this.groups) this.dress(index, element);
    if (found.peek().length) this.select([found.peek()[0]!], true);
  }

  /** Note the nodes that match the query. */
  private find(words: string): void {
    const wanted = words.trim().toLowerCase();
    this.frame.classList.toggle("searching", Boolean(wanted));
    this.foundKeys.clear();
    const keys: string[] = [];
    if (wanted) {
      for (const node of this.structure.nodes) {
        const parts = [node.name, node.id, node.calls, ...node.ports.flat()];
        if (!parts.some((text) => text.toLowerCase().includes(wanted))) continue;
        keys.push(node.key);
        this.foundKeys.add(node.key);
      }
    }
    found.value = keys;
  }

  // --- selection and folding

  /** Select nodes; the last one is the cursor. */
  select(keys: readonly string[], isRevealing = false): void {
    this.source.selection.value = keys;
    const index = this.structure.at(keys.at(-1) ?? "");
    if (index < 0 || !isRevealing) return;
    this.unfoldAbove(index);
    this.reveal(index);
  }

  private unfoldAbove(index: number): void {
    const keys = new Set(this.source.folded.peek());
    let isChanged = false;
    for (let above = this.structure.parent(index); above >= 0; above = this.structure.parent(above)) {
      if (this.structure.nodes[above]!.hidden) isChanged = keys.delete(this.structure.nodes[above]!.key) || isChanged;
    }
    if (isChanged) this.source.folded.value = keys;
  }

  toggleFold(index: number): void {
    const node = this.structure.nodes[index];
    if (!node || node.leaf) return;
    const keys = new Set(this.source.folded.peek());
    if (node.hidden) keys.delete(node.key);
    else keys.add(node.key);
    this.source.folded.value = keys;
  }

  foldSubtrees(): void {
    const calls = this.structure.nodes.filter((node) => node.calls && node.parent);
    this.source.folded.value = new Set([...this.source.folded.peek(), ...calls.map((node) => node.key)]);
  }

  unfoldAll(): void {
    this.source.folded.value = new Set();
  }
}

/** Set an attribute, unless it has the value: the browser would compute styles again. */
function set(element: Element, name: string, value: string): void {
  if (element.getAttribute(name) !== value) element.setAttribute(name, value);
}

function button(name: string, x: number, y: number, path: string, title: string): SVGElement {
  return draw("g", { class: name, transform: `translate(${x} ${y})` },
    draw("title", {}, title), draw("circle", { class: "pill", r: 8 }), draw("path", { class: "sign", d: path }));
}

/** Return the sign of a changed node, at the corner of its card. */
function changeBadge(sign: string): SVGElement {
  const width = 8 + 11 * sign.length;
  return draw("g", { class: "change" },
    draw("rect", { x: -9, y: -9, width, height: 19, rx: 9.5 }), draw("text", { x: width / 2 - 9, y: 5 }, sign));
}

/** The pattern of disabled nodes, and their cards' second fill. */
function hatching(): SVGElement {
  return draw("defs", {},
    draw("pattern", { id: "hatch", width: 8, height: 8, patternUnits: "userSpaceOnUse", patternTransform: "rotate(45)" },
      draw("rect", { class: "hatch-back", width: 8, height: 8 }), draw("rect", { class: "hatch-line", width: 2.4, height: 8 })));
}

/** Call *zoom* when the wheel turns while Ctrl is down. Return a function that ends it. */
export function followWheel(frame: HTMLElement, zoom: (factor: number, clientX: number, clientY: number) => void): () => void {
  const wheel = (event: WheelEvent) => {
    if (!event.ctrlKey && !event.metaKey) return;
    event.preventDefault();
    zoom(Math.exp(-event.deltaY / 300), event.clientX, event.clientY);
  };
  // Preact adds wheel listeners as passive ones in some browsers.
  frame.addEventListener("wheel", wheel, { passive: false });
  return () => frame.removeEventListener("wheel", wheel);
}

/** The view of the page; null before the canvas exists. */
export const view = signal<View | null>(null);

/** Give the keys to the picture. */
export const focusPicture = (): void => view.value?.frame.focus({ preventScroll: true });
