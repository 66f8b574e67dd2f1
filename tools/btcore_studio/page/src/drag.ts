// Dragging with a mouse or a finger: nodes and palette items to their new places, and the picture itself.

import { effect } from "@preact/signals";
import { type Box, isSamePicture, overlaps } from "./picture";
import { DropTargets, type Load, type Target } from "./drop_targets";
import { noteUse } from "./last_used";
import { chosen, edit, inTurn, xmlOf } from "./operations";
import { levelOf, type MakeCommand, type PreviewResult, previewer, warningOf } from "./preview";
import type { Command, PaletteItem, Place } from "./protocol";
import { menu } from "./quick_state";
import { drawing, message, palette, selection, showError, start } from "./state";
import { canWrap, placeOfTree } from "./tree";
import { treeTexts } from "./texts";
import { draw, focusPicture, type View, view } from "./view";

const THRESHOLD = 4;
const LONG_PRESS_MS = 380;
const MOUSE_EVENTS_MS = 60;
/** Pixels from the edge of the canvas in which dragging scrolls. */
const EDGE = 48;
const SPEED = 14;

/** What is dragged: nodes of the tree, or an item of the palette. */
type Source = { nodes: readonly number[] } | { item: PaletteItem };

let dragging: Drag | null = null;

class Drag {
  private readonly ghost: HTMLElement;
  private readonly targets: DropTargets;
  private target: Target | null = null;
  /** Previews the command of a drop. */
  private readonly requestPreview: (make: MakeCommand | null) => void;
  /** What was previewed last: the target, and whether it is a copy. */
  private previewed = "";
  private isCopy: boolean;
  private frame = 0;
  private readonly unfollow: () => void;

  constructor(private readonly view: View, private readonly source: Source, private x: number, private y: number, isCopy: boolean) {
    this.isCopy = isCopy;
    this.ghost = this.makeGhost();
    this.requestPreview = previewer((preview) => this.warn(preview));
    document.body.append(this.ghost);
    document.body.classList.add("drags-node");
    this.targets = new DropTargets(view.structure, view.boxes, this.load());
    for (const index of this.nodes) view.group(index)?.classList.add("dragged");
    addEventListener("keydown", this.onKey, true);
    addEventListener("keyup", this.onKey, true);
    // Another page may change the tree meanwhile. A picture that looks the same does not end the drag.
    const begun = drawing.peek();
    this.unfollow = effect(() => { if (!begun || !drawing.value || !isSamePicture(begun, drawing.value)) end(false); });
    this.frame = requestAnimationFrame(this.scroll);
  }

  private get nodes(): readonly number[] {
    return "nodes" in this.source ? this.source.nodes : [];
  }

  private load(): Load {
    if ("item" in this.source) return { moved: [], count: 1, canWrap: canWrap(this.source.item.kind) };
    return { moved: this.isCopy ? [] : this.nodes, count: this.nodes.length, canWrap: false };
  }

  move(x: number, y: number, isCopy: boolean): void {
    [this.x, this.y] = [x, y];
    if (isCopy !== this.isCopy) this.setCopy(isCopy);
    this.update();
  }

  private setCopy(isCopy: boolean): void {
    this.isCopy = isCopy;
    this.targets.change(this.load());
    this.ghost.classList.toggle("copies", isCopy && this.nodes.length > 0);
  }

  private isInside({ left, right, top, bottom }: DOMRect): boolean {
    return this.x >= left && this.x <= right && this.y >= top && this.y <= bottom;
  }

  private update(): void {
    const { view, x, y } = this;
    const isOver = this.isInside(view.frame.getBoundingClientRect());
    this.target = isOver ? this.targets.at(...view.point(x, y)) : null;
    this.ghost.style.transform = `translate(${x + 12}px, ${y + 10}px)`;
    const reason = isOver && !this.target ? this.targets.refusalAt(...view.point(x, y)) : "";
    this.ghost.children[1]!.textContent = this.target ? treeTexts.target(this.target, view.structure) : reason;
    this.ghost.classList.toggle("refused", !this.target);
    view.marks.replaceChildren(...(this.target ? marks(this.target, view) : []));
    const previewed = JSON.stringify([this.target, this.isCopy]);
    if (previewed === this.previewed) return;
    this.previewed = previewed;
    const { source, target, isCopy } = this;
    this.requestPreview(target && (() => commandOf(source, target, isCopy, view)));
  }

  private warn(preview: PreviewResult | null): void {
    const element = this.ghost.lastElementChild!;
    element.textContent = warningOf(preview);
    element.className = `preview ${levelOf(preview)}`;
  }

  private readonly onKey = (event: KeyboardEvent) => {
    if (event.key === "Escape" && event.type === "keydown") {
      event.preventDefault();
      event.stopPropagation();
      end(false);
    } else if (event.key === "Control" || event.key === "Meta") {
      this.setCopy(event.type === "keydown");
      this.update();
    }
  };

  private readonly scroll = () => {
    const frame = this.view.frame.getBoundingClientRect();
    const push = (at: number, low: number, high: number) =>
      at < low || at > high ? 0 : at < low + EDGE ? (at - low) / EDGE - 1 : at > high - EDGE ? 1 - (high - at) / EDGE : 0;
    const [dx, dy] = this.isInside(frame) ? [push(this.x, frame.left, frame.right), push(this.y, frame.top, frame.bottom)] : [0, 0];
    if (dx || dy) {
      this.view.frame.scrollBy(dx * SPEED, dy * SPEED);
      this.update();
    }
    this.frame = requestAnimationFrame(this.scroll);
  };

  end(isDropped: boolean): void {
    cancelAnimationFrame(this.frame);
    this.requestPreview(null);
    this.unfollow();
    removeEventListener("keydown", this.onKey, true);
    removeEventListener("keyup", this.onKey, true);
    document.body.classList.remove("drags-node");
    this.ghost.remove();
    this.view.marks.replaceChildren();
    for (const index of this.nodes) this.view.group(index)?.classList.remove("dragged");
    focusPicture();
    const { source, target, isCopy, view } = this;
    if (!isDropped || !target) return;
    if ("item" in source) noteUse(source.item.id);
    // The places are those of the present picture; what follows waits.
    const dropped = commandOf(source, target, isCopy, view).then((command) => command && edit(command), showError);
    inTurn(() => dropped);
  }

  private makeGhost(): HTMLElement {
    const ghost = document.createElement("div");
    ghost.className = "ghost";
    ghost.setAttribute("aria-hidden", "true");
    const label = document.createElement("b");
    label.textContent = "item" in this.source ? this.source.item.id : treeTexts.dragged(this.nodes.map((index) => this.view.structure.nodes[index]!));
    ghost.append(label, document.createElement("small"), document.createElement("small"));
    return ghost;
  }
}

/** Draw where something would be dropped, with the line to its parent. */
function marks(target: Target, { boxes }: View): SVGElement[] {
  if (target.kind === "root") return [];
  if (target.kind === "between") {
    const { x1, y1, x2, y2 } = target.mark;
    const parent = boxes[target.parent];
    const found = [draw("line", { class: "insert", x1, y1, x2, y2 })];
    if (parent) {
      const [fromX, fromY] = [parent.x + parent.width / 2, parent.y + parent.height];
      const middle = (fromY + y1) / 2;
      found.unshift(draw("path", { class: "insert-edge", d: `M${fromX} ${fromY}C${fromX} ${middle} ${x1} ${middle} ${x1} ${y1}` }));
      found.unshift(draw("rect", { class: "insert-parent", ...padded(parent, 3), rx: 9 }));
    }
    return found;
  }
  const { x, y, width, height } = target.mark;
  if (target.kind === "around") return [draw("rect", { class: "insert-around", ...padded(target.mark, 8), rx: 13 })];
  return [
    draw("rect", { class: "insert-parent", ...padded(target.mark, 3), rx: 9 }),
    draw("line", { class: "insert", x1: x + width * 0.2, y1: y + height + 12, x2: x + width * 0.8, y2: y + height + 12 }),
  ];
}

const padded = ({ x, y, width, height }: Box, by: number): Record<string, number> =>
  ({ x: x - by, y: y - by, width: width + 2 * by, height: height + 2 * by });

/** Return the command that drops something at a target. */
async function commandOf(source: Source, target: Target, isCopy: boolean, { structure }: View): Promise<Command | null> {
  const place = (index: number): Place => structure.nodes[index]!.place;
  if (target.kind === "around") return "item" in source ? { kind: "wrap", nodes: [place(target.node)], id: source.item.id } : null;
  const parent = target.kind === "root" ? drawing.value && placeOfTree(drawing.value) : place(target.parent);
  if (!parent) return null;
  const index = target.kind === "root" ? 0 : target.index;
  if ("item" in source) return { kind: "add", parent, index, id: source.item.id };
  const nodes = source.nodes.map(place);
  return isCopy ? { kind: "paste", parent, index, xml: await xmlOf(nodes) } : { kind: "move", nodes, parent, index };
}

function begin(source: Source, event: PointerEvent): void {
  const shown = view.value;
  if (!shown || start.value?.readOnly) return;
  end(false);
  dragging = new Drag(shown, source, event.clientX, event.clientY, event.ctrlKey || event.metaKey);
  dragging.move(event.clientX, event.clientY, event.ctrlKey || event.metaKey);
}

function end(isDropped: boolean): void {
  const drag = dragging;
  dragging = null;
  drag?.end(isDropped);
}

// --- presses: what becomes of a pointer that is down

interface Press {
  id: number;
  x: number;
  y: number;
  /** What a movement does. */
  become: (event: PointerEvent) => "drag" | "pan" | "select";
  kind: "" | "drag" | "pan" | "select";
  timer: number;
  /** Called at the end of a press without movement. */
  click: ((event: PointerEvent) => void) | null;
  left: number;
  top: number;
}

let press: Press | null = null;
const touches = new Map<number, { x: number; y: number }>();
let pinch: { distance: number; zoom: number } | null = null;

/** Follow the pointers of a canvas. Return a function that ends it. */
export function followPointers(shown: View, click: (index: number, event: PointerEvent) => void): () => void {
  const { frame } = shown;
  const down = (event: PointerEvent) => {
    if (event.target instanceof Element && event.target.closest("button, input, .popup")) return;
    if (event.pointerType === "touch") {
      touches.set(event.pointerId, { x: event.clientX, y: event.clientY });
      if (touches.size === 2) { startPinch(shown); return; }
    }
    if (event.button !== 0) return;
    const index = shown.nodeAt(event.target);
    const isTouch = event.pointerType === "touch";
    const dragNodes = () => {
      const key = shown.structure.nodes[index]!.key;
      if (!selection.value.includes(key)) shown.select([key]);
      const nodes = chosen().filter((other) => !shown.structure.isRoot(other));
      if (nodes.length) begin({ nodes }, event);
      else message.value = treeTexts.refusal.root;
    };
    press = {
      id: event.pointerId, x: event.clientX, y: event.clientY, kind: "", timer: 0, left: frame.scrollLeft, top: frame.scrollTop,
      become: () => {
        if (index >= 0 && !isTouch && !start.value?.readOnly) { dragNodes(); return "drag"; }
        return index < 0 && event.shiftKey ? "select" : "pan";
      },
      click: () => click(index, event),
    };
    if (isTouch && index >= 0) {
      press.timer = window.setTimeout(() => {
        if (!press || press.kind) return;
        press.kind = "drag";
        // The browser sends mouse events after those of a finger, which would take the focus from the menu.
        press.click = () => window.setTimeout(() => { menu.value = { x: event.clientX, y: event.clientY }; }, MOUSE_EVENTS_MS);
        navigator.vibrate?.(15);
        dragNodes();
      }, LONG_PRESS_MS);
    }
  };
  const over = (event: PointerEvent) => { if (!dragging && event.pointerType !== "touch") shown.hover(shown.nodeAt(event.target)); };
  const leave = () => shown.hover(-1);
  frame.addEventListener("pointerdown", down);
  frame.addEventListener("pointerover", over);
  frame.addEventListener("pointerleave", leave);
  const ends = followPress(shown);
  return () => {
    frame.removeEventListener("pointerdown", down);
    frame.removeEventListener("pointerover", over);
    frame.removeEventListener("pointerleave", leave);
    ends();
  };
}

function followPress(shown: View): () => void {
  const { frame } = shown;
  let band: { x: number; y: number } | null = null;
  const move = (event: PointerEvent) => {
    if (touches.has(event.pointerId)) touches.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (pinch) { movePinch(shown); return; }
    if (!press || press.id !== event.pointerId) return;
    const [dx, dy] = [event.clientX - press.x, event.clientY - press.y];
    if (Math.abs(dx) + Math.abs(dy) > THRESHOLD) {
      if (dragging) press.click = null;
      if (!press.kind) {
        clearTimeout(press.timer);
        press.kind = press.become(event);
        press.click = null;
        if (press.kind === "select") { const [x, y] = shown.point(press.x, press.y); band = { x, y }; }
        frame.classList.toggle("pans", press.kind === "pan");
      }
    }
    if (press.kind === "pan") frame.scrollTo(press.left - dx, press.top - dy);
    else if (press.kind === "drag") dragging?.move(event.clientX, event.clientY, event.ctrlKey || event.metaKey);
    else if (press.kind === "select" && band) selectBand(shown, band, shown.point(event.clientX, event.clientY));
  };
  const up = (event: PointerEvent) => {
    touches.delete(event.pointerId);
    if (pinch && touches.size < 2) { pinch = null; press = null; return; }
    if (!press || press.id !== event.pointerId) return;
    clearTimeout(press.timer);
    const { click, kind } = press;
    press = null;
    frame.classList.remove("pans");
    if (band) { band = null; shown.marks.replaceChildren(); }
    const isDropped = event.type === "pointerup" && !click;
    if (kind === "drag") end(isDropped);
    if (event.type === "pointerup") click?.(event);
  };
  // A finger that drags does not scroll.
  const hold = (event: TouchEvent) => { if (dragging && event.cancelable) event.preventDefault(); };
  addEventListener("pointermove", move);
  addEventListener("pointerup", up);
  addEventListener("pointercancel", up);
  addEventListener("touchmove", hold, { passive: false });
  return () => {
    removeEventListener("pointermove", move);
    removeEventListener("pointerup", up);
    removeEventListener("pointercancel", up);
    removeEventListener("touchmove", hold);
  };
}

function selectBand(shown: View, from: { x: number; y: number }, [toX, toY]: [number, number]): void {
  const band = {
    x: Math.min(from.x, toX), y: Math.min(from.y, toY), width: Math.abs(toX - from.x), height: Math.abs(toY - from.y),
  };
  shown.marks.replaceChildren(draw("rect", { class: "band", ...band }));
  const isIn = (box: Box | undefined) => box !== undefined && overlaps(box, band);
  selection.value = shown.structure.nodes.filter((_, index) => isIn(shown.boxes[index])).map((node) => node.key);
}

function startPinch(shown: View): void {
  if (press) clearTimeout(press.timer);
  press = null;
  end(false);
  pinch = { distance: fingers().distance, zoom: shown.zoom };
}

function movePinch(shown: View): void {
  const { distance, x, y } = fingers();
  if (pinch && pinch.distance) shown.zoomTo(pinch.zoom * distance / pinch.distance, x, y);
}

function fingers(): { distance: number; x: number; y: number } {
  const [a, b] = [...touches.values()];
  if (!a || !b) return { distance: 0, x: 0, y: 0 };
  return { distance: Math.hypot(a.x - b.x, a.y - b.y), x: (a.x + b.x) / 2, y: (a.y + b.y) / 2 };
}

/** Begin to follow a pointer that is down on an item of the palette. */
export function pressItem(id: string, event: PointerEvent, click: () => void): void {
  const item = palette.value.items.find((other) => other.id === id);
  if (!item || event.button !== 0) return;
  press = {
    id: event.pointerId, x: event.clientX, y: event.clientY, kind: "", timer: 0, left: 0, top: 0, click,
    become: () => {
      if (event.pointerType !== "touch") { begin({ item }, event); return "drag"; }
      return "select"; // the list scrolls
    },
  };
  if (event.pointerType === "touch") {
    press.timer = window.setTimeout(() => {
      if (!press || press.kind) return;
      press.kind = "drag";
      press.click = null;
      navigator.vibrate?.(15);
      begin({ item }, event);
    }, LONG_PRESS_MS);
  }
}
