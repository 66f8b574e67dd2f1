// "What if" with another input at the shown moment: another result of the selected leaf, or another entry.

import type { WhatIf } from "./protocol";
import { selectedNode } from "./state";
import { baseRun, whatIf } from "./shown_run";
import { proofTexts, runTexts } from "./texts";
import { moment } from "./timeline";

const RESULTS = ["S", "F", "R", "K"] as const;
const DIGITS: Record<(typeof RESULTS)[number], number> = { R: 1, S: 2, F: 3, K: 4 };

export function WhatIfForm() {
  const at = moment.value;
  if (!at?.tick || baseRun.value === null) return null;
  const { tick } = at;
  const node = selectedNode.value;
  const leaf = node && at.leaves[node.key];
  const ask = (read: (data: FormData) => { change: string; results?: WhatIf["results"]; entries?: WhatIf["entries"] }) => (event: SubmitEvent) => {
    event.preventDefault();
    const { change, ...changes } = read(new FormData(event.currentTarget as HTMLFormElement));
    void whatIf(proofTexts.changedRun(change, tick), changes);
  };
  return (
    <details class="what-if">
      <summary>{proofTexts.whatIf}</summary>
      <p class="dim">{proofTexts.whatIfHint(tick)}</p>
      {node && leaf && (
        <form onSubmit={ask((data) => {
          const result = data.get("result") as (typeof RESULTS)[number];
          return { change: `${node.name}: ${runTexts.results[result]}`, results: [{ tick, key: node.key, result }] };
        })}>
          <label class="wide">{proofTexts.leafResult(node.name)}
            <select name="result">
              {RESULTS.filter((result) => DIGITS[result] !== leaf.status).map((result) => <option key={result} value={result}>{runTexts.results[result]}</option>)}
            </select>
          </label>
          <button>{proofTexts.runAgain}</button>
        </form>
      )}
      <form onSubmit={ask((data) => {
        const [key, value] = [String(data.get("key")).trim(), String(data.get("value"))];
        return { change: `${key} = ${value}`, entries: [{ tick, key, value }] };
      })}>
        <label>{proofTexts.entry}<input name="key" required maxLength={1000} autocomplete="off" spellcheck={false} /></label>
        <label>{proofTexts.value}<input name="value" maxLength={10_000} autocomplete="off" spellcheck={false} /></label>
        <button>{proofTexts.runAgain}</button>
      </form>
    </details>
  );
}
