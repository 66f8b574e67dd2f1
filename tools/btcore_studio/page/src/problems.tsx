import { computed } from "@preact/signals";
import { useState } from "preact/hooks";
import type { Diagnostic, Range, WorkspaceEdit } from "./protocol";
import { actions, diagnostics, start, uri } from "./state";
import { texts } from "./texts";
import { fileName } from "./toolbar";

const MAX_SHOWN = 200;

export interface CodeAction { title: string; edit?: WorkspaceEdit; isPreferred?: boolean; diagnostics?: Diagnostic[] }

const shown = computed(() =>
  [...diagnostics.value]
    .flatMap(([address, items]) => items.map((item) => ({ uri: address, item })))
    .sort((a, b) => (a.item.severity ?? 1) - (b.item.severity ?? 1)
      || Number(b.uri === uri.value) - Number(a.uri === uri.value)
      || a.uri.localeCompare(b.uri) || a.item.range.start.line - b.item.range.start.line),
);

/** Request the fixes of a range. */
export const codeActions = async (address: string, range: Range): Promise<CodeAction[]> =>
  (await actions.request<CodeAction[] | null>("textDocument/codeAction", {
    textDocument: { uri: address }, range, context: { diagnostics: [] },
  })) ?? [];

function Problem({ address, item, apply }: { address: string; item: Diagnostic; apply: (action: CodeAction) => void }) {
  const [fixes, setFixes] = useState<CodeAction[] | null>(null);
  const place = `${fileName(address)}:${item.range.start.line + 1}:${item.range.start.character + 1}`;
  const find = async () => {
    const all = await codeActions(address, item.range).catch(() => []);
    setFixes(all.filter((action) => action.edit && action.diagnostics?.some(
      (other) => other.code === item.code && other.message === item.message)));
  };
  return (
    <li class={item.severity === 1 ? "error" : "warning"}>
      <button class="plain" onClick={() => actions.reveal({ uri: address, position: item.range.start })}>
        <code>{item.code}</code> <span>{item.message}</span> <small>{place}</small>
      </button>
      {!start.value?.readOnly && (fixes
        ? fixes.map((action) => <button class="small" key={action.title} onClick={() => apply(action)}>{action.title}</button>)
        : <button class="small" onClick={find}>{texts.fix} …</button>)}
    </li>
  );
}

/** The errors and warnings of all files, with their fixes. */
export function Problems({ apply }: { apply: (action: CodeAction) => void }) {
  const [isOpen, setOpen] = useState(true);
  const all = shown.value;
  const errors = all.filter(({ item }) => item.severity === 1).length;
  const warnings = all.length - errors;
  const summary = [errors && `✘ ${texts.errors(errors)}`, warnings && `⚠ ${texts.warnings(warnings)}`].filter(Boolean).join("   ");
  return (
    <section class="problems" aria-label={texts.problems}>
      <button class={`summary ${errors ? "error" : warnings ? "warning" : ""}`} aria-expanded={isOpen} onClick={() => setOpen(!isOpen)}>
        {summary || `✔ ${texts.noProblems}`}
      </button>
      {isOpen && all.length > 0 && (
        <ul>
          {all.slice(0, MAX_SHOWN).map(({ uri: address, item }, index) => (
            <Problem key={`${address} ${item.code} ${item.message} ${index}`} address={address} item={item} apply={apply} />
          ))}
          {all.length > MAX_SHOWN && <li>{texts.moreProblems(all.length - MAX_SHOWN)}</li>}
        </ul>
      )}
    </section>
  );
}
