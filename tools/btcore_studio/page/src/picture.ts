// The geometry of a drawing.

import type { Drawing, DrawnNode } from "./protocol";

export interface Box { x: number; y: number; width: number; height: number }

/** Return a drawing with the nodes that have moved. @param before The drawing whose number was in the request. */
export function complete(reply: Drawing, before: Drawing | null): Drawing {
  const nodes: DrawnNode[] = [];
  let next = 0;
  for (const [index, known, parent, line, character, endLine, endCharacter, x, y, edge] of reply.moved) {
    while (nodes.length < index) nodes.push(reply.nodes[next++]!);
    const node = before!.nodes[known]!;
    const place = { uri: node.place.uri, position: { line, character } };
    nodes.push({ ...node, parent, place, end: { line: endLine, character: endCharacter }, x, y, edge: edge ?? node.edge });
  }
  nodes.push(...reply.nodes.slice(next));
  return { ...reply, nodes, moved: [] };
}

/** Return whether two drawings look the same. */
export const isSamePicture = (a: Drawing, b: Drawing): boolean => a.svg === b.svg && a.nodes.length === b.nodes.length
  && a.nodes.every((node, index) => {
    const other = b.nodes[index]!;
    return node.x === other.x && node.y === other.y && node.card === other.card;
  });

/** Return the part of a card that can be recognized from afar: it has no texts. */
export const outline = (card: string): string => /<rect class="card[^>]*>/.exec(card)?.[0] ?? "";

export const overlaps = (a: Box, b: Box): boolean =>
  a.x < b.x + b.width && b.x < a.x + a.width && a.y < b.y + b.height && b.y < a.y + a.height;

/** Return the box around two boxes. */
export function around(a: Box, b: Box): Box {
  const [x, y] = [Math.min(a.x, b.x), Math.min(a.y, b.y)];
  return { x, y, width: Math.max(a.x + a.width, b.x + b.width) - x, height: Math.max(a.y + a.height, b.y + b.height) - y };
}

/** Return the distance between a point and a box; 0 inside. */
export function distance(x: number, y: number, box: Box): number {
  const dx = Math.max(box.x - x, 0, x - box.x - box.width);
  const dy = Math.max(box.y - y, 0, y - box.y - box.height);
  return Math.hypot(dx, dy);
}
