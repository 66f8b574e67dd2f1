import * as vscode from "vscode";
import { registerCommands } from "./commands";
import { associate, Server } from "./language";
import { Previews } from "./preview";

const server = new Server();

/** Start the language server, and register the commands. VS Code calls it for the first XML document. */
export async function activate(context: vscode.ExtensionContext): Promise<void> {
  const previews = new Previews();
  registerCommands(context);
  context.subscriptions.push(
    previews,
    vscode.commands.registerCommand("btcore.show", async (uri?: unknown, tree?: unknown) => {
      await previews.show(uri, tree);
    }),
    vscode.commands.registerCommand("btcore.watch", () => previews.watch()),
    vscode.commands.registerCommand("btcore.restart", () => server.start()),
    vscode.workspace.onDidChangeConfiguration((event) => {
      if (event.affectsConfiguration("btcore.command")) void server.start();
      else if (event.affectsConfiguration("btcore")) void server.configure();
    }),
    vscode.workspace.onDidGrantWorkspaceTrust(() => server.configure()),
  );
  associate(context);
  await server.start();
}

/** Stop the language server. */
export async function deactivate(): Promise<void> {
  await server.stop();
}
