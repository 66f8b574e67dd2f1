// Why a node did what it did at the shown moment: the chain of reasons as a list, and on the tree.

import { effect, signal } from "@preact/signals";
import { mockRun } from "./mock_run";
import type { Why } from "./protocol";
import { actions, announce, drawing, message, nameOf, selectedNode, showError } from "./state";
import { runTexts, treeTexts } from "./texts";
import { moment, shownRun } from "./timeline";
import { draw, view } from "./view";

const why = signal<Why | null>(null);

/** Explain the selected node, or the root. */
export async function explain(): Promise<void> {
  const at = moment.value;
  const key = selectedNode.value?.key ?? drawing.value?.nodes[0]?.key;
  if (!at || !key) {
    message.value = runTexts.noMoment;
    return;
  }
  try {
    why.value = await actions.request<Why>("btcore/why", { key, position: at.position, run: mockRun.value?.state.run ?? shownRun.value?.run ?? 0 });
    announce(why.value.answer);
  } catch (error) {
    showError(error);
  }
}

// The explanation is that of the moment.
effect(() => {
  void moment.value;
  why.value = null;
});

/** The button, and the explanation. */
export function Explanation() {
  const found = why.value;
  const node = selectedNode.value;
  if (!moment.value) return null;
  if (!found) {
    return node && (
      <section class="explanation" aria-label={runTexts.explanation}>
        <button class="small" title={runTexts.whyTitle} onClick={() => void explain()}>{runTexts.why}</button>
      </section>
    );
  }
  const select = (key: string) => view.value?.select([key], true);
  return (
    <section class="explanation" aria-label={runTexts.explanation}>
      <div class="row">
        <h2>{runTexts.explanation}</h2>
        <button class="small" aria-label={runTexts.closeWhy} title={runTexts.closeWhy} onClick={() => { why.value = null; }}>×</button>
      </div>
      <p class="dim">{found.question}</p>
      <p>{found.answer}</p>
      <ol>
        {found.links.map(({ key, tick, because, tried }, index) => (
          <li key={index}>
            <button disabled={!key} onClick={() => select(key)}>
              <i class="number">{index + 1}</i><b>{key ? nameOf(key) : runTexts.outside}</b><small>{treeTexts.tick(tick)}</small>
              <span>{because}</span>
              {tried && <span>→ {tried}</span>}
            </button>
          </li>
        ))}
      </ol>
    </section>
  );
}

// --- the chain on the tree

let drawn: Element[] = [];

/** Draw a number at each node of the chain, and lines from one to the next. */
function drawChain(): void {
  for (const element of drawn) element.remove();
  drawn = [];
  const shown = view.peek();
  const layer = shown?.marks.parentNode;
  const found = why.peek();
  if (!shown || !layer || !found) return;
  const places = found.links.flatMap(({ key }, index) => {
    const box = shown.boxes[shown.structure.at(key)];
    return key && box ? [{ x: box.x + box.width, y: box.y, number: index + 1 }] : [];
  });
  const points = places.filter(({ x, y }, index) => x !== places[index - 1]?.x || y !== places[index - 1]?.y);
  if (points.length > 1) {
    const line = draw("path", { class: "because-line", d: `M${points.map(({ x, y }) => `${x} ${y}`).join("L")}` });
    layer.insertBefore(line, layer.firstChild); // behind the cards
    drawn.push(line);
  }
  const seen = new Map<string, number>();
  const badges: Element[] = [];
  for (const { x, y, number } of places) {
    // A node can be in the chain several times.
    const count = seen.get(`${x} ${y}`) ?? 0;
    seen.set(`${x} ${y}`, count + 1);
    const label = draw("text", { y: 3.7 });
    label.textContent = String(number);
    badges.push(draw("g", { class: "because", transform: `translate(${x - 18 * count} ${y})`, "aria-hidden": "true" }, draw("circle", { r: 8.5 }), label));
  }
  layer.append(...badges);
  drawn.push(...badges);
}

effect(() => {
  void [why.value, drawing.value, view.value];
  // After the view has drawn the same change.
  queueMicrotask(drawChain);
});
