import { computed, effect, signal } from "@preact/signals";
import { useState } from "preact/hooks";
import type { Home } from "./home";
import type { Diagnostic, Problem, WorkspaceEdit } from "./protocol";
import { actions, diagnostics, isSamePosition, start, uri } from "./state";
import { texts } from "./texts";
import { fileName } from "./toolbar";

const MAX_SHOWN = 200;
const MAX_LINE = 2 ** 31 - 1;

interface CodeAction { title: string; edit: WorkspaceEdit; diagnostics?: Diagnostic[] }

/** The offered changes of each document with problems. */
export const fixes = signal<ReadonlyMap<string, readonly CodeAction[]>>(new Map());

/** The documents whose first check has ended. */
export const checked = signal<ReadonlySet<string>>(new Set());

const shown = computed(() =>
  [...diagnostics.value]
    .flatMap(([address, items]) => items.map((item) => ({ address, item })))
    .sort((a, b) => (a.item.severity ?? 1) - (b.item.severity ?? 1)
      || Number(b.address === uri.value) - Number(a.address === uri.value)
      || a.address.localeCompare(b.address) || a.item.range.start.line - b.item.range.start.line),
);

const isSame = (a: Diagnostic, b: Diagnostic) =>
  a.code === b.code && a.message === b.message && isSamePosition(a.range.start, b.range.start);

// The server writes the hint into the lines after the message.
export const messageOf = ({ message }: Problem): string => message.split("\n", 1)[0]!;
export const hintOf = ({ message }: Problem): string => message.split("\n").slice(1).join(" ");

/** Return the fixes of a problem. */
export const fixesOf = (address: string, item: Diagnostic): CodeAction[] =>
  (fixes.value.get(address) ?? []).filter((action) => action.diagnostics?.some((other) => isSame(other, item)));

/** Request the fixes of all problems whenever they change. */
export function followProblems(home: Home): void {
  const known = new Map<string, readonly Diagnostic[]>();
  effect(() => {
    const wanted = new Set([...diagnostics.value.keys(), uri.value]);
    for (const address of wanted) {
      const items = diagnostics.value.get(address) ?? [];
      if (!address || known.get(address) === items || start.value?.readOnly) continue;
      known.set(address, items);
      void request(home, address).then((found) => {
        if (known.get(address) === items) fixes.value = new Map([...fixes.value, [address, found]]);
      }, () => {});
    }
  });
}

async function request(home: Home, address: string): Promise<CodeAction[]> {
  await home.documents?.load(address);
  const found = await actions.request<Partial<CodeAction>[] | null>("textDocument/codeAction", {
    textDocument: { uri: address }, context: { diagnostics: [] },
    range: { start: { line: 0, character: 0 }, end: { line: MAX_LINE, character: 0 } },
  });
  return (found ?? []).filter((action): action is CodeAction => Boolean(action.edit));
}

/** The errors and warnings of all files, with their fixes. */
export function Problems() {
  const [isOpen, setOpen] = useState(true);
  const all = shown.value;
  const errors = all.filter(({ item }) => item.severity === 1).length;
  const warnings = all.length - errors;
  const summary = [errors && `✘ ${texts.errors(errors)}`, warnings && `⚠ ${texts.warnings(warnings)}`].filter(Boolean).join("   ");
  const offers = (fixes.value.get(uri.value) ?? []).filter((action) => !action.diagnostics?.length);
  return (
    <section class="problems" aria-label={texts.problems}>
      <div class="row">
        <button class={`summary ${errors ? "error" : warnings ? "warning" : ""}`} aria-expanded={isOpen} onClick={() => setOpen(!isOpen)}>
          {summary || (checked.value.has(uri.value) ? `✔ ${texts.noProblems}` : uri.value && texts.checking)}
        </button>
        {offers.map((action) => <button class="small" key={action.title} onClick={() => actions.apply(action.edit)}>{action.title}</button>)}
      </div>
      {isOpen && all.length > 0 && (
        <ul>
          {all.slice(0, MAX_SHOWN).map(({ address, item }, index) => (
            <li key={`${address} ${item.code} ${item.message} ${index}`} class={item.severity === 1 ? "error" : "warning"}>
              <button class="plain" onClick={() => actions.reveal({ uri: address, position: item.range.start })}>
                <code>{item.code}</code> <span>{messageOf(item)} <em>{hintOf(item)}</em></span>{" "}
                <small>{fileName(address)}:{item.range.start.line + 1}:{item.range.start.character + 1}</small>
              </button>
              {fixesOf(address, item).map((action) => (
                <button class="small" key={action.title} onClick={() => actions.apply(action.edit)}>{action.title}</button>
              ))}
            </li>
          ))}
          {all.length > MAX_SHOWN && <li>{texts.moreProblems(all.length - MAX_SHOWN)}</li>}
        </ul>
      )}
    </section>
  );
}
