// The server's SVG in pieces, so that only the visible cards become elements, and again only those that have changed.

export interface Box { x: number; y: number; width: number; height: number }

/**
 * A card: *number* is 1 + the index of its node, and *text* is its content without this number. The box is in units of
 * the drawing. *edge* is the path from the parent, or "".
 */
export interface Card extends Box { number: number; text: string; edge: string }

export interface Picture {
  width: number;
  height: number;
  /** The place of the group that contains the cards. */
  left: number;
  top: number;
  /** The text around the cards and edges. */
  rest: string;
  cards: Card[];
}

const GROUP = '<g data-uid="';
const END = "</g>\n";
const EDGE = '<path class="edge" d="';

/** Return the pieces of a drawing. The server has escaped all texts of trees, so that `<` is always markup. */
export function parsePicture(svg: string): Picture {
  const view = /viewBox="0 0 ([\d.]+) ([\d.]+)"/.exec(svg);
  const picture: Picture = {
    width: Number(view?.[1] ?? 100), height: Number(view?.[2] ?? 100), left: 0, top: 0, rest: svg, cards: [],
  };
  const first = svg.indexOf(GROUP);
  if (first < 0) return picture;
  const edges: string[] = [];
  let rest = svg.indexOf(EDGE);
  picture.rest = svg.slice(0, rest < 0 ? first : rest);
  for (let at = rest; at >= 0 && at < first; at = svg.indexOf(EDGE, at)) {
    const from = at + EDGE.length;
    at = svg.indexOf('"', from);
    edges.push(svg.slice(from, at));
  }
  const outer = /<g transform="translate\(([-\d.]+) ([-\d.]+)\)">(?![^]*<g transform)/.exec(picture.rest);
  picture.left = Number(outer?.[1] ?? 0);
  picture.top = Number(outer?.[2] ?? 0);
  for (let at = first; at >= 0;) {
    const next = svg.indexOf(GROUP, at + GROUP.length);
    const end = svg.lastIndexOf(END, next < 0 ? svg.indexOf("\n</g>", at) : next);
    // Every node but the root has an edge.
    picture.cards.push(parseCard(svg.slice(at, end), edges[picture.cards.length - 1] ?? ""));
    rest = end + END.length;
    at = next;
  }
  picture.rest += svg.slice(rest);
  return picture;
}

const TAG = /<g data-uid="(\d+)" transform="translate\(([-\d.]+) ([-\d.]+)\)">/;
const SIZE = /<rect class="card[^>]*? width="([\d.]+)" height="([\d.]+)"/;
const NUMBER = /(<text class="uid"[^>]*>)\d+/;

function parseCard(text: string, edge: string): Card {
  const [tag, number, x, y] = TAG.exec(text) ?? [""];
  const size = SIZE.exec(text);
  return {
    number: Number(number), text: text.slice(tag.length).replace(NUMBER, "$1"), edge,
    x: Number(x), y: Number(y), width: Number(size?.[1] ?? 0), height: Number(size?.[2] ?? 0),
  };
}

/** Return the text of a card without its texts, which cannot be read from afar. */
export const outline = (card: Card): string => /<rect class="card[^>]*>/.exec(card.text)?.[0] ?? "";

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
