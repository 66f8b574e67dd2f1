// The question of a run beside its node: what does the leaf do?

import { effect, untracked, useSignal } from "@preact/signals";
import { useEffect, useLayoutEffect, useRef } from "preact/hooks";
import { answer, mockRun, setPlan } from "./mock_run";
import type { LeafPlan, RunQuestion, RunResult } from "./protocol";
import { nameOf, nodesByKey, selectedNode } from "./state";
import { runTexts } from "./texts";
import { focusPicture, view } from "./view";

const RESULTS: readonly RunResult[] = ["S", "F", "R"];
const RARE: readonly RunResult[] = ["K", "X"];
const MARGIN = 8;
/** The type of a port that takes any value. */
const ANY = "BT::AnyTypeAllowed";

/** The question, if a leaf has no answer. */
export function Question() {
  const asked = mockRun.value?.state.question;
  return asked ? <OpenQuestion key={`${asked.key} ${mockRun.value!.state.moment.tick} ${mockRun.value!.state.event}`} asked={asked} /> : null;
}

/** Keep an element below the card of a node, or above it, within the picture. */
function usePlace(key: string): { current: HTMLDivElement | null } {
  const ref = useRef<HTMLDivElement>(null);
  useLayoutEffect(() => {
    const element = ref.current!;
    const place = () => {
      const [shown, pane] = [view.value, element.parentElement!.getBoundingClientRect()];
      if (!shown) return;
      const box = shown.boxes[shown.structure.at(key)];
      const card = box && shown.screen(box);
      const { width, height } = element.getBoundingClientRect();
      const isVisible = card && card.bottom > pane.top && card.top < pane.bottom && card.right > pane.left && card.left < pane.right;
      const limit = (value: number, size: number, most: number) => Math.max(MARGIN, Math.min(value, most - size - MARGIN));
      const isBelow = isVisible && card.bottom - pane.top + MARGIN + height <= pane.height - MARGIN;
      // A node that is not visible has its question at the lower edge.
      const left = limit(isVisible ? card.left - pane.left : (pane.width - width) / 2, width, pane.width);
      const top = limit(!isVisible ? pane.height : isBelow ? card.bottom - pane.top + MARGIN + 6 : card.top - pane.top - MARGIN - height, height, pane.height);
      element.style.transform = `translate(${Math.round(left)}px, ${Math.round(top)}px)`;
    };
    // The size of the element changes when its details are opened.
    const observer = new ResizeObserver(place);
    observer.observe(element);
    const end = effect(() => {
      if (view.value?.refreshed.value) untracked(place);
    });
    return () => {
      observer.disconnect();
      end();
    };
  }, [key]);
  return ref;
}

function OpenQuestion({ asked }: { asked: RunQuestion }) {
  const ref = usePlace(asked.key);
  const isAlways = useSignal(false);
  const name = nameOf(asked.key, asked.path);
  const submit = async (event: SubmitEvent) => {
    event.preventDefault();
    const form = event.target as HTMLFormElement;
    const result = ((event.submitter as HTMLButtonElement | null)?.value ?? "S") as RunResult;
    const fields = [...new FormData(form)].filter((field): field is [string, string] => typeof field[1] === "string" && field[1] !== "");
    const outputs = Object.fromEntries(fields);
    const hadFocus = form.contains(document.activeElement);
    const isDone = isAlways.value
      ? await setPlan(asked.key, { outcomes: `${result}${written(fields)}` })
      : await answer(result, outputs);
    // The next question is answered with the same keys.
    if (isDone && hadFocus) focusPicture();
  };
  return (
    <div class="popup question" ref={ref} role="group" aria-label={runTexts.question(name)}>
      <form onSubmit={(event) => void submit(event)}>
        <h2>{runTexts.question(name)}</h2>
        {!nodesByKey.value.has(asked.key) && <p class="dim">{runTexts.elsewhere(asked.path)}</p>}
        {Object.entries(asked.inputs).map(([port, value]) => <p key={port} class="dim"><code>{port}</code> = {value}</p>)}
        {asked.outputs.map(({ name: port, type, key }) => (
          <label key={port}><span>{port} <small>{type === ANY ? "" : type}</small></span><input name={port} autocomplete="off" maxLength={10_000} placeholder={`→ {${key}}`} /></label>
        ))}
        <div class="answers">
          {RESULTS.map((result, index) => (
            <button key={result} value={result} class={`answer s${"RSFK".indexOf(result) + 1}`} disabled={result === "R" && !asked.canRun}
              title={`${runTexts.results[result]} (${index + 1})`}>
              {runTexts.results[result]}<kbd aria-hidden="true">{index + 1}</kbd>
            </button>
          ))}
        </div>
        <details>
          <summary>{runTexts.more}</summary>
          <div class="answers">{RARE.map((result) => <button key={result} value={result}>{runTexts.results[result]}</button>)}</div>
        </details>
        <label class="always">
          <input type="checkbox" checked={isAlways.value} onChange={(event) => { isAlways.value = event.currentTarget.checked; }} />
          {runTexts.always}
        </label>
      </form>
    </div>
  );
}

/** Return outputs in the grammar of outcomes. */
function written(outputs: readonly [string, string][]): string {
  return outputs.length ? `(${outputs.map(([name, text]) => `${name}='${text.replaceAll("'", "''")}'`).join(", ")})` : "";
}

const MODES = ["ask", "S", "F", "outcomes", "chance"] as const;
type Mode = (typeof MODES)[number];

const modeOf = ({ outcomes, chance }: LeafPlan): Mode =>
  typeof chance === "number" ? "chance" : outcomes === "S" || outcomes === "F" ? outcomes : outcomes ? "outcomes" : "ask";

/** How the selected leaf answers in the run. */
export function LeafPlanForm() {
  const key = selectedNode.value?.key ?? "";
  const plan = mockRun.value?.leaves.get(key);
  return plan ? <PlanFields key={key} nodeKey={key} plan={plan} /> : null;
}

function PlanFields({ nodeKey, plan }: { nodeKey: string; plan: LeafPlan }) {
  const mode = useSignal<Mode>(modeOf(plan));
  const isRefused = useSignal(false);
  useEffect(() => { mode.value = modeOf(plan); }, [plan]);
  const apply = async (next: LeafPlan) => { isRefused.value = !await setPlan(nodeKey, next); };
  const choose = (chosen: Mode) => {
    mode.value = chosen;
    if (chosen === "ask") void apply({});
    else if (chosen === "S" || chosen === "F") void apply({ outcomes: chosen });
    else if (chosen === "chance") void apply({ chance: 0.5, seed: 1 });
  };
  const name = selectedNode.value?.name ?? "";
  const percent = Math.round(100 * (plan.chance ?? 0.5));
  return (
    <section class="leaf-plan" aria-label={runTexts.plan(name)}>
      <label><span>{runTexts.plan(name)}</span>
        <select value={mode.value} onChange={(event) => choose(event.currentTarget.value as Mode)}>
          {MODES.map((item) => <option key={item} value={item}>{runTexts.modes[item]}</option>)}
        </select>
      </label>
      {mode.value === "outcomes" && (
        <>
          <label><span>{runTexts.outcomes}</span>
            <input defaultValue={plan.outcomes ?? ""} placeholder="RRS|F" maxLength={10_000} aria-invalid={isRefused.value} title={runTexts.outcomesHint}
              onChange={(event) => void apply({ outcomes: event.currentTarget.value.trim() })} />
          </label>
          <p class="dim">{runTexts.outcomesHint}</p>
        </>
      )}
      {mode.value === "chance" && (
        <>
          <label><span>{runTexts.chance}</span>
            <input type="number" min={0} max={100} value={percent}
              onChange={(event) => void apply({ chance: Number(event.currentTarget.value) / 100, seed: plan.seed ?? 1 })} />
          </label>
          <label><span>{runTexts.seed}</span>
            <input type="number" min={0} max={999_999} value={plan.seed ?? 1}
              onChange={(event) => void apply({ chance: plan.chance ?? 0.5, seed: Math.trunc(Number(event.currentTarget.value)) })} />
          </label>
        </>
      )}
    </section>
  );
}
