// Tests of the extension's logic: VS Code is a stub, btcore's processes are real. BTCORE names the command.
import assert from "node:assert/strict";
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import path from "node:path";
import { fileURLToPath, pathToFileURL } from "node:url";
import { test, after } from "node:test";
import { build } from "esbuild";

const here = path.dirname(fileURLToPath(import.meta.url));
const folder = mkdtempSync(path.join(tmpdir(), "btcore-vscode-"));
after(() => rmSync(folder, { recursive: true }));
const stub = path.join(here, "vscode_stub.mjs");
const bundle = path.join(folder, "extension.mjs");
// Both share one instance of the stub.
const external = { name: "stub", setup: (plugin) => plugin.onResolve({ filter: /^vscode(-languageclient\/node)?$/ }, () => ({ path: pathToFileURL(stub).href, external: true })) };
await build({ entryPoints: [path.join(here, "../src/extension.ts")], bundle: true, platform: "node", format: "esm", outfile: bundle, plugins: [external] });
const vscode = await import(pathToFileURL(stub).href);
const extension = await import(pathToFileURL(bundle).href);

const BTCORE = process.env.BTCORE ?? "btcore";
vscode.configuration.set("command", BTCORE);
const XML = `<root BTCPP_format="4">
  <BehaviorTree ID="Runde">
    <Sequence name="Küche 🍳">
      <AlwaysSuccess name="eins"/>
      <SubTree ID="Teil"/>
      <SubTree ID="Teil"/>
    </Sequence>
  </BehaviorTree>
  <BehaviorTree ID="Teil">
    <AlwaysFailure name="zwei"/>
  </BehaviorTree>
</root>
`;
const file = path.join(folder, "Küche ; echo $(x).xml");
writeFileSync(file, XML);
const document = new vscode.Document(file);
vscode.workspace.textDocuments.push(document);
const context = { subscriptions: [] };
await extension.activate(context);
vscode.window.activeTextEditor = { document };
const call = (name, ...args) => vscode.handlers.get(`btcore.${name}`)(...args);

test("every command of the manifest is registered, and no other", () => {
  const manifest = JSON.parse(readFileSync(path.join(here, "../package.json"), "utf8"));
  assert.deepEqual([...vscode.handlers.keys()].sort(), manifest.contributes.commands.map((item) => item.command).sort());
});

test("XML with behavior trees changes its language, other XML does not", async () => {
  assert.equal(document.languageId, "behaviortree");
  writeFileSync(path.join(folder, "other.xml"), "<project/>");
  const other = new vscode.Document(path.join(folder, "other.xml"));
  vscode.fire("open", other);
  assert.equal(other.languageId, "xml");
});

test("the language server gets the settings, and no trust in an untrusted workspace", async () => {
  const client = vscode.calls.clients.at(-1);
  // With a transport the real client would add an argument, such as --stdio.
  assert.deepEqual(client.server, { command: BTCORE, args: ["lsp"] });
  vscode.configuration.set("trusted", true).set("plugins", ["leaves.py", 7]).set("models", ["m.xml"]);
  vscode.fire("configuration", { affectsConfiguration: (name) => name === "btcore" });
  assert.deepEqual(client.sent.at(-1)[1], { settings: { btcore: { trusted: true, plugins: ["leaves.py"], models: ["m.xml"], given: [] } } });
  vscode.workspace.isTrusted = false;
  vscode.fire("configuration", { affectsConfiguration: (name) => name === "btcore" });
  assert.deepEqual(client.sent.at(-1)[1].settings.btcore, { trusted: false, plugins: [], models: ["m.xml"], given: [] });
  vscode.workspace.isTrusted = true;
  vscode.configuration.set("trusted", false).set("models", []);
});

test("a command that is missing is explained", async () => {
  vscode.configuration.set("command", "missing");
  await call("restart");
  assert.match(vscode.calls.errors.at(-1), /pip install 'btcore\[lsp\]'/);
  vscode.configuration.set("command", BTCORE);
  await call("restart");
});

test("commands pass the file as one argument, without a shell", async () => {
  document.type(XML.replace("eins", "1"));
  await call("run", document.uri.toString(), "Runde");
  const { process, args } = vscode.calls.tasks.at(-1).execution;
  assert.deepEqual([process, args], [BTCORE, ["run", "--tree", "Runde", "--", file]]);
  assert.equal(document.isDirty, false);
  for (const name of ["validate", "prove"]) {
    await call(name);
    assert.deepEqual(vscode.calls.tasks.at(-1).execution.args, [name, "--", file]);
  }
  await call("monitor");
  assert.deepEqual(vscode.calls.tasks.at(-1).execution.args, ["monitor", "--", "tcp://127.0.0.1:1667"]);
});

test("a document in format 3 is converted as an edit", async () => {
  const old = path.join(folder, "old.xml");
  writeFileSync(old, '<root main_tree_to_execute="A"><BehaviorTree ID="A"><SequenceStar><AlwaysSuccess/></SequenceStar></BehaviorTree></root>');
  const third = new vscode.Document(old, "behaviortree");
  vscode.window.activeTextEditor = { document: third };
  await call("convert");
  assert.match(vscode.calls.edits.at(-1)?.text ?? "", /BTCPP_format="4"[^]*SequenceWithMemory/);
  vscode.window.activeTextEditor = { document };
});

test("the preview shows unsaved text, moves the cursor, follows it, and sets breakpoints", async () => {
  await document.save();
  await call("show", document.uri.toString(), "Runde");
  const panel = vscode.calls.panels.at(-1);
  const ask = async (name, body) => {
    const id = Math.random();
    panel.receive({ type: "request", id, name, body });
    return (await vscode.message(panel, (item) => item.id === id)).value;
  };
  const drawing = await ask("drawing", { tree: "Runde", folded: [] });
  assert.deepEqual(drawing.nodes.map((node) => node.name), ["Küche 🍳", "1", "Teil", "zwei", "Teil", "zwei"]);
  const { html } = await vscode.message(panel, (item) => item.type === "page");
  assert.match(html, /script-src 'nonce-/);
  assert.ok(!html.includes('src="preview.js"') && !html.includes("(prefers-color-scheme"));
  if (process.env.SAVE_PAGE) writeFileSync(process.env.SAVE_PAGE, html);

  panel.receive({ type: "ready" });
  assert.ok((await vscode.message(panel, (item) => item.name === "document")).value.drawable);
  assert.equal((await vscode.message(panel, (item) => item.type === "tree")).tree, "Runde");

  let from = panel.sent.length;
  document.type(document.text.replace("zwei", "drei"));
  await vscode.message(panel, (item) => item.name === "document" && item.value.unsaved, from);
  assert.equal((await ask("drawing", { tree: "Runde", folded: [] })).nodes[3].name, "drei");
  assert.ok(!readFileSync(file, "utf8").includes("drei"));
  from = panel.sent.length;
  document.type(document.text.replace("</Sequence>", ""));
  const broken = await vscode.message(panel, (item) => item.name === "document" && !item.value.drawable, from);
  assert.equal(broken.value.diagnostics[0].code, "E002");
  from = panel.sent.length;
  document.type(XML);
  await vscode.message(panel, (item) => item.name === "document" && item.value.drawable, from);

  panel.receive({ type: "reveal", file, line: 4, column: 7 });
  vscode.fire("selection", { textEditor: { document }, selections: [new vscode.Selection(new vscode.Position(9, 0), new vscode.Position(9, 0))] });
  assert.deepEqual(panel.sent.filter((item) => item.type === "cursor"), [{ type: "cursor", file, line: 10 }]);
  await new Promise(setImmediate);
  assert.deepEqual([vscode.window.shown.selection.active.line, vscode.window.shown.selection.active.character], [3, 6]);

  from = panel.sent.length;
  panel.receive({ type: "breakpoint", file, line: 10 });
  const live = await vscode.message(panel, (item) => item.name === "live" && item.value.wanted.length, from);
  // The tree is called twice.
  assert.deepEqual(live.value.wanted, [drawing.nodes[3].key, drawing.nodes[5].key].sort());
  from = panel.sent.length;
  panel.receive({ type: "breakpoint", file, line: 10 });
  await vscode.message(panel, (item) => item.name === "live" && !item.value.wanted.length, from);

  panel.receive({ type: "request", id: -1, name: "text", body: { text: "x" } });
  assert.ok((await ask("drawing", { tree: "Teil", folded: [], styled: true })).svg.includes("<style>"));
  assert.ok(!panel.sent.some((item) => item.id === -1), "the page cannot change the text");
  panel.receive({ type: "export", name: "../../Teil.svg", svg: "<svg/>" });
  await new Promise(setImmediate);
  assert.deepEqual([...vscode.calls.written.keys()], [path.join(folder, ".._.._Teil.svg")]);
  panel.dispose();
});

test("a preview that cannot start is explained", async () => {
  vscode.configuration.set("command", path.join(folder, "nowhere"));
  await call("show");
  const panel = vscode.calls.panels.at(-1);
  await new Promise((resolve) => panel.onDidDispose(resolve));
  assert.match(vscode.calls.errors.at(-1), /btcore preview ended: .*ENOENT/);
});

test("a server that is starting can be restarted", async () => {
  const before = vscode.calls.clients.length;
  vscode.configuration.set("command", "missing");
  const first = call("restart");
  vscode.configuration.set("command", BTCORE);
  await Promise.all([first, call("restart")]);
  const [failed, last] = vscode.calls.clients.slice(before);
  assert.equal(last?.server.command, BTCORE);
  assert.ok(failed?.started && last.started && !last.stopped);
});

test("deactivation stops the server", async () => {
  await extension.deactivate();
  assert.ok(vscode.calls.clients.at(-1).stopped || vscode.calls.clients.at(-2).stopped);
});
