import { lstat, realpath, stat } from "node:fs/promises";
import * as path from "node:path";
import * as vscode from "vscode";

const CREATABLE = /\.(xml|btproj)$|_node\.py$/i;
const CONTROL = /[\p{Cc}\p{Cs}\u2028\u2029]/u;
const MAX_NAME = 500;
const MAX_TEXT = 8 << 20;

/**
 * Create a file of trees, or the Python file of a node, as `btcore studio` does. Return its URI.
 *
 * @param folder The folder in which the file may be, also deeper.
 * @param name The path, relative to the folder.
 */
export async function createFile(folder: vscode.Uri, name: string, text: string): Promise<string> {
  if (!name || name.length > MAX_NAME) throw new Error(`a path is refused: its length must be 1 to ${MAX_NAME} characters`);
  const parts = name.split(/[/\\]/);
  const refusal =
    CONTROL.test(name) ? "it contains control characters"
    : /^([/\\~]|[A-Za-z]:)/.test(name) || parts.includes("..") ? "give a path relative to the folder, without '..'"
    : parts.some((part) => part.startsWith(".")) ? "it is hidden"
    : !CREATABLE.test(name) ? "the name must end with .xml, .btproj or _node.py"
    : "";
  if (refusal) throw new Error(`${JSON.stringify(name)} is refused: ${refusal}`);
  const contents = Buffer.from(text);
  if (contents.length > MAX_TEXT) throw new Error(`the file would be too large: at most ${MAX_TEXT} bytes are permitted`);
  const uri = vscode.Uri.joinPath(folder, name);
  const parent = path.dirname(uri.fsPath);
  const root = await realpath(folder.fsPath);
  const real = await realpath(parent).catch(() => "");
  if (real && real !== root && !real.startsWith(root.endsWith(path.sep) ? root : root + path.sep)) {
    throw new Error(`'${name}' is refused: it leads out of the folder`);
  }
  if (!real || !(await stat(real)).isDirectory()) throw new Error(`'${name}' can't be created: there is no folder '${path.posix.dirname(name)}'`);
  // Also a link that leads nowhere.
  if (await lstat(uri.fsPath).then(() => true, () => false)) throw new Error(`'${name}' can't be created: it exists`);
  const edit = new vscode.WorkspaceEdit();
  edit.createFile(uri, { contents });
  if (!(await vscode.workspace.applyEdit(edit))) throw new Error(`VS Code did not create '${name}'.`);
  return uri.toString();
}
