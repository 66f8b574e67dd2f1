// Tests of the extension's logic: VS Code is a stub, btcore's processes are real. BTCORE names the command.
import assert from "node:assert/strict";
import { mkdtempSync, readdirSync, readFileSync, rmSync, symlinkSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import path from "node:path";
import { fileURLToPath, pathToFileURL } from "node:url";
import { test, after } from "node:test";
import { build } from "esbuild";
import { command, KINDS, random } from "./commands.mjs";

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
const context = { subscriptions: [], extensionUri: vscode.Uri.file("/extension") };
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
  vscode.workspace.textDocuments.push(third);
  vscode.window.activeTextEditor = { document: third };
  await call("convert");
  assert.match(third.text, /BTCPP_format="4"[^]*SequenceWithMemory/);
  vscode.window.activeTextEditor = { document };
});

/** Open the studio of a document; return its web view, with the state of the page. */
async function open(shown, tree) {
  await call("show", shown.uri.toString(), tree);
  const panel = vscode.calls.panels.find((item) => item.document === shown);
  const page = { panel, uri: shown.uri.toString(), tree: null, ask: panel.request, close: panel.dispose };
  page.start = await panel.request("studio/start", {});
  page.draw = async (wanted = page.start.tree) =>
    (page.drawing = await panel.request("btcore/drawing", { textDocument: { uri: page.uri }, tree: wanted, folded: [] }));
  /** Do what the page does for a command. */
  page.edit = async (command) => {
    const { versions } = page.drawing;
    const result = await panel.request("btcore/edit", { command, versions });
    await panel.request("studio/apply", { edit: result.edit });
    return result;
  };
  return page;
}

/** Return the next message of the extension with a method, for which *matches* holds. */
const notified = (panel, method, matches, from) =>
  vscode.message(panel, (item) => item.method === method && matches(item.params), from).then(({ params }) => params);
const names = ({ nodes }) => nodes.map(({ name }) => name);
const node = ({ nodes }, wanted) => nodes.find(({ name }) => name === wanted);

test("the page of the studio loads nothing but its own files", async () => {
  const { panel, start, close } = await open(document);
  const policy = /Content-Security-Policy" content="([^"]*)"/.exec(panel.html)[1];
  assert.match(policy, /^default-src 'none'; img-src blob:; style-src https:\/\/files.example; script-src 'nonce-[\w+/=]+'$/);
  assert.deepEqual([...panel.html.matchAll(/(?:src|href)="([^"]*)"/g)].map(([, address]) => address), [
    "https://files.example/extension/out/page/studio.css", "https://files.example/extension/out/page/studio.js",
  ]);
  assert.deepEqual(panel.webview.options.localResourceRoots.map(String), ["file:///extension/out/page"]);
  assert.deepEqual([start.uri, start.tree, start.live, start.readOnly], [document.uri.toString(), null, true, false]);
  close();
});

test("the studio shows unsaved text, and problems", async () => {
  const page = await open(document, "Runde");
  assert.equal(page.start.tree, "Runde");
  assert.deepEqual(names(await page.draw()), ["Küche 🍳", "1", "Teil", "zwei", "Teil", "zwei"]);
  let from = page.panel.sent.length;
  document.type(document.text.replace("zwei", "drei"));
  await notified(page.panel, "studio/changed", ({ uri }) => uri === page.uri, from);
  assert.equal(names(await page.draw())[3], "drei");
  assert.ok(!readFileSync(file, "utf8").includes("drei"));
  from = page.panel.sent.length;
  document.type(document.text.replace("<AlwaysFailure", "<Unknown"));
  const isHere = ({ uri, diagnostics }) => uri === page.uri && diagnostics.some(({ severity }) => severity === 1);
  await notified(page.panel, "textDocument/publishDiagnostics", isHere, from);
  const second = await open(document);
  assert.equal(second.panel, page.panel, "the studio is open already");
  from = page.panel.sent.length;
  document.type(XML);
  await notified(page.panel, "textDocument/publishDiagnostics", (params) => params.uri === page.uri && !isHere(params), from);
  await call("show", page.uri, "Teil");
  assert.deepEqual(await notified(page.panel, "studio/tree", () => true), { tree: "Teil" });
  page.close();
});

test("the cursor selects a node, and a node moves the cursor of the text beside", async () => {
  const page = await open(document);
  const editor = { document, viewColumn: 2, revealRange() {} };
  vscode.window.visibleTextEditors.push(editor);
  const at = (line, character) => ({ textEditor: editor, selections: [new vscode.Selection(new vscode.Position(line, character), new vscode.Position(line, character))] });
  vscode.fire("selection", at(9, 6));
  assert.deepEqual(page.panel.sent.at(-1).params, { uri: page.uri, position: { line: 9, character: 6 } });
  const drawing = await page.draw();
  const { place } = node(drawing, "Küche 🍳");
  page.panel.notify("studio/select", place);
  assert.deepEqual({ ...editor.selection.active }, place.position);
  const from = page.panel.sent.length;
  vscode.fire("selection", at(place.position.line, place.position.character));
  assert.equal(page.panel.sent.length, from, "the cursor that the page has moved selects nothing");
  await page.ask("studio/reveal", drawing.nodes[1].place);
  assert.deepEqual({ ...vscode.window.shown.selection.active }, drawing.nodes[1].place.position);
  vscode.window.visibleTextEditors.pop();
  page.close();
});

test("the page cannot do what it does not need", async () => {
  const page = await open(document);
  await assert.rejects(page.ask("workspace/executeCommand", { command: "x" }), { code: -32601 });
  await assert.rejects(page.ask("btcore/start", {}), { code: -32601 });
  const edits = [{ range: { start: { line: 0, character: 0 }, end: { line: 0, character: 0 } }, newText: "x" }];
  for (const uri of ["file:///etc/passwd", "untitled:tree.xml", "https://example.com/tree.xml", "tree.xml"]) {
    await assert.rejects(page.ask("studio/apply", { edit: { changes: { [uri]: edits } } }), (error) => error.message.length > 0);
  }
  await page.ask("studio/export", { name: "../../Teil.svg", base64: Buffer.from("<svg/>").toString("base64") });
  assert.deepEqual([...vscode.calls.written], [[path.join(folder, ".._.._Teil.svg"), "<svg/>"]]);
  page.close();
});

test("edits and commands of an earlier text apply to the present text", async () => {
  const page = await open(document);
  const drawing = await page.draw();
  const { place } = node(drawing, "eins");
  const before = document.text;
  const insert = (text) => ({ changes: { [page.uri]: [{ range: { start: place.position, end: place.position }, newText: text }] }, versions: drawing.versions });
  document.type(before.replace("<BehaviorTree", "<!-- ä\n -->\n<BehaviorTree"));
  await page.ask("studio/apply", { edit: insert("<!--here-->") });
  assert.ok(document.text.includes("<!--here--><AlwaysSuccess"));
  document.type(document.text.replace('<AlwaysSuccess name="eins"/>', ""));
  const gone = { range: { start: place.position, end: { ...place.position, character: place.position.character + 5 } }, newText: "" };
  await assert.rejects(page.ask("studio/apply", { edit: { changes: { [page.uri]: [gone] }, versions: drawing.versions } }), /repeat the command/);
  await assert.rejects(page.edit({ kind: "remove", nodes: [place] }), /not in the text any more/);
  document.type(before);
  await document.save();
  page.close();
});

/** Open the studio of a new file. */
async function openFile(name, text) {
  const target = path.join(folder, name);
  writeFileSync(target, text);
  return open(await vscode.workspace.openTextDocument(vscode.Uri.file(target)));
}

/** The texts of all files that a step of undo changes. */
const textsOf = (step) => step.map(({ document: { text } }) => text);

/** Apply a command; undo, redo and undo it again, and compare the texts. Returns null if it is refused. */
async function tryCommand(page, wanted) {
  const { undo } = vscode.steps;
  const count = undo.length;
  const done = await page.edit(wanted).catch((error) => assert.equal(error.code, -32803, error.message));
  if (!done || undo.length === count) return null;
  assert.equal(undo.length, count + 1, "a command is one step");
  const step = undo.at(-1);
  const [before, after] = ["before", "after"].map((side) => step.map((part) => part[side]));
  for (const [name, expected] of [["undo", before], ["redo", after], ["undo", before]]) {
    await page.ask(`studio/${name}`, {});
    assert.deepEqual(textsOf(step), expected, `${name} of ${wanted.kind}`);
  }
  return { after };
}

const TREES = readdirSync(path.join(here, "../../../trees"), { recursive: true }).filter((name) => name.endsWith(".xml"));

test("every command can be undone and repeated, to the byte", async () => {
  const done = new Set();
  const leaf = '<AlwaysSuccess name="eins"/>';
  const crlf = XML.replace(leaf, `<Inverter _skipIf='true'>\n\t${leaf}</Inverter>`).replaceAll("\n", "\r\n");
  for (const [name, text] of [["lf.xml", XML], ["crlf.xml", crlf]]) {
    const page = await openFile(name, text);
    for (const kind of KINDS) {
      const next = random(7);
      for (let trial = 0; trial < 12; trial++) {
        const wanted = command(kind, page.uri, await page.draw(), next);
        const { document: shown } = page.panel;
        if (wanted && (await tryCommand(page, wanted))) done.add(kind);
        assert.equal(shown.text, text);
      }
    }
    page.close();
  }
  assert.deepEqual([...done].sort(), [...KINDS].sort());
});

test("the page writes a leaf into new files below the folder only", async () => {
  const page = await openFile("leaf.xml", XML);
  const ports = [{ name: "goal", direction: "in", type: "int", default: "1", about: "Where." }];
  await page.draw();
  await page.edit({ kind: "set_model", uri: page.uri, id: "OpenDoor", type: "Action", ports });
  const [{ uri, name }] = await page.ask("btcore/files", {});
  assert.deepEqual([uri, name], [page.uri, "leaf.xml"]);
  const leaf = await page.ask("btcore/leaf", { textDocument: { uri: page.uri }, id: "OpenDoor" });
  const create = (name, text = leaf.text) => page.ask("btcore/create", { name, text });
  const created = await create(leaf.name);
  assert.equal(created.uri, vscode.Uri.file(path.join(folder, "open_door_node.py")).toString());
  assert.match(readFileSync(path.join(folder, "open_door_node.py"), "utf8"), /def open_door\(\n {4}goal: /);
  await create(leaf.testName, leaf.test);
  const outside = mkdtempSync(path.join(tmpdir(), "btcore-outside-"));
  after(() => rmSync(outside, { recursive: true }));
  symlinkSync(outside, path.join(folder, "link"));
  symlinkSync(path.join(outside, "x_node.py"), path.join(folder, "dangling_node.py"));
  const refused = {
    "open_door_node.py": /exists/, "dangling_node.py": /exists/, "link/a_node.py": /out of the folder/, "none/a_node.py": /no folder 'none'/,
    "../a_node.py": /without '\.\.'/, "a\\..\\b_node.py": /without '\.\.'/, "/tmp/a_node.py": /relative/, "C:a_node.py": /relative/, "~a_node.py": /relative/,
    ".git/a_node.py": /hidden/, "a.py": /must end/, "a\0_node.py": /control/, "": /length/,
  };
  for (const [name, reason] of Object.entries(refused)) await assert.rejects(create(name), { message: reason }, name);
  assert.deepEqual(readdirSync(outside), []);
  page.close();
});

test("an edit of several files is one step", async () => {
  const part = path.join(folder, "part.xml");
  const texts = ['<root BTCPP_format="4"><include path="part.xml"/><BehaviorTree ID="Main"><SubTree ID="Part"/></BehaviorTree></root>',
    '<root BTCPP_format="4"><BehaviorTree ID="Part"><AlwaysSuccess/></BehaviorTree></root>'];
  writeFileSync(part, texts[1]);
  const page = await openFile("whole.xml", texts[0]);
  const { document: whole } = page.panel;
  // A node of the included file is edited in its file, and drawn from the text that is not saved.
  const { nodes } = await page.draw();
  const included = await vscode.workspace.openTextDocument(vscode.Uri.file(part));
  assert.equal(nodes[1].place.uri, included.uri.toString());
  await page.edit({ kind: "set", node: nodes[1].place, name: "name", text: "ä" });
  texts[1] = texts[1].replace("Success/>", 'Success name="ä"/>');
  assert.deepEqual([whole.text, included.text, (await page.draw()).nodes[1].name], [...texts, "ä"]);
  const position = whole.positionAt(texts[0].indexOf("Part"));
  const edit = await page.ask("textDocument/rename", { textDocument: { uri: page.uri }, position, newName: "Teil" });
  await page.ask("studio/apply", { edit });
  assert.deepEqual([whole.text, included.text], texts.map((text) => text.replace('"Part"', '"Teil"')));
  await page.ask("studio/undo", {});
  assert.deepEqual([whole.text, included.text], texts);
  // The command before has changed the included document only.
  await page.ask("studio/undo", {});
  assert.deepEqual([whole.text, included.text], [texts[0], texts[1].replace(' name="ä"', "")]);
  assert.ok(page.panel.active, "the studio has the focus again");
  await page.ask("studio/redo", {});
  assert.deepEqual([whole.text, included.text], texts);
  page.close();
});

test("sequences of commands in the trees of the project are undone to the byte", async () => {
  const next = random(11);
  let count = 0;
  for (const name of TREES) {
    const text = readFileSync(path.join(here, "../../../trees", name), "utf8");
    const page = await openFile(name.replaceAll(path.sep, "_"), text);
    const { document: shown } = page.panel;
    const first = vscode.steps.undo.length;
    for (let trial = 0; trial < 10; trial++) {
      const drawing = await page.draw(null);
      const wanted = command(KINDS[Math.floor(next() * KINDS.length)], page.uri, drawing, next);
      if (wanted) await page.edit(wanted).catch((error) => assert.equal(error.code, -32803, error.message));
    }
    const done = vscode.steps.undo.length - first;
    for (let step = 0; step < done; step++) await page.ask("studio/undo", {});
    count += done;
    assert.equal(shown.text, text, name);
    page.close();
  }
  assert.ok(count > 3 * TREES.length, `only ${count} commands were not refused`);
});

test("breakpoints in the margin are those of the running tree", async () => {
  const page = await open(document, "Runde");
  const { nodes } = await page.draw();
  const wanted = (expected) => ({ wanted: keys }) => keys.length === expected.length && expected.every((key) => keys.includes(key));
  const set = async (keys, expected) => {
    const from = page.panel.sent.length;
    await page.ask("btcore/breakpoints", { keys });
    await notified(page.panel, "btcore/live", wanted(expected), from);
  };
  // The tree is called twice.
  const twice = [nodes[3].key, nodes[5].key];
  await set([nodes[3].key], twice);
  assert.deepEqual(vscode.debug.breakpoints.map(({ location }) => [location.uri.fsPath, location.range.start.line]), [[file, 9]]);
  await set([...twice, nodes[0].key], [...twice, nodes[0].key]);
  await set([nodes[0].key], [nodes[0].key]);
  const from = page.panel.sent.length;
  vscode.debug.addBreakpoints([new vscode.SourceBreakpoint(new vscode.Location(document.uri, new vscode.Position(3, 0)))]);
  await notified(page.panel, "btcore/live", wanted([nodes[0].key, nodes[1].key]), from);
  await set([], []);
  assert.deepEqual(vscode.debug.breakpoints, []);
  page.close();
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
