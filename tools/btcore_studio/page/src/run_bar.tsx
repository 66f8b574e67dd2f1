// The bar of a run below the picture: run, step, play, the timeline, and what can be saved.

import "./run.css";
import type { Home } from "./home";
import { advance, canRun, cut, endRun, filesOfRun, goTo, isEdited, isPlaying, mockRun, SPEEDS, speed, startRun, step, togglePlay } from "./mock_run";
import { isProofOpen } from "./proof";
import { EditedTreeButton } from "./shown_run";
import { RealRunBar, RealRunButton, RealRunForm, realRun } from "./real_run";
import { message, showError } from "./state";
import { proofTexts, runTexts, treeTexts } from "./texts";
import { Track } from "./timeline";

const STEPS = ["into", "over", "out"] as const;
/** The shapes of the buttons, 16 units wide. Fonts lack some of these signs. */
const SHAPES = {
  play: "M4 2.5v11l9-5.5z", pause: "M4 3h3v10H4zM9 3h3v10H9z", stop: "M3.5 3.5h9v9h-9z",
  back: "M13 3v10L5.5 8zM3 3h1.8v10H3z", forth: "M3 3v10l7.5-5zM11.2 3H13v10h-1.8z",
  into: "M7.2 2h1.6v6h3L8 12 4.2 8h3zM4 13h8v1.6H4z",
  over: "M2.5 9.5a5.5 5.5 0 0 1 10-2.4V4h1.6v6H8.2V8.4h3.2a3.9 3.9 0 0 0-7.3 1.1zM6 12h4v1.8H6z",
  out: "M7.2 14h1.6V8h3L8 4 4.2 8h3zM4 1.6h8V3.2H4z",
};

const Icon = ({ name }: { name: keyof typeof SHAPES }) => (
  <svg class="icon" viewBox="0 0 16 16" width="16" height="16" aria-hidden="true"><path d={SHAPES[name]} /></svg>
);

export function RunBar({ home }: { home: Home }) {
  const run = mockRun.value;
  if (!run) return realRun.value ? <RealRunBar /> : canRun.value ? <StartBar /> : null;
  const { state } = run;
  const { moment: at, event } = state;
  const isAtEnd = at.position === state.count;
  const save = async (isTest: boolean) => {
    try {
      const files = await filesOfRun(isTest);
      for (const { name, text } of files) await home.export(name, new Blob([text], { type: "text/plain" }));
      message.value = runTexts.saved(files.map(({ name }) => name), isTest);
    } catch (error) {
      showError(error);
    }
  };
  const name = event ? runTexts.within(at.tick) : at.tick ? treeTexts.tick(at.tick) : treeTexts.beginning;
  return (
    <section class="run-bar" aria-label={runTexts.bar}>
      {isEdited.value && (
        <p class="run-note">
          {runTexts.edited} <button class="small" onClick={() => void startRun(true)}>{runTexts.again}</button>{" "}
          <EditedTreeButton />
        </p>
      )}
      <div class="timeline">
        <div class="group">
          <button class="play" aria-pressed={isPlaying.value} title={`${runTexts.play} (R)`} aria-label={runTexts.play} onClick={togglePlay}>
            <Icon name={isPlaying.value ? "pause" : "play"} />
          </button>
          <select aria-label={runTexts.speed} title={runTexts.speed} value={speed.value} onChange={(change) => { speed.value = Number(change.currentTarget.value); }}>
            {SPEEDS.map((factor) => <option key={factor} value={factor}>{factor}×</option>)}
          </select>
        </div>
        <div class="group" role="group" aria-label={runTexts.steps}>
          <button title={`${runTexts.back} (,)`} aria-label={runTexts.back} disabled={!at.position && !event} onClick={() => step(-1)}><Icon name="back" /></button>
          <button title={`${runTexts.tick} (.)`} aria-label={runTexts.tick} onClick={() => step(1)}><Icon name="forth" /></button>
          {STEPS.map((to) => (
            <button key={to} title={`${runTexts.step[to]} (${runTexts.stepKeys[to]})`} aria-label={runTexts.step[to]} onClick={() => void advance(to)}><Icon name={to} /></button>
          ))}
        </div>
        <Track
          {...state} position={at.position} at={at} name={name} label={runTexts.moment}
          goTo={(position) => void goTo(position)}
        />
        <div class="group run-files">
          {!isAtEnd && <button title={runTexts.cutTitle} onClick={() => void cut()}>{runTexts.cut}</button>}
          <button title={runTexts.recordingTitle} disabled={!state.count} onClick={() => void save(false)}>{runTexts.recording}</button>
          <button title={runTexts.testTitle} disabled={!state.count} onClick={() => void save(true)}>{runTexts.test}</button>
          <button title={runTexts.stop} aria-label={runTexts.stop} onClick={() => void endRun()}><Icon name="stop" /></button>
        </div>
      </div>
    </section>
  );
}

function StartBar() {
  return (
    <section class="run-bar start" aria-label={runTexts.bar}>
      <div class="timeline">
        <div class="group">
          <button class="play" title={`${runTexts.startTitle} (R)`} onClick={togglePlay}><Icon name="play" /> {runTexts.start}</button>
          <button title={`${runTexts.step.into} (S)`} onClick={() => void advance("into")}><Icon name="into" /> {runTexts.stepInto}</button>
          <RealRunButton />
        </div>
        <button aria-expanded={isProofOpen.value} title={proofTexts.openTitle} onClick={() => { isProofOpen.value = !isProofOpen.value; }}>{proofTexts.open}</button>
        <p>{runTexts.hint}</p>
      </div>
      <RealRunForm />
    </section>
  );
}
