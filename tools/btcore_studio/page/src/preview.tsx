// What an operation would lead to, shown before it is done: the problems that it adds, or why it is refused.

import { useSignal } from "@preact/signals";
import { useEffect, useMemo } from "preact/hooks";
import { messageOf } from "./problems";
import type { Command, Problem } from "./protocol";
import { actions, reasonOf, start } from "./state";
import { texts } from "./texts";

/** A passing pointer or a fast typist asks for nothing. */
const WAIT_MS = 180;

/** What is known of an operation; *refusal* is why it cannot be done, or "". */
export interface Outlook { problems: readonly Problem[]; refusal: string }

/** Makes the command, or returns why there is none. */
export type Making = () => Command | string | null | Promise<Command | string | null>;

async function outlookOf(make: Making): Promise<Outlook> {
  try {
    const command = await make();
    if (typeof command === "string") return { problems: [], refusal: command };
    const { problems } = command ? await actions.preview(command) : { problems: [] };
    return { problems, refusal: "" };
  } catch (error) {
    return { problems: [], refusal: reasonOf(error) };
  }
}

/** Return a function that looks at a command after a pause, unless another follows meanwhile; null ends the showing. */
export function previewer(show: (outlook: Outlook | null) => void): (make: Making | null) => void {
  let timer = 0;
  let last = 0;
  return (make) => {
    clearTimeout(timer);
    const own = ++last;
    show(null);
    if (!make || start.value?.readOnly) return;
    timer = window.setTimeout(async () => {
      const outlook = await outlookOf(make);
      if (own === last) show(outlook);
    }, WAIT_MS);
  };
}

/** The outlook of the last command that the returned function was called with. */
export function usePreview(): [Outlook | null, (make: Making | null) => void] {
  const outlook = useSignal<Outlook | null>(null);
  const look = useMemo(() => previewer((found) => { outlook.value = found; }), []);
  useEffect(() => () => look(null), []);
  return [outlook.value, look];
}

/** Return a sentence about an operation that is refused or adds a problem, or "". */
export function warningOf(outlook: Outlook | null): string {
  if (!outlook) return "";
  const [first, ...others] = outlook.problems;
  return outlook.refusal || (first ? texts.wouldAdd(first.severity === 1, messageOf(first), others.length) : "");
}

export const levelOf = (outlook: Outlook | null): "error" | "warning" =>
  outlook?.refusal || outlook?.problems[0]?.severity === 1 ? "error" : "warning";

/** What an operation would lead to. Screen readers read it when it appears. */
export function Warning({ outlook }: { outlook: Outlook | null }) {
  const text = warningOf(outlook);
  return <p class={`outlook ${levelOf(outlook)}`} role="status">{text && `⚠ ${text}`}</p>;
}
