// Fuzzy search: the letters of the query in their order, best at the beginnings of words.

interface Match { score: number; /** The indices of the matching letters. */ at: number[] }

/** Return how a text matches a query without regard to case; null if letters are missing. */
export function match(query: string, text: string): Match | null {
  const wanted = query.toLowerCase().replace(/\s+/g, "");
  if (!wanted) return { score: 0, at: [] };
  const lower = text.toLowerCase();
  const contained = lower.indexOf(wanted);
  let best: Match | null = null;
  for (let from = lower.indexOf(wanted[0]!); from >= 0; from = lower.indexOf(wanted[0]!, from + 1)) {
    const found = matchFrom(wanted, text, lower, from);
    if (!found) break;
    if (!best || found.score > best.score) best = found;
  }
  if (contained >= 0) {
    const at = Array.from(wanted, (_, index) => contained + index);
    const score = scoreOf(text, at);
    if (!best || score > best.score) best = { score, at };
  }
  return best;
}

function matchFrom(wanted: string, text: string, lower: string, from: number): Match | null {
  const at: number[] = [];
  let next = from;
  for (const letter of wanted) {
    const last = at.at(-1);
    let index = lower.indexOf(letter, next);
    if (index < 0) return null;
    if (last !== undefined && index !== last + 1) {
      // The beginning of a later word is better than a letter inside this word.
      for (let other = index; other >= 0; other = lower.indexOf(letter, other + 1)) {
        if (isStart(text, other)) { index = other; break; }
      }
    }
    at.push(index);
    next = index + 1;
  }
  return { score: scoreOf(text, at), at };
}

function scoreOf(text: string, at: readonly number[]): number {
  let score = 0;
  at.forEach((index, position) => {
    const isNext = position > 0 && at[position - 1] === index - 1;
    score += 1 + (isStart(text, index) ? 8 : 0) + (isNext ? 5 : 0);
  });
  return score + (at[0] === 0 ? 6 : 0) - text.length / 50;
}

function isStart(text: string, index: number): boolean {
  if (index === 0) return true;
  const before = text[index - 1]!;
  const letter = text[index]!;
  return /[^\p{L}\p{N}]/u.test(before) || letter !== letter.toLowerCase() && before === before.toLowerCase();
}

/** Return the items whose text matches a query, best first; an empty query keeps their order. */
export function search<T>(query: string, items: readonly T[], textOf: (item: T) => string, bonus: (item: T) => number = () => 0): { item: T; at: number[] }[] {
  const found = items.flatMap((item) => {
    const result = match(query, textOf(item));
    return result ? [{ item, at: result.at, score: result.score + bonus(item) }] : [];
  });
  return found.sort((a, b) => b.score - a.score);
}
