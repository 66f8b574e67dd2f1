// Questions about the nodes of a drawing, which are in pre-order.

import type { Drawing, DrawnNode, Place } from "./protocol";

export class Structure {
  readonly nodes: readonly DrawnNode[];
  readonly children: number[][];
  readonly levels: number[] = [];
  /** 1 + the position among the siblings. */
  readonly positions: number[] = [];
  /** Whether the node or a node above it is disabled. */
  readonly disabled: boolean[] = [];
  private readonly numbers = new Map<string, number>();
  private readonly ends: number[];

  constructor(nodes: readonly DrawnNode[]) {
    this.nodes = nodes;
    this.children = nodes.map(() => []);
    this.ends = nodes.map((_, index) => index + 1);
    nodes.forEach((node, index) => {
      this.numbers.set(node.key, index);
      const parent = node.parent - 1;
      this.children[parent]?.push(index);
      this.positions.push(this.children[parent]?.length ?? 1);
      this.levels.push((this.levels[parent] ?? 0) + 1);
      this.disabled.push(node.disabled || (this.disabled[parent] ?? false));
    });
    for (let index = nodes.length - 1; index > 0; index--) {
      const parent = nodes[index]!.parent - 1;
      if (parent >= 0) this.ends[parent] = Math.max(this.ends[parent]!, this.ends[index]!);
    }
  }

  /** Return the index of a node, or -1. */
  at(key: string): number {
    return this.numbers.get(key) ?? -1;
  }

  parent(index: number): number {
    return (this.nodes[index]?.parent ?? 0) - 1;
  }

  siblings(index: number): number[] {
    return this.children[this.parent(index)] ?? [index];
  }

  /** Return whether a node is *above* or below it. */
  isWithin(index: number, above: number): boolean {
    return index >= above && index < this.ends[above]!;
  }

  /** Return the nodes in *indices* that are not below others of them, in the order of the tree. */
  roots(indices: readonly number[]): number[] {
    const found: number[] = [];
    for (const index of [...new Set(indices)].sort((a, b) => a - b)) {
      const last = found.at(-1);
      if (last === undefined || !this.isWithin(index, last)) found.push(index);
    }
    return found;
  }

  /** Return whether the node is the root of a tree: the drawing's, or that of a called tree. */
  isRoot(index: number): boolean {
    const parent = this.nodes[this.parent(index)];
    return parent === undefined || parent.calls !== "";
  }

  /** Return whether a node can have *count* children more. *moved* are nodes that leave their places. */
  canTake(index: number, count: number, moved: readonly number[] = []): boolean {
    const node = this.nodes[index];
    if (!node || node.calls) return false;
    const maximum = node.children[1];
    if (maximum === null) return true;
    const leaving = moved.filter((other) => this.parent(other) === index).length;
    return this.children[index]!.length - leaving + count <= maximum;
  }
}

export const canWrap = (kind: DrawnNode["kind"]): boolean => kind === "control" || kind === "decorator";

/** Return the place of the drawn tree's element, under which its root is. */
export function placeOfTree(drawing: Drawing): Place | null {
  return drawing.trees.find((tree) => tree.id === drawing.tree)?.place ?? null;
}

/** Return the positions of the items that need not move so that all items rise. */
export function longestRise(items: readonly number[]): Set<number> {
  const ends: number[] = [], before: number[] = [];
  items.forEach((item, position) => {
    let [low, high] = [0, ends.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (items[ends[middle]!]! < item) low = middle + 1;
      else high = middle;
    }
    before[position] = ends[low - 1] ?? -1;
    ends[low] = position;
  });
  const found = new Set<number>();
  for (let at = ends.at(-1) ?? -1; at >= 0; at = before[at]!) found.add(at);
  return found;
}

/** Put elements into a parent before *end*, in their order, and move as few as possible. */
export function inOrder(parent: Element, elements: readonly Element[], end: Element): void {
  const places = new Map(Array.from(parent.children, (element, place) => [element, place]));
  const present = elements.filter((element) => places.has(element));
  const rise = longestRise(present.map((element) => places.get(element)!));
  const staying = new Set(present.filter((_, position) => rise.has(position)));
  let next: Element = end;
  for (const element of elements.toReversed()) {
    if (!staying.has(element)) parent.insertBefore(element, next);
    next = element;
  }
}
