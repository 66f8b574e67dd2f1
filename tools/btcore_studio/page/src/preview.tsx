// What an operation would do, shown before it is done: the problems that it adds, or why it is refused.

import { useSignal } from "@preact/signals";
import { useEffect, useMemo } from "preact/hooks";
import { messageOf } from "./problems";
import type { Command, Problem } from "./protocol";
import { actions, reasonOf, start } from "./state";
import { texts } from "./texts";

/** Neither a pointer that only passes nor fast typing sends a request. */
const WAIT_MS = 180;

/** The problems that an operation would add; *refusal* is why it cannot be done, or "". */
export interface PreviewResult { problems: readonly Problem[]; refusal: string }

/** Makes the command, or returns why there is none. */
export type MakeCommand = () => Command | string | null | Promise<Command | string | null>;

async function previewOf(make: MakeCommand): Promise<PreviewResult> {
  try {
    const command = await make();
    if (typeof command === "string") return { problems: [], refusal: command };
    const { problems } = command ? await actions.preview(command) : { problems: [] };
    return { problems, refusal: "" };
  } catch (error) {
    return { problems: [], refusal: reasonOf(error) };
  }
}

/** Return a function that previews a command after a pause, unless it is called again before; null removes the preview. */
export function previewer(show: (preview: PreviewResult | null) => void): (make: MakeCommand | null) => void {
  let timer = 0;
  let last = 0;
  return (make) => {
    clearTimeout(timer);
    const own = ++last;
    show(null);
    if (!make || start.value?.readOnly) return;
    timer = window.setTimeout(async () => {
      const preview = await previewOf(make);
      if (own === last) show(preview);
    }, WAIT_MS);
  };
}

/** Return the preview of a command, and the function that requests it. */
export function usePreview(): [PreviewResult | null, (make: MakeCommand | null) => void] {
  const preview = useSignal<PreviewResult | null>(null);
  const requestPreview = useMemo(() => previewer((found) => { preview.value = found; }), []);
  useEffect(() => () => requestPreview(null), []);
  return [preview.value, requestPreview];
}

/** Return a sentence about an operation that is refused or adds a problem, or "". */
export function warningOf(preview: PreviewResult | null): string {
  if (!preview) return "";
  const [first, ...others] = preview.problems;
  return preview.refusal || (first ? texts.wouldAdd(first.severity === 1, messageOf(first), others.length) : "");
}

export const levelOf = (preview: PreviewResult | null): "error" | "warning" =>
  preview?.refusal || preview?.problems[0]?.severity === 1 ? "error" : "warning";

/** The warning of a preview. Screen readers read it when it appears. */
export function Warning({ preview }: { preview: PreviewResult | null }) {
  const text = warningOf(preview);
  return <p class={`preview ${levelOf(preview)}`} role="status">{text && `⚠ ${text}`}</p>;
}
