import { execFile } from "node:child_process";
import { promisify } from "node:util";
import * as vscode from "vscode";
import { LANGUAGE } from "./language";
import { folderOf, libraryOptions, settings } from "./settings";

/** Return the document that a command concerns: of a code lens, or of the active editor, which may be a studio. */
export async function documentFor(uri?: unknown, ofStudio?: vscode.TextDocument): Promise<vscode.TextDocument | undefined> {
  const document =
    typeof uri === "string" || uri instanceof vscode.Uri
      ? await vscode.workspace.openTextDocument(typeof uri === "string" ? vscode.Uri.parse(uri) : uri)
      : (vscode.window.activeTextEditor?.document ?? ofStudio);
  if (document?.uri.scheme !== "file" || document.languageId !== LANGUAGE) {
    void vscode.window.showInformationMessage("Open an XML file with behavior trees first.");
    return undefined;
  }
  return document;
}

/** Run `btcore NAME ARGUMENTS…` in a terminal. No shell reads the arguments. */
async function execute(name: string, args: string[], folder: string): Promise<void> {
  const task = new vscode.Task(
    { type: "btcore" },
    vscode.TaskScope.Workspace,
    name,
    "btcore",
    new vscode.ProcessExecution(settings().command, [name, ...args], { cwd: folder }),
  );
  task.presentationOptions = { clear: true, showReuseMessage: false };
  await vscode.tasks.executeTask(task);
}

/** Run a command on the saved tree of a document in a terminal. */
async function executeOnTree(name: string, more: string[], document: vscode.TextDocument | undefined, tree?: unknown): Promise<void> {
  if (!document) return;
  if (document.isDirty) await document.save();
  const options = typeof tree === "string" ? ["--tree", tree] : [];
  await execute(name, [...options, ...libraryOptions(), ...more, "--", document.uri.fsPath], folderOf(document.uri).fsPath);
}

/** Replace the text of a document in format 3 by its conversion to format 4, as one edit that can be undone. */
async function convert(output: vscode.OutputChannel, document: vscode.TextDocument | undefined): Promise<void> {
  if (!document) return;
  if (document.isDirty) await document.save();
  const args = ["convert", ...libraryOptions(), "--", document.uri.fsPath];
  const version = document.version;
  try {
    const limits = { cwd: folderOf(document.uri).fsPath, maxBuffer: 64 << 20, timeout: 60_000 };
    const { stdout, stderr } = await promisify(execFile)(settings().command, args, limits);
    output.append(stderr);
    if (document.version !== version) throw new Error("the text was changed in the meantime");
    const edit = new vscode.WorkspaceEdit();
    const all = new vscode.Range(0, 0, document.lineCount, 0);
    edit.replace(document.uri, all, stdout);
    await vscode.workspace.applyEdit(edit);
  } catch (error) {
    output.append((error as { stderr?: string }).stderr || `${String(error)}\n`);
  }
  output.show(true);
}

/**
 * Register the commands, except those of the studio and of the language server.
 *
 * @param ofStudio Returns the document of the active studio.
 */
export function registerCommands(context: vscode.ExtensionContext, ofStudio: () => vscode.TextDocument | undefined): void {
  const output = vscode.window.createOutputChannel("btcore");
  const register = (name: string, action: (...args: unknown[]) => Promise<void>): vscode.Disposable =>
    vscode.commands.registerCommand(`btcore.${name}`, action);
  context.subscriptions.push(
    output,
    register("validate", async (uri, tree) => executeOnTree("validate", [], await documentFor(uri, ofStudio()), tree)),
    register("run", async (uri, tree) => executeOnTree("run", settings().runArguments, await documentFor(uri, ofStudio()), tree)),
    register("prove", async (uri, tree) => executeOnTree("prove", [], await documentFor(uri, ofStudio()), tree)),
    register("convert", async () => convert(output, await documentFor(undefined, ofStudio()))),
    register("monitor", async () => {
      const folder = vscode.workspace.workspaceFolders?.[0]?.uri.fsPath ?? ".";
      await execute("monitor", ["--", settings().address], folder);
    }),
  );
}
