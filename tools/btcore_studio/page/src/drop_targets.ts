// Where a dragged node or palette item can be dropped.

import { type Box, distance } from "./picture";
import { treeTexts } from "./texts";
import type { Structure } from "./tree";

export type Target =
  /** As the root of an empty tree. */
  | { kind: "root" }
  /** Between children: *index* counts the present children before it. *mark* is the line to draw. */
  | { kind: "between"; parent: number; index: number; mark: Line }
  /** As the last child of a node without visible children. */
  | { kind: "inside"; parent: number; index: number; mark: Box }
  /** As the parent of a node. */
  | { kind: "around"; node: number; mark: Box };

interface Line { x1: number; y1: number; x2: number; y2: number }

interface Slot { area: Box; target: Target & { kind: "between" } }

/** What is dragged. */
export interface Load {
  /** The indices of the moved nodes; empty for a palette item or a copy. */
  moved: readonly number[];
  /** The number of dragged nodes. */
  count: number;
  /** Whether it is a single new node that can have a child. */
  canWrap: boolean;
}

/** The greatest distance between the pointer and a place between two nodes, in units of the drawing. */
const REACH = 70;
const GAP = 11;
/** The share of a card's height (or width) that means its edge. */
const EDGE = 0.3;
/** The same for the upper edge of a card, where a node is dropped that becomes the parent. */
const UPPER_EDGE = 0.45;

/** The targets of one drawing for many positions of the pointer. */
export class DropTargets {
  private slots: Slot[] = [];

  constructor(
    private readonly structure: Structure,
    /** The box of each node; undefined if the node is not drawn. */
    private readonly boxes: readonly (Box | undefined)[],
    private load: Load,
  ) {
    this.change(load);
  }

  /** Drag something else. */
  change(load: Load): void {
    this.load = load;
    this.slots = [];
    this.structure.nodes.forEach((node, index) => {
      const hasChildren = !node.hidden && this.structure.children[index]!.length > 0;
      if (this.boxes[index] && hasChildren && this.takes(index)) this.addSlots(index);
    });
  }

  /** Return the target at a point of the drawing, or null. */
  at(x: number, y: number): Target | null {
    if (!this.structure.nodes.length) return { kind: "root" };
    const over = this.boxes.findIndex((box) => box !== undefined && distance(x, y, box) === 0);
    if (over >= 0) return this.onCard(over, x, y);
    let best: Target | null = null;
    let least = REACH;
    for (const slot of this.slots) {
      const away = distance(x, y, slot.area);
      if (away < least) [least, best] = [away, slot.target];
    }
    // A node without children has its place below.
    this.boxes.forEach((box, index) => {
      if (!box || !this.isEmpty(index) || !this.takes(index)) return;
      const away = distance(x, y, { ...box, y: box.y + box.height, height: 30 });
      if (away < least) [least, best] = [away, this.inside(index)];
    });
    // A new root has its place above the root.
    const root = this.boxes[0];
    if (this.load.canWrap && root && y < root.y && distance(x, y, root) < least) return { kind: "around", node: 0, mark: root };
    return best;
  }

  /** Return why nothing can be dropped at a point without a target. */
  refusalAt(x: number, y: number): string {
    const { structure, load } = this;
    const over = this.boxes.findIndex((box) => box !== undefined && distance(x, y, box) === 0);
    if (over < 0) return treeTexts.refusal.noTarget;
    if (load.moved.some((other) => structure.isWithin(over, other))) return treeTexts.refusal.itself;
    return treeTexts.refusal.full(structure.nodes[over]!);
  }

  private takes(index: number): boolean {
    const { moved, count } = this.load;
    return !moved.some((other) => this.structure.isWithin(index, other)) && this.structure.canTake(index, count, moved);
  }

  private isEmpty(index: number): boolean {
    return this.structure.nodes[index]!.hidden > 0 || !this.structure.children[index]!.length;
  }

  private onCard(index: number, x: number, y: number): Target | null {
    const { structure, load } = this;
    if (load.moved.some((other) => structure.isWithin(index, other))) return null;
    const box = this.boxes[index]!;
    const down = (y - box.y) / box.height;
    const across = (x - box.x) / box.width;
    const parent = structure.parent(index);
    const isTaking = this.takes(index);
    const beside = (isAfter: boolean) => this.beside(index, isAfter);
    if (load.canWrap && (down < UPPER_EDGE || !isTaking && across > EDGE && across < 1 - EDGE)) {
      return { kind: "around", node: index, mark: box };
    }
    if (parent >= 0 && this.takes(parent)) {
      if (across < (isTaking ? EDGE / 2 : 0.5)) return beside(false);
      if (across >= (isTaking ? 1 - EDGE / 2 : 0.5)) return beside(true);
    }
    if (!isTaking) return load.canWrap ? { kind: "around", node: index, mark: box } : null;
    return this.inside(index);
  }

  private inside(index: number): Target {
    return { kind: "inside", parent: index, index: this.structure.children[index]!.length, mark: this.boxes[index]! };
  }

  /** Return the target before or after a node. */
  private beside(index: number, isAfter: boolean): Target | null {
    const parent = this.structure.parent(index);
    const position = this.structure.positions[index]! - (isAfter ? 0 : 1);
    const [x, y] = [this.boxes[index]!.x, this.boxes[index]!.y];
    const slots = this.slots.filter(({ target }) => target.parent === parent && target.index === position);
    const away = ({ area }: Slot) => distance(x, y, area);
    return slots.sort((a, b) => away(a) - away(b))[0]?.target ?? null;
  }

  /** Add the places between the children of a node, which are in rows or in columns. */
  private addSlots(parent: number): void {
    const children = this.structure.children[parent]!.filter((child) => this.boxes[child]);
    const boxes = children.map((child) => this.boxes[child]!);
    const directions = boxes.slice(1).map((box, index) => direction(boxes[index]!, box));
    const add = (index: number, area: Box, mark: Line) =>
      this.slots.push({ area, target: { kind: "between", parent, index, mark } });
    const addSide = (index: number, box: Box, isColumn: boolean, isAfter: boolean) => {
      if (isColumn) {
        const y = isAfter ? box.y + box.height + GAP / 2 : box.y - GAP / 2;
        add(index, { x: box.x, y: y - GAP / 2, width: box.width, height: GAP }, horizontal(box.x, y, box.width));
      } else {
        const x = isAfter ? box.x + box.width + GAP : box.x - GAP;
        add(index, { x: x - GAP, y: box.y, width: 2 * GAP, height: box.height }, vertical(x, box.y, box.height));
      }
    };
    boxes.forEach((box, index) => {
      const before = directions[index - 1];
      const after = directions[index];
      const isColumn = (before ?? after) === "column" || (after ?? before) === "column";
      if (before === "row") {
        const left = boxes[index - 1]!;
        const x = left.x + left.width;
        const y = Math.min(left.y, box.y);
        const height = Math.max(left.y + left.height, box.y + box.height) - y;
        const middle = Math.max(box.x - 2 * GAP, (x + box.x) / 2);
        add(index, { x, y, width: Math.max(1, box.x - x), height }, vertical(middle, y, height));
      } else addSide(index, box, isColumn, false);
      if (after !== "row" && after !== "column") addSide(index + 1, box, isColumn, true);
    });
  }
}

/** Return how *b* follows *a*: beside it, below it, or in another row or column. */
function direction(a: Box, b: Box): "row" | "column" | "break" {
  if (a.y < b.y + b.height && b.y < a.y + a.height && b.x >= a.x + a.width) return "row";
  if (b.y >= a.y + a.height && a.x < b.x + b.width && b.x < a.x + a.width) return "column";
  return "break";
}

const vertical = (x: number, y: number, height: number): Line => ({ x1: x, y1: y, x2: x, y2: y + height });
const horizontal = (x: number, y: number, width: number): Line => ({ x1: x, y1: y, x2: x + width, y2: y });
