// Two versions of a file beside each other, with a list of their differences. Nothing is edited here.

import "./comparison.css";
import { batch, computed, type ReadonlySignal, signal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { ZoomButtons } from "./canvas";
import { isConnected } from "./home";
import { actionOf, keyOf, neighbour } from "./keyboard";
import { distance } from "./picture";
import type { Change, Comparison, Difference, Drawing } from "./protocol";
import { actions, reasonOf } from "./state";
import { comparisonTexts, texts, treeTexts } from "./texts";
import { Themes } from "./toolbar";
import { CHANGE_SIGNS, followWheel, View, ZOOM_STEP } from "./view";

const MAX_LISTED = 500;
const MAX_TEXT = 400;
const CHANGES: readonly Change[] = ["added", "removed", "moved", "changed"];

const comparison = signal<Comparison | null>(null);
const problem = signal("");
/** The index of the chosen difference, or -1. */
const chosen = signal(-1);

/** One of the versions: 0 is the old version, 1 the new version. *prefix* is its name in a `Difference`, too. */
class Side {
  readonly selection = signal<readonly string[]>([]);
  readonly folded = signal<ReadonlySet<string>>(new Set());
  readonly drawing: ReadonlySignal<Drawing | null>;
  readonly changes: ReadonlySignal<ReadonlyMap<string, readonly Change[]>>;
  /** The index of the same node in the other version. */
  readonly partners: ReadonlySignal<ReadonlyMap<number, number>>;
  view: View | null = null;
  /** Where the other side has scrolled this one. */
  private settled = { left: 0, top: 0 };

  constructor(readonly number: 0 | 1, readonly prefix: "old" | "new") {
    this.drawing = computed(() => {
      const drawing = comparison.value?.[prefix];
      return drawing?.nodes.length ? drawing : null;
    });
    this.changes = computed(() => new Map((comparison.value?.differences ?? []).flatMap((difference) =>
      difference[prefix].flatMap((index) => {
        const node = this.drawing.value?.nodes[index];
        return node ? [[node.key, difference.changes] as const] : [];
      }))));
    this.partners = computed(() => new Map((comparison.value?.pairs ?? []).map((pair) => [pair[number], pair[1 - number]!] as const)));
  }

  get other(): Side {
    return sides[1 - this.number]!;
  }

  select(index: number): void {
    const key = this.drawing.peek()?.nodes[index]?.key;
    this.selection.value = key === undefined ? [] : [key];
  }

  /** Scroll this picture by the page, and not by the user. */
  scrollBy(left: number, top: number): void {
    const frame = this.view?.frame;
    if (!frame) return;
    frame.scrollBy(left, top);
    this.settled = { left: frame.scrollLeft, top: frame.scrollTop };
  }

  scrolled(): void {
    const frame = this.view!.frame;
    if (Math.abs(frame.scrollLeft - this.settled.left) < 2 && Math.abs(frame.scrollTop - this.settled.top) < 2) return;
    this.scrollBy(0, 0);
    this.lead();
  }

  /** Scroll the other picture to what is in the middle of this one: by the offsets of the common nodes, weighted by nearness. */
  lead(): void {
    const [view, other] = [this.view, this.other.view];
    if (!view || !other) return;
    const [frame, frameOfOther] = [view.frame.getBoundingClientRect(), other.frame.getBoundingClientRect()];
    const [x, y] = view.point(frame.left + frame.width / 2, frame.top + frame.height / 2);
    let [weights, dx, dy] = [0, 0, 0];
    for (const [index, partner] of this.partners.peek()) {
      const [box, target] = [view.boxes[index], other.boxes[partner]];
      if (!box || !target) continue;
      const weight = 1 / (distance(x, y, box) ** 2 + 1) ** 2;
      weights += weight;
      dx += weight * (target.x - box.x);
      dy += weight * (target.y - box.y);
    }
    const wanted = other.screen({ x: x + (weights && dx / weights), y: y + (weights && dy / weights), width: 0, height: 0 });
    this.other.scrollBy(
      wanted.left - frameOfOther.left - frameOfOther.width / 2, wanted.top - frameOfOther.top - frameOfOther.height / 2);
  }

  /** Scroll the other picture so that a node has the same place in both; without a partner, as `lead`. */
  align(index: number, partner: number): void {
    const [box, target] = [this.view?.boxes[index], this.other.view?.boxes[partner]];
    if (!box || !target) {
      this.lead();
      return;
    }
    const [here, there] = [this.view!.screen(box), this.other.view!.screen(target)];
    const [frame, frameOfOther] = [this.view!.frame.getBoundingClientRect(), this.other.view!.frame.getBoundingClientRect()];
    this.other.scrollBy(
      there.left - frameOfOther.left - here.left + frame.left, there.top - frameOfOther.top - here.top + frame.top);
  }

  /** Zoom both pictures, so that a point of the screen in this one keeps its place. */
  zoomTo(zoom: number, clientX?: number, clientY?: number): void {
    this.view?.zoomTo(zoom, clientX, clientY);
    this.other.view?.zoomTo(zoom);
    this.scrollBy(0, 0);
    this.lead();
  }
}

const sides: readonly [Side, Side] = [new Side(0, "old"), new Side(1, "new")];
/** The side with the drawing that both follow. */
const leader = (): Side => sides[sides[1].drawing.peek() ? 1 : 0];

/** Compare the files again, and show a tree; by default the present one. */
export async function loadComparison(tree: string | null = comparison.peek()?.tree ?? null): Promise<void> {
  try {
    const data = await actions.request<Comparison>("btcore/comparison", { tree });
    const isOther = data.tree !== comparison.peek()?.tree;
    batch(() => {
      comparison.value = data;
      problem.value = "";
      if (chosen.peek() >= data.differences.length) chosen.value = -1;
    });
    if (isOther) fit(true);
  } catch (error) {
    if (isConnected.value) problem.value = reasonOf(error);
  }
}

/** Zoom both pictures equally, so that both are visible as a whole; with *isReadable*, at least so that texts can be read. */
function fit(isReadable: boolean): void {
  const views = sides.filter((side) => side.drawing.peek()).flatMap((side) => side.view ?? []);
  for (const view of views) if (!isReadable) view.fit();
  const zooms = views.map((view) => view.zoom);
  if (zooms.length) leader().zoomTo(Math.min(...zooms));
}

/** Zoom both pictures by a factor. */
const zoom = (factor: number) => leader().zoomTo((leader().view?.zoom ?? 1) * factor);

/** Select a node in both pictures. The picture of the other side follows that of *side*. */
function select(side: Side, index: number, partner: number, isRevealing: boolean): void {
  batch(() => {
    side.select(index);
    side.other.select(partner);
  });
  if (index < 0) return;
  if (isRevealing) {
    side.view?.reveal(index);
    side.scrollBy(0, 0);
  }
  side.align(index, partner);
}

function selectNode(side: Side, index: number, isRevealing = false): void {
  const at = (comparison.peek()?.differences ?? []).findIndex((difference) => difference[side.prefix].includes(index));
  if (at >= 0) chosen.value = at;
  select(side, index, side.partners.peek().get(index) ?? -1, isRevealing);
}

async function choose(at: number): Promise<void> {
  let difference = comparison.peek()?.differences[at];
  if (!difference) return;
  chosen.value = at;
  if (difference.tree && !difference.old.length && !difference.new.length && difference.tree !== comparison.peek()?.tree) {
    await loadComparison(difference.tree);
    difference = comparison.peek()?.differences[at];
  }
  const [old, now] = [difference?.old[0] ?? -1, difference?.new[0] ?? -1];
  if (now >= 0) select(sides[1], now, old, true);
  else select(sides[0], old, -1, true);
}

function step(by: 1 | -1): void {
  const number = comparison.peek()?.differences.length ?? 0;
  if (number) void choose(chosen.value < 0 ? (by > 0 ? 0 : number - 1) : (chosen.value + by + number) % number);
}

// --- the pictures

/** Scroll a picture with the mouse, and report clicks. Fingers scroll it as any other element. */
function followMouse(side: Side, frame: HTMLElement): () => void {
  let press: { x: number; y: number; left: number; top: number; isPan: boolean } | null = null;
  const down = (event: PointerEvent) => {
    if (event.button !== 0 || event.pointerType === "touch") return;
    press = { x: event.clientX, y: event.clientY, left: frame.scrollLeft, top: frame.scrollTop, isPan: false };
  };
  const move = (event: PointerEvent) => {
    if (!press) return;
    const [dx, dy] = [event.clientX - press.x, event.clientY - press.y];
    press.isPan ||= Math.abs(dx) + Math.abs(dy) > 4;
    frame.classList.toggle("pans", press.isPan);
    if (press.isPan) frame.scrollTo(press.left - dx, press.top - dy);
  };
  const up = () => {
    frame.classList.remove("pans");
    // The click comes after this.
    const ended = press;
    setTimeout(() => { if (press === ended) press = null; });
  };
  const click = (event: MouseEvent) => {
    if (!press?.isPan) selectNode(side, side.view!.nodeAt(event.target));
  };
  const scroll = () => side.scrolled();
  frame.addEventListener("pointerdown", down);
  frame.addEventListener("click", click);
  const unfollowWheel = followWheel(frame, (factor, x, y) => side.zoomTo(side.view!.zoom * factor, x, y));
  frame.addEventListener("scroll", scroll, { passive: true });
  addEventListener("pointermove", move);
  addEventListener("pointerup", up);
  return () => {
    unfollowWheel();
    removeEventListener("pointermove", move);
    removeEventListener("pointerup", up);
  };
}

function followKeys(event: KeyboardEvent): void {
  const target = event.target as Element;
  if (event.defaultPrevented || target.closest("select")) return;
  const action = actionOf(keyOf(event));
  const page = action && "page" in action ? action.page : "";
  const side = sides.find(({ view }) => view?.frame.contains(target));
  const isPlain = !event.ctrlKey && !event.metaKey && !event.altKey;
  if (isPlain && event.key === "n") step(1);
  else if (isPlain && event.key === "p") step(-1);
  else if (page === "larger") zoom(ZOOM_STEP);
  else if (page === "smaller") zoom(1 / ZOOM_STEP);
  else if (page === "fit") fit(false);
  else if (side && action && "select" in action) {
    const { structure } = side.view!;
    const index = neighbour(structure, structure.at(side.selection.value[0] ?? ""), action.select);
    if (structure.nodes[index]) selectNode(side, index, true);
  } else return;
  event.preventDefault();
}

function Picture({ side, file }: { side: Side; file: string }) {
  const frame = useRef<HTMLDivElement>(null);
  useEffect(() => {
    const view = new View(frame.current!, side);
    side.view = view;
    const end = followMouse(side, frame.current!);
    return () => {
      end();
      view.close();
      side.view = null;
    };
  }, []);
  const shown = comparison.value;
  const name = comparisonTexts.sides[side.number];
  const broken = shown?.broken[side.number];
  return (
    <section class="version" aria-label={`${name}: ${file || comparisonTexts.noFile}`}>
      <h2>{name} <span title={file}>{file || comparisonTexts.noFile}</span></h2>
      {broken && <p class="note">{texts.broken(broken)}</p>}
      {shown && file && !side.drawing.value && <p class="note">{comparisonTexts.noTree(shown.tree)}</p>}
      <div ref={frame} class={`canvas ${broken ? "broken" : ""}`} role={side.drawing.value ? "tree" : "group"} tabIndex={0}
        aria-label={comparisonTexts.picture(name, side.drawing.value?.tree ?? "")} />
    </section>
  );
}

// --- the list

const clipped = (text: string) => (text.length > MAX_TEXT ? `${text.slice(0, MAX_TEXT)}…` : text);

function Value({ text, tag: Tag }: { text: string | null; tag: "del" | "ins" }) {
  return text === null ? <em>{comparisonTexts.notSet}</em> : <Tag title={text}>{clipped(text) || "“”"}</Tag>;
}

function Details({ difference: { attributes, spots, count } }: { difference: Difference }) {
  return (
    <dl>
      {count > 1 && <div><dd>{comparisonTexts.nodes(count)}</dd></div>}
      {spots && <div><dd>{comparisonTexts.child(spots[0])} → {comparisonTexts.child(spots[1])}</dd></div>}
      {attributes.map(([name, old, now]) => (
        <div key={name}>
          <dt>{name || comparisonTexts.type}</dt>
          <dd><Value text={old} tag="del" /> → <Value text={now} tag="ins" /></dd>
        </div>
      ))}
    </dl>
  );
}

function Item({ difference, at }: { difference: Difference; at: number }) {
  const { changes, tree, id, name } = difference;
  const isChosen = chosen.value === at;
  const row = useRef<HTMLLIElement>(null);
  useEffect(() => { if (isChosen) row.current?.scrollIntoView({ block: "nearest" }); }, [isChosen]);
  const title = (
    <>
      <span class={`sign ${changes.join(" ")}`} aria-hidden="true">{changes.map((change) => CHANGE_SIGNS[change]).join(" ")}</span>
      <span><b>{name || id}</b> {name && name !== id && <small>{id}</small>} <i>{comparisonTexts.list(changes)}</i></span>
    </>
  );
  return (
    <li ref={row} class={isChosen ? "chosen" : undefined}>
      {tree ? <button class="plain" aria-current={isChosen} onClick={() => void choose(at)}>{title}</button> : <div class="plain">{title}</div>}
      <Details difference={difference} />
    </li>
  );
}

function Differences({ all }: { all: readonly Difference[] }) {
  const groups = new Map<string, number[]>();
  all.slice(0, MAX_LISTED).forEach(({ tree }, at) => groups.set(tree, [...(groups.get(tree) ?? []), at]));
  const counts = CHANGES.map((change) => ({ change, number: all.filter(({ changes }) => changes.includes(change)).length }));
  return (
    <aside class="differences" aria-label={comparisonTexts.title}>
      {all.length === 0 ? <p>{comparisonTexts.equal}</p> : (
        <p class="legend">
          {counts.filter(({ number }) => number).map(({ change, number }) => (
            <span key={change}><span class={`sign ${change}`} aria-hidden="true">{CHANGE_SIGNS[change]}</span> {number} {comparisonTexts.changes[change]}</span>
          ))}
        </p>
      )}
      {[...groups].map(([tree, items]) => (
        <section key={tree}>
          <h2>{tree ? `${comparisonTexts.tree} ${tree}` : comparisonTexts.outside}</h2>
          <ul>{items.map((at) => <Item key={at} difference={all[at]!} at={at} />)}</ul>
        </section>
      ))}
      {all.length > MAX_LISTED && <p>{comparisonTexts.further(all.length - MAX_LISTED)}</p>}
    </aside>
  );
}

/** The page of a comparison. */
export function ComparisonPage({ versions }: { versions: readonly [string, string] }) {
  useEffect(() => {
    addEventListener("keydown", followKeys);
    if (comparison.peek()) fit(true);
    return () => removeEventListener("keydown", followKeys);
  }, []);
  const shown = comparison.value;
  const all = shown?.differences ?? [];
  return (
    <>
      <header>
        <h1>{comparisonTexts.title}</h1>
        <select aria-label={comparisonTexts.tree} value={shown?.tree} hidden={!shown || shown.trees.length < 2}
          onChange={(event) => void loadComparison(event.currentTarget.value)}>
          {shown?.trees.map((id) => (
            <option key={id} value={id}>{comparisonTexts.treeOption(id, all.filter(({ tree }) => tree === id).length)}</option>
          ))}
        </select>
        <div class="group" role="group" aria-label={comparisonTexts.title}>
          <button disabled={!all.length} title={comparisonTexts.previous} aria-label={comparisonTexts.previous} onClick={() => step(-1)}>↑</button>
          <button disabled={!all.length} title={comparisonTexts.next} aria-label={comparisonTexts.next} onClick={() => step(1)}>↓</button>
        </div>
        <output>{all[chosen.value] && comparisonTexts.position(chosen.value, all.length, all[chosen.value]!)}</output>
        <span class="space" />
        <div class="group" role="group" aria-label={treeTexts.zoom}>
          <ZoomButtons zoom={zoom} fit={() => fit(false)} />
        </div>
        <Themes />
      </header>
      <div class="notices" role="status">
        {!isConnected.value && <p>{comparisonTexts.ended}</p>}
        {problem.value && <p>{problem.value}</p>}
      </div>
      <main class="comparison">
        {sides.map((side) => <Picture key={side.number} side={side} file={versions[side.number]} />)}
        {shown && <Differences all={all} />}
      </main>
    </>
  );
}
