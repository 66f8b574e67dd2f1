// The server's SVG in pieces, so that only the visible cards become elements.

export interface Box { x: number; y: number; width: number; height: number }

/** A card: *number* is 1 + the index of its node; the box is in units of the drawing. */
export interface Card extends Box { number: number; text: string }

export interface Picture {
  width: number;
  height: number;
  /** The place of the group that contains the cards. */
  left: number;
  top: number;
  /** The text before, in place of, and after the cards. */
  head: string;
  cards: Card[];
  tail: string;
}

const GROUP = '<g data-uid="';
const END = "\n</g>";

/** Return the pieces of a drawing. The server has escaped all texts of trees, so that `<` is always markup. */
export function parsePicture(svg: string): Picture {
  const view = /viewBox="0 0 ([\d.]+) ([\d.]+)"/.exec(svg);
  const picture: Picture = {
    width: Number(view?.[1] ?? 100), height: Number(view?.[2] ?? 100), left: 0, top: 0, head: svg, cards: [], tail: "",
  };
  let at = svg.indexOf(GROUP);
  if (at < 0) return picture;
  picture.head = svg.slice(0, at);
  const outer = /<g transform="translate\(([-\d.]+) ([-\d.]+)\)">(?![^]*<g transform)/.exec(picture.head);
  picture.left = Number(outer?.[1] ?? 0);
  picture.top = Number(outer?.[2] ?? 0);
  while (at >= 0) {
    const next = svg.indexOf(GROUP, at + GROUP.length);
    const end = next < 0 ? svg.indexOf(END, at) : next;
    const text = svg.slice(at, end < 0 ? svg.length : end);
    picture.cards.push(parseCard(text));
    if (next < 0 && end >= 0) picture.tail = svg.slice(end);
    at = next;
  }
  return picture;
}

function parseCard(text: string): Card {
  const tag = text.slice(0, text.indexOf(">"));
  const place = /translate\(([-\d.]+) ([-\d.]+)\)/.exec(tag);
  const size = /<rect class="card[^>]*? width="([\d.]+)" height="([\d.]+)"/.exec(text);
  return {
    number: Number.parseInt(tag.slice(GROUP.length), 10), text,
    x: Number(place?.[1] ?? 0), y: Number(place?.[2] ?? 0),
    width: Number(size?.[1] ?? 0), height: Number(size?.[2] ?? 0),
  };
}

/** Return the text of a card without its texts, which cannot be read from afar. */
export function outline(card: Card): string {
  const rectangle = /<rect class="card[^>]*>/.exec(card.text)?.[0] ?? "";
  return `${card.text.slice(0, card.text.indexOf(">") + 1)}${rectangle}</g>`;
}

export const overlaps = (a: Box, b: Box): boolean =>
  a.x < b.x + b.width && b.x < a.x + a.width && a.y < b.y + b.height && b.y < a.y + a.height;

/** Return the distance between a point and a box; 0 inside. */
export function distance(x: number, y: number, box: Box): number {
  const dx = Math.max(box.x - x, 0, x - box.x - box.width);
  const dy = Math.max(box.y - y, 0, y - box.y - box.height);
  return Math.hypot(dx, dy);
}
