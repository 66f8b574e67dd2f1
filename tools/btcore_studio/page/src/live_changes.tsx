// Changes of a running tree: values of its blackboard, the result of the node at a breakpoint, and another text.

import { signal } from "@preact/signals";
import { useId, useLayoutEffect, useRef, useState } from "preact/hooks";
import { release } from "./announcer";
import { actions, live, message, nameOf, reasonOf, start, uri } from "./state";
import { treeTexts } from "./texts";

type Change = "force" | "values" | "reload";

/** Why a change of the running tree is not possible, or "". */
function refusalOf(change: Change): string {
  const state = live.value;
  if (start.value?.readOnly) return treeTexts.refusal.readOnlyRun;
  if (state?.connection !== "connected") return treeTexts.notConnected;
  return state.refusals?.[change] ?? treeTexts.refusal.noReply;
}

/** A button that is shown with the reason if the change is not possible. */
function ChangeButton({ change, label, title, run }: { change: Change; label: string; title: string; run: () => unknown }) {
  const refusal = refusalOf(change);
  return (
    <button type="button" title={refusal || title} aria-disabled={refusal !== ""}
      onClick={() => { if (refusal) message.value = refusal; else void run(); }}>
      {label}
    </button>
  );
}

const isReloading = signal(false);

async function reload(): Promise<void> {
  if (isReloading.value) return;
  isReloading.value = true;
  message.value = treeTexts.reloading;
  try {
    await actions.request("btcore/reload", { textDocument: { uri: uri.value } });
    message.value = treeTexts.reloaded;
  } catch (error) {
    message.value = treeTexts.notReloaded(reasonOf(error));
  } finally {
    isReloading.value = false;
  }
}

/** The buttons beside the address of the running tree. */
export function ChangeControls() {
  const state = live.value;
  if (state?.connection !== "connected" || !state.address) return null;
  const name = state.stopped && nameOf(state.stopped);
  return (
    <>
      {name && (["SUCCESS", "FAILURE"] as const).map((status) => (
        <ChangeButton key={status} change="force" label={treeTexts.force[status]} title={treeTexts.forceTitle(name, status)}
          run={() => release(status)} />
      ))}
      {uri.value && <ChangeButton change="reload" label={treeTexts.reload} title={treeTexts.reloadTitle} run={reload} />}
    </>
  );
}

/** The text to edit for a value, which is shown as JSON. A value that is too long to be shown is written anew. */
function editedText(shown: string): string {
  if (shown === "—" || shown.endsWith("…")) return "";
  try {
    const value: unknown = JSON.parse(shown);
    return typeof value === "string" ? value : shown;
  } catch {
    return shown;
  }
}

/** The value of an entry, which can be set. */
export function EntryValue({ path, name, value }: { path: string; name: string; value: string }) {
  const [isEdited, setEdited] = useState(false);
  const button = useRef<HTMLButtonElement>(null);
  const refusal = refusalOf("values");
  const close = () => {
    setEdited(false);
    requestAnimationFrame(() => button.current?.focus());
  };
  if (isEdited && !refusal) return <td><ValueField {...{ path, name, value, close }} /></td>;
  // Without an address, it is a recording or a run with mock leaves.
  if (refusal) return <td title={live.value?.address ? refusal : undefined}>{value}</td>;
  return (
    <td>
      <button ref={button} class="value" title={treeTexts.setValue(name)} aria-label={treeTexts.valueOf(name, value)} onClick={() => setEdited(true)}>
        {value}
      </button>
    </td>
  );
}

function ValueField({ path, name, value, close }: { path: string; name: string; value: string; close: () => void }) {
  const field = useRef<HTMLInputElement>(null);
  const [reason, setReason] = useState("");
  const id = useId();
  // At once: a later selection would replace what is typed meanwhile.
  useLayoutEffect(() => field.current!.select(), []);
  const set = async (event: Event) => {
    event.preventDefault();
    try {
      await actions.request("btcore/setEntry", { path, key: name, value: field.current!.value });
      message.value = treeTexts.valueSet(name);
      close();
    } catch (error) {
      setReason(reasonOf(error));
      message.value = reasonOf(error);
    }
  };
  return (
    <form class="value-field" onSubmit={(event) => void set(event)} onKeyDown={(event) => { if (event.key === "Escape") { event.stopPropagation(); close(); } }}>
      <input ref={field} defaultValue={editedText(value)} aria-label={treeTexts.setValue(name)} maxLength={10_000} spellcheck={false}
        autocomplete="off" aria-invalid={reason !== ""} aria-describedby={reason && id} />
      <button class="small">{treeTexts.set}</button>
      {reason && <p id={id} class="problem">{reason}</p>}
    </form>
  );
}
