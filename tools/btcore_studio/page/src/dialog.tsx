import { signal } from "@preact/signals";
import { useLayoutEffect, useRef } from "preact/hooks";
import { texts } from "./texts";

interface Question {
  title: string;
  /** A text field with this label, or only the choices. */
  label?: string;
  text?: string;
  /** Why the last answer was refused. */
  reason?: string;
  /** The buttons. With a field, the first one is that of Enter. */
  choices: readonly string[];
  answer: (choice: string, text: string) => void;
}

const question = signal<Question | null>(null);

/** Ask the user in a modal dialog. Nothing is called if the user cancels. */
export function ask(asked: Question): void {
  question.value = asked;
}

/** The dialog of `ask`. */
export function Dialog() {
  const dialog = useRef<HTMLDialogElement>(null);
  const asked = question.value;
  // Keys that follow at once are for the field.
  useLayoutEffect(() => {
    if (!asked) return;
    dialog.current?.showModal();
    dialog.current?.querySelector("input")?.select();
  }, [asked]);
  if (!asked) return null;
  // The browser gives the focus back when the dialog is closed before it is removed.
  const close = () => {
    dialog.current?.close();
    question.value = null;
  };
  const submit = (event: SubmitEvent) => {
    event.preventDefault();
    const text = String(new FormData(event.target as HTMLFormElement).get("text") ?? "");
    close();
    asked.answer((event.submitter as HTMLButtonElement | null)?.value ?? asked.choices[0] ?? "", text);
  };
  return (
    <dialog ref={dialog} onClose={() => { if (question.value === asked) question.value = null; }} aria-label={asked.title}>
      <h2>{asked.title}</h2>
      {asked.reason && <p class="error" id="reason">{asked.reason}</p>}
      <form onSubmit={submit}>
        {asked.label !== undefined && <label>{asked.label} <input name="text" defaultValue={asked.text ?? ""} autocomplete="off" aria-describedby={asked.reason && "reason"} /></label>}
        {asked.choices.map((choice) => <button key={choice} type="submit" value={choice}>{choice}</button>)}
        <button type="button" onClick={close}>{texts.cancel}</button>
      </form>
    </dialog>
  );
}
