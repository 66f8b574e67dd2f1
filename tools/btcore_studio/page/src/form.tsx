// The form of the selected node. A field is written when it is left, or with Enter.

import { useSignal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { useEffect, useMemo, useRef } from "preact/hooks";
import { statusOf } from "./live";
import { edit, openTree, run } from "./operations";
import { SIGNS, Symbol } from "./palette";
import { usePreview } from "./preview";
import { hintOf, messageOf } from "./problems";
import { modelForm } from "./quick_state";
import type { Command, Diagnostic, DrawnNode, Field, NodeForm, Problem } from "./protocol";
import { actions, diagnostics, drawing, live, palette, problemsByKey, selectedNode, selectedNodes, start } from "./state";
import { moment } from "./timeline";
import { plain } from "./markdown";
import { statuses, treeTexts } from "./texts";
import { focusPicture } from "./view";

const NONE: Diagnostic[] = [];
let isPressed = false;
addEventListener("pointerdown", () => { isPressed = true; }, true);
for (const name of ["pointerup", "pointercancel"]) addEventListener(name, () => { isPressed = false; }, true);

/** Run a change of the layout, after a click that has begun: otherwise the click would miss its target. */
function afterPress(change: () => void): void {
  if (isPressed) addEventListener("click", () => setTimeout(change), { once: true, capture: true });
  else change();
}

export function Form() {
  const node = selectedNode.value;
  const form = useSignal<{ id: string; form: NodeForm } | null>(null);
  const place = node?.place;
  // The key of a node has its name, which the form changes.
  const id = place ? `${place.uri}#${place.position.line}:${place.position.character}` : "";
  // The attributes may have changed with each drawing.
  useEffect(() => {
    if (!node || !place) { form.value = null; return undefined; }
    let isCurrent = true;
    actions.request<NodeForm>("btcore/node", place).then(
      (value) => { if (isCurrent) form.value = { id, form: value }; },
      () => { if (isCurrent) form.value = null; });
    return () => { isCurrent = false; };
  }, [drawing.value, id]);
  if (!node) return <section class="form" aria-label={treeTexts.node}><p class="hint">{treeTexts.selectNode}</p></section>;
  if (selectedNodes.value.length > 1) {
    return <section class="form" aria-label={treeTexts.node}><p class="hint">{treeTexts.selectedNodes(selectedNodes.value.length)}</p></section>;
  }
  const shown = form.value?.id === id ? form.value.form : null;
  return (
    <section class="form" aria-label={treeTexts.node}>
      <Head node={node} />
      {shown ? <Fields key={id} node={node} form={shown} /> : <Ports node={node} />}
      <About text={shown?.about || drawing.value?.about[node.id] || ""} />
    </section>
  );
}

function Head({ node }: { node: DrawnNode }) {
  const state = statusOf(node.key, live.value);
  const item = palette.value.items.find(({ id, isEditable }) => id === node.id && isEditable);
  const glyph = /<path class="glyph" d="([^"]*)"/.exec(node.card);
  return (
    <header>
      <Symbol item={{ kind: node.kind, symbol: glyph?.[1] }} />
      <div>
        <h2>{node.name}{state && <Status {...state} />}</h2>
        <p>
          {treeTexts.kinds[node.kind]} · {node.calls ? `${node.id} ${node.calls}` : node.id}
          {node.disabled && <span class="status">{treeTexts.disabled}</span>}
        </p>
      </div>
      <div class="form-buttons">
        {node.calls && <button onClick={() => openTree(node)} title={treeTexts.operation.open}>{treeTexts.openTree}</button>}
        {!start.value?.readOnly && item && !node.calls && (
          <button onClick={() => { modelForm.value = { item }; }} title={treeTexts.modelOf(item.id)}>{treeTexts.editModel}</button>
        )}
        {!start.value?.readOnly && <button onClick={() => run("type")} title={treeTexts.operation.type}>{treeTexts.changeType}</button>}
      </div>
    </header>
  );
}

function Status({ status, result }: { status: number; result: number }) {
  if (status || !result) return <span class={`status s${status}`}>{statuses[status]}</span>;
  return <span class={`status s${result}`}>{treeTexts.lastResult(statuses[result]!)}</span>;
}

/** The attributes as they are drawn, while there is no form. */
function Ports({ node }: { node: DrawnNode }) {
  return <dl class="ports">{node.ports.map(([name, text]) => <div key={name}><dt>{name}</dt><dd>{text}</dd></div>)}</dl>;
}

/** A docstring, which has code between backquotes. */
function About({ text }: { text: string }) {
  if (!text) return null;
  return <p class="about">{plain(text).split("`").map((part, index) => index % 2 ? <code key={index}>{part}</code> : part)}</p>;
}

function Fields({ node, form }: { node: DrawnNode; form: NodeForm }) {
  const groups = Map.groupBy(form.fields, (field) => field.group);
  const conditions = groups.get("condition") ?? [];
  const written = conditions.filter((field) => field.text !== null);
  const problems = problemsByKey.value.get(node.key) ?? NONE;
  const line = (field: Field) => <FieldRow key={field.name} node={node} field={field} problems={problems} />;
  const [call, remapping] = [true, false].map((isOwn) => groups.get("subtree")?.filter(({ name }) => isOwn === /^(ID$|_)/.test(name)) ?? []);
  return (
    <>
      {groups.get("name")?.map(line)}
      {call!.map(line)}
      {remapping!.length > 0 && (
        <fieldset class="remapping">
          <legend>{treeTexts.remapping}</legend>
          <div class="remapping-head" aria-hidden="true"><span>{treeTexts.keyInside(node.calls)}</span><span>{treeTexts.keyOutside}</span></div>
          {remapping!.map(line)}
        </fieldset>
      )}
      {groups.has("port") && <fieldset><legend>{treeTexts.ports}</legend>{groups.get("port")!.map(line)}</fieldset>}
      {conditions.length > 0 && (
        <details class="conditions" open={written.length > 0}>
          <summary>{treeTexts.conditions}{written.length > 0 && <small>{written.length}</small>}</summary>
          {conditions.map(line)}
        </details>
      )}
      {groups.has("other") && <fieldset><legend>{treeTexts.other}</legend>{groups.get("other")!.map(line)}</fieldset>}
    </>
  );
}

function FieldRow({ node, field, problems }: { node: DrawnNode; field: Field; problems: Diagnostic[] }) {
  const input = useRef<HTMLInputElement & HTMLTextAreaElement>(null);
  const isFocused = useSignal(false);
  /** What is in the field. */
  const typed = useSignal<string | null>(null);
  const text = field.text ?? "";
  // The text of the file comes into the field, unless it is being edited.
  useEffect(() => {
    const element = input.current;
    if (element && (document.activeElement !== element || element.value === element.dataset.text)) element.value = text;
    if (element) {
      element.dataset.text = text;
      typed.value = element.value;
    }
  }, [text]);
  const id = `field-${field.name}`;
  const own = useMemo(() => problems.filter(({ data }) => data?.attributes.includes(field.name)), [problems]);
  /** The problems of the typed text, until the problems of the file are known. */
  const [preview, requestPreview] = usePreview();
  const previewed = useRef("");
  const published = diagnostics.value.get(node.place.uri);
  const isPreviewed = preview !== null && previewed.current === typed.value;
  const refused: Problem[] = isPreviewed && preview.refusal ? [{ severity: 1, message: preview.refusal }] : [];
  const shown = isPreviewed ? [...refused, ...preview.problems] : own;
  const isWrong = shown.some(({ severity }) => severity === 1);
  const marks = typed.value === null ? [] : marksOf(typed.value, isPreviewed ? typed.value : text, field.name, shown);
  const setting = (value: string): Command =>
    ({ kind: "set", node: node.place, name: field.name, text: value === "" && !field.isRequired ? null : value });
  const previewSetting = (value: string) => {
    previewed.current = value;
    requestPreview(value === text ? null : () => setting(value));
  };
  // Problems may be published while the field is being edited.
  useEffect(() => previewSetting(typed.value ?? text), [published]);
  const write = (value: string) => {
    typed.value = value;
    previewSetting(value);
  };
  const commit = () => {
    const { value, dataset } = input.current!;
    // Enter and then leaving the field commit once.
    if (value === text || value === dataset.text) return;
    dataset.text = value;
    void edit(setting(value));
  };
  const key = (event: KeyboardEvent) => {
    if (event.key === "Enter" && !(field.isScript && event.shiftKey)) {
      event.preventDefault();
      commit();
    } else if (event.key === "Escape") {
      input.current!.value = text;
      typed.value = text;
      focusPicture();
      event.preventDefault();
    } else if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "s") commit();
  };
  const leaf = moment.value?.leaves[node.key];
  const [read, wrote] = [leaf?.inputs[field.name], leaf?.outputs[field.name]];
  const describedBy = [shown.length && `${id}-errors`, field.about && `${id}-about`].filter(Boolean).join(" ");
  const common = {
    ref: input, id, name: field.name, spellcheck: false, autocomplete: "off", readOnly: start.value?.readOnly ?? false,
    placeholder: field.default ?? "", "aria-invalid": isWrong, "aria-required": field.isRequired,
    "aria-describedby": describedBy || undefined, defaultValue: text, onBlur: () => { commit(); afterPress(() => { isFocused.value = document.activeElement === input.current; }); },
    onFocus: () => { isFocused.value = true; }, onKeyDown: key, onInput: (event: InputEvent) => write((event.currentTarget as HTMLInputElement).value),
  };
  return (
    <div class={`field ${isWrong ? "invalid" : shown.length ? "doubtful" : ""}`}>
      <label for={id}>
        {field.direction && <i title={treeTexts.directions[field.direction]}>{SIGNS[field.direction]}</i>}
        <span>{field.name}</span>
        {field.isRequired && <em title={treeTexts.required}>*</em>}
        {field.type && <small>{field.type}</small>}
      </label>
      <Marked text={typed.value ?? text} isScript={field.isScript} marks={marks}>
        {field.isScript
          ? <textarea {...common} rows={1} />
          : <input {...common} class={/^(\{|=$)/.test(text) ? "key" : ""} list={field.choices.length ? `${id}-choices` : undefined} />}
      </Marked>
      {field.choices.length > 0 && <datalist id={`${id}-choices`}>{field.choices.map((choice) => <option key={choice} value={choice} />)}</datalist>}
      {read !== undefined && read !== text && <output class="value">= {read}</output>}
      {wrote !== undefined && wrote !== read && <output class="value">→ {wrote}</output>}
      {shown.length > 0 && <p class="errors" id={`${id}-errors`}>{shown.map((problem) => (
        <span key={problem.message} class={problem.severity === 1 ? "error" : "warning"}>{messageOf(problem)} <em>{hintOf(problem)}</em></span>
      ))}</p>}
      {field.about && <p class={`about ${isFocused.value ? "" : "folded"}`} id={`${id}-about`}>{plain(field.about)}</p>}
    </div>
  );
}

const TOKEN = /('[^']*'?|"[^"]*"?)|(\d[\w.]*)|\b(true|false|and|or|not)\b|([\p{L}_@][\p{L}\p{N}_.]*)|([^\s\w'"]+)|\s+|./gu;
const TOKENS = ["string", "number", "word", "name", "sign"];

/** A part of a text that has a problem. */
interface Mark { from: number; to: number; severity: number }

/** Return the marked parts of the text of a field that follow nothing but characters of *checked*, which has the problems. */
function marksOf(text: string, checked: string, name: string, problems: readonly Problem[]): Mark[] {
  const characters = [...checked];
  const offset = (count: number) => characters.slice(0, count).join("").length;
  return problems.flatMap(({ data, severity }) => {
    if (!characters.length || !data?.attributes.includes(name)) return [];
    const [start, end] = data.characters[1] ? data.characters : [0, characters.length];
    // What is missing at the end is shown at the last character.
    const first = Math.min(start, characters.length - 1);
    const mark = { from: offset(first), to: offset(Math.max(first + 1, end)), severity: severity ?? 1 };
    return text.startsWith(checked.slice(0, mark.to)) ? [mark] : [];
  });
}

/** A field with the colours of a script and the underlines of problems, which are in a copy of its text at the same place. */
function Marked({ text, isScript, marks, children }: { text: string; isScript: boolean; marks: readonly Mark[]; children: ComponentChildren }) {
  const copy = useRef<HTMLPreElement>(null);
  const tokens = isScript ? [...text.matchAll(TOKEN)] : [];
  const cuts = new Set([0, ...tokens.map(({ index }) => index), ...marks.flatMap(({ from, to }) => [from, to]), text.length]);
  const bounds = [...cuts].sort((a, b) => a - b);
  const parts = bounds.slice(1).map((to, index) => {
    const from = bounds[index]!;
    const token = tokens.findLast((found) => found.index <= from);
    const kind = token?.slice(1).findIndex((group) => group !== undefined) ?? -1;
    const mark = marks.filter((found) => found.from <= from && to <= found.to).sort((a, b) => a.severity - b.severity)[0];
    const classes = [kind >= 0 && `script-${TOKENS[kind]}`, mark && `marked ${mark.severity === 1 ? "error" : "warning"}`].filter(Boolean);
    return classes.length ? <span key={from} class={classes.join(" ")}>{text.slice(from, to)}</span> : text.slice(from, to);
  });
  const follow = (event: Event) => { if (copy.current) copy.current.scrollLeft = (event.target as Element).scrollLeft; };
  return (
    <div class={`copied ${isScript ? "script" : ""}`} onScrollCapture={follow}>
      {(isScript || marks.length > 0) && <pre aria-hidden="true" ref={copy}>{parts}{"\n"}</pre>}
      {children}
    </div>
  );
}
