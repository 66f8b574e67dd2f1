// The proof: questions about all runs of the shown tree, the answers, and their counterexamples.

import "./proof.css";
import { signal } from "@preact/signals";
import type { Home } from "./home";
import type { ProofAnswer, ProofProgress, ProofResult, ShownRun } from "./protocol";
import { openRun } from "./shown_run";
import { SiteHome } from "./site/home";
import { actions, drawing, message, reasonOf, showError, tree, uri } from "./state";
import { proofTexts } from "./texts";
import { inOrderOfConcern, linesOf, summaryOf } from "./proof_answers";

const MARKS: Record<ProofAnswer["answer"], string> = { proved: "✔", refuted: "✘", possible: "?", unknown: "?" };
const [MIN_SECONDS, MAX_SECONDS] = [1, 600];

export const isProofOpen = signal(false);
/** The fields, which stay when the panel is closed. */
const questions = signal("");
const given = signal("");
const seconds = signal(30);
/** The search that is running; null if there is none. */
const search = signal<{ progress: ProofProgress | null } | null>(null);
/** The number of searches that have begun or were stopped. */
let searches = 0;
const found = signal<ProofResult | null>(null);
const isOutdated = signal(false);

export function receiveProgress(progress: ProofProgress): void {
  if (search.value) search.value = { progress };
}

/** Note that a text has changed. */
export function noteProofEdit(): void {
  if (found.value || search.value) isOutdated.value = true;
}

async function prove(): Promise<void> {
  const shown = tree.value ?? drawing.value?.tree ?? null;
  const number = ++searches;
  search.value = { progress: null };
  found.value = null;
  isOutdated.value = false;
  message.value = proofTexts.starting;
  try {
    const result = await actions.request<ProofResult>("btcore/prove", {
      textDocument: { uri: uri.value }, tree: shown, questions: linesOf(questions.value), given: given.value.split(/[\s,]+/).filter(Boolean),
      seconds: Math.max(MIN_SECONDS, Math.min(MAX_SECONDS, seconds.value || MIN_SECONDS)),
    });
    if (number !== searches) return;
    found.value = result;
    message.value = proofTexts.summary(summaryOf(result.answers), shown ?? "");
  } catch (error) {
    if (number === searches) message.value = reasonOf(error);
  } finally {
    if (number === searches) search.value = null;
  }
}

/** End the search. On a site it shares its process with everything else, which starts again. */
async function stop(home: Home): Promise<void> {
  searches += 1;
  search.value = null;
  if (home instanceof SiteHome) await home.restart();
  else await actions.request("btcore/stopProof", {});
  message.value = proofTexts.stopped;
}

async function play(answer: ProofAnswer): Promise<void> {
  const { proof, answers } = found.value!;
  const run = await actions.request<ShownRun>("btcore/counterexample", { proof, answer: answers.indexOf(answer) });
  const notes = [answer.detail, answer.cycle ? proofTexts.cycle(answer.cycle) : ""].filter(Boolean);
  openRun(run, proofTexts.counterexample(answer.question), notes);
  message.value = proofTexts.shown(run.count);
}

export function Proof({ home }: { home: Home }) {
  if (!isProofOpen.value) return null;
  const running = search.value;
  const submit = (event: Event) => {
    event.preventDefault();
    if (!search.value) void prove();
  };
  return (
    <section class="proof" aria-label={proofTexts.panel}>
      <div class="row">
        <h2>{proofTexts.panel}</h2>
        <button class="small" aria-label={proofTexts.close} title={proofTexts.close} onClick={() => { isProofOpen.value = false; }}>×</button>
      </div>
      <form onSubmit={submit}>
        <p class="dim">{proofTexts.about}</p>
        <label>{proofTexts.questions}
          <textarea rows={3} maxLength={50_000} spellcheck={false} placeholder={proofTexts.questionsHint} value={questions.value}
            onInput={(event) => { questions.value = event.currentTarget.value; }} />
        </label>
        <div class="fields">
          <label>{proofTexts.given}
            <input maxLength={10_000} spellcheck={false} autocomplete="off" value={given.value} onInput={(event) => { given.value = event.currentTarget.value; }} />
          </label>
          <label>{proofTexts.seconds}
            <input type="number" min={MIN_SECONDS} max={MAX_SECONDS} value={seconds.value} onInput={(event) => { seconds.value = Number(event.currentTarget.value); }} />
          </label>
        </div>
        <div class="row">
          {running
            ? <button key="stop" type="button" onClick={() => void stop(home).catch(showError)}>{proofTexts.stop}</button>
            : <button key="ask" class="primary">{proofTexts.ask}</button>}
          {running && <span class="dim">{running.progress ? proofTexts.searching(running.progress) : proofTexts.starting}</span>}
        </div>
      </form>
      {found.value && <Answers result={found.value} />}
    </section>
  );
}

function Answers({ result }: { result: ProofResult }) {
  return (
    <>
      {isOutdated.value && <p class="outdated">{proofTexts.outdated}</p>}
      <ul>
        {inOrderOfConcern(result.answers).map((answer) => (
          <li key={answer.question} class={answer.answer}>
            <i aria-hidden="true">{MARKS[answer.answer]}</i>
            <span>
              <b>{answer.question}</b> <em>{proofTexts.answers[answer.answer]}</em>
              {answer.vacuous && <small> {proofTexts.vacuous}</small>}
              {answer.detail && <small class="dim"> {answer.detail}</small>}
            </span>
            {answer.playable && (
              <button class="small" title={proofTexts.playTitle(answer.question)} onClick={() => void play(answer).catch(showError)}>{proofTexts.play}</button>
            )}
          </li>
        ))}
      </ul>
      <p class="dim">{proofTexts.searched(result.answers[0]?.states ?? 0, result.ticks)}</p>
    </>
  );
}
