import * as vscode from "vscode";

/** The settings of the extension, of the kinds that the language server and the commands need. */
export interface Settings {
  command: string;
  plugins: string[];
  models: string[];
  given: string[];
  trusted: boolean;
  runArguments: string[];
  address: string;
}

/** Return the present settings. Nothing is imported or run in a workspace that the user does not trust. */
export function settings(): Settings {
  const section = vscode.workspace.getConfiguration("btcore");
  const texts = (name: string): string[] => {
    const value: unknown = section.get(name);
    return Array.isArray(value) ? value.filter((item): item is string => typeof item === "string") : [];
  };
  const isTrusted = vscode.workspace.isTrusted;
  return {
    command: section.get<string>("command")?.trim() || "btcore",
    plugins: isTrusted ? texts("plugins") : [],
    models: texts("models"),
    given: texts("given"),
    trusted: isTrusted && section.get<boolean>("trusted") === true,
    runArguments: isTrusted ? texts("runArguments") : [],
    address: section.get<string>("address")?.trim() || "tcp://127.0.0.1:1667",
  };
}

/** Return the options that name the node libraries of the workspace, for every command that reads a tree. */
export function libraryOptions(): string[] {
  const { plugins, models, trusted } = settings();
  const options = models.flatMap((model) => ["--model", model]);
  return trusted ? [...plugins.flatMap((plugin) => ["--plugin", plugin]), ...options] : options;
}

/** Return the folder of a document's workspace, in which commands run: paths in the settings are relative to it. */
export function folderOf(uri: vscode.Uri): vscode.Uri {
  return vscode.workspace.getWorkspaceFolder(uri)?.uri ?? vscode.Uri.joinPath(uri, "..");
}
