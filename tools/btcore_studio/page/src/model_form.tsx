// The form of a node type: its ID, its type and its ports, written as a model of the file.

import { useSignal } from "@preact/signals";
import { useEffect, useLayoutEffect, useRef } from "preact/hooks";
import { edit } from "./operations";
import type { Leaf, PaletteItem, PalettePort } from "./protocol";
import { modelForm } from "./quick_state";
import { actions, files, message, reasonOf, uri } from "./state";
import { treeTexts } from "./texts";

type ModelType = keyof typeof treeTexts.modelTypes;
/** A port, and a number that no other port has. */
type Row = PalettePort & { row: number };

const TYPES = Object.keys(treeTexts.modelTypes) as ModelType[];
const DIRECTIONS = ["in", "out", "inout"] as const;
const COLUMNS = ["name", "direction", "type", "default", "about"] as const;
const PORT_TYPES = ["std::string", "int", "unsigned int", "double", "bool", "std::vector<std::string>", "std::vector<double>"];
const NEW_PORT: PalettePort = { name: "", direction: "in", type: "", default: "", about: "" };

export function ModelForm() {
  return modelForm.value && <OpenForm item={modelForm.value.item} />;
}

/** Write the Python code of a node and its test into new files in a folder. Return their names. */
async function writeLeaf(address: string, folder: string, id: string): Promise<[name: string, test: string]> {
  const leaf = await actions.request<Leaf>("btcore/leaf", { textDocument: { uri: address }, id });
  const names: [string, string] = [folder + leaf.name, folder + leaf.testName];
  await actions.request("btcore/create", { name: names[0], text: leaf.text });
  await actions.request("btcore/create", { name: names[1], text: leaf.test });
  return names;
}

function OpenForm({ item }: { item: PaletteItem | null }) {
  const dialog = useRef<HTMLDialogElement>(null);
  const id = useSignal(item?.id ?? "");
  const type = useSignal(TYPES.find((name) => name.toLowerCase() === item?.kind) ?? "Action");
  const rows = useSignal<readonly Row[]>((item?.ports ?? []).map((port, row) => ({ ...port, row })));
  const nextRow = useRef(rows.value.length);
  const toFocus = useRef<number | null>(null);
  const refusal = useSignal("");
  const isWriting = useSignal(false);
  // The form is for the file that was shown when it was opened.
  const address = useRef(uri.value).current;
  const file = files.value.find((other) => other.uri === address)?.name;
  useEffect(() => dialog.current!.showModal(), []);
  useLayoutEffect(() => {
    if (toFocus.current === null) return;
    const names = dialog.current!.querySelectorAll<HTMLElement>(".model-port [name=name], [name=add]");
    names[Math.min(toFocus.current, names.length - 1)]?.focus();
    toFocus.current = null;
  }, [rows.value]);
  const add = () => {
    toFocus.current = rows.value.length;
    rows.value = [...rows.value, { ...NEW_PORT, row: nextRow.current++ }];
  };
  const remove = (index: number) => {
    toFocus.current = index;
    rows.value = rows.value.filter((_, other) => other !== index);
  };
  const change = (index: number, column: string, text: string) => {
    rows.value = rows.value.map((port, other) => other === index ? { ...port, [column]: text } : port);
  };
  const submit = async (event: SubmitEvent) => {
    event.preventDefault();
    if (isWriting.value) return;
    isWriting.value = true;
    const withLeaf = (event.submitter as HTMLButtonElement | null)?.name === "leaf";
    const ports = rows.value.map(({ row: _, name, ...port }) => ({ ...port, name: name.trim() }));
    const name = id.value.trim();
    const result = await edit({ kind: "set_model", uri: address, id: name, type: type.value, ports });
    refusal.value = result ? "" : message.value;
    try {
      if (result && withLeaf) message.value = treeTexts.leafWritten(...await writeLeaf(address, file!.slice(0, file!.lastIndexOf("/") + 1), name));
    } catch (error) {
      refusal.value = reasonOf(error);
    }
    isWriting.value = false;
    if (refusal.value) return;
    message.value ||= treeTexts.modelWritten(name);
    dialog.current?.close();
  };
  return (
    <dialog class="model" ref={dialog} aria-labelledby="model-title" onClose={() => { modelForm.value = null; }}>
      <h2 id="model-title">{item ? treeTexts.modelOf(item.id) : treeTexts.newModel}</h2>
      <form onSubmit={submit}>
        <label>
          {treeTexts.id}
          <input
            name="id" value={id.value} readOnly={item !== null} autofocus={item === null} required spellcheck={false} autocomplete="off"
            aria-describedby="model-refusal" onInput={(event) => { id.value = event.currentTarget.value; }}
          />
        </label>
        <label>
          {treeTexts.type}
          <select name="type" value={type.value} onChange={(event) => { type.value = event.currentTarget.value as ModelType; }}>
            {TYPES.map((name) => <option key={name} value={name}>{treeTexts.modelTypes[name]}</option>)}
          </select>
        </label>
        <fieldset>
          <legend>{treeTexts.ports}</legend>
          {rows.value.map((port, index) => (
            <div class="model-port" key={port.row}>
              {COLUMNS.map((column) => {
                const label = treeTexts.portField(treeTexts.portColumns[column], index + 1);
                return column === "direction" ? (
                  <select
                    key={column} name={column} aria-label={label} value={port.direction}
                    onChange={(event) => change(index, column, event.currentTarget.value)}
                  >{DIRECTIONS.map((name) => <option key={name} value={name}>{treeTexts.directions[name]}</option>)}</select>
                ) : (
                  <input
                    key={column} name={column} aria-label={label} placeholder={treeTexts.portColumns[column]} value={port[column]}
                    spellcheck={false} autocomplete="off" list={column === "type" ? "model-port-types" : undefined}
                    onInput={(event) => change(index, column, event.currentTarget.value)}
                  />
                );
              })}
              <button type="button" aria-label={treeTexts.removePort(port.name, index + 1)} title={treeTexts.removePort(port.name, index + 1)} onClick={() => remove(index)}>×</button>
            </div>
          ))}
          <button type="button" name="add" onClick={add}>{treeTexts.addPort}</button>
          <datalist id="model-port-types">{PORT_TYPES.map((name) => <option key={name} value={name} />)}</datalist>
        </fieldset>
        <p>{treeTexts.modelHint}{file && ` ${treeTexts.leafHint}`}</p>
        <p class="error" role="alert" id="model-refusal">{refusal.value}</p>
        <button type="submit" class="primary">{treeTexts.write}</button>
        {file && <button type="submit" name="leaf">{treeTexts.writeLeaf}</button>}
        <button type="button" onClick={() => dialog.current?.close()}>{treeTexts.cancel}</button>
      </form>
    </dialog>
  );
}
