import * as vscode from "vscode";
import { registerCommands } from "./commands";
import { associate, Server } from "./language";
import { Studios } from "./studio";

const server = new Server();

/** Start the language server, and register the commands. VS Code calls it for the first XML document. */
export async function activate(context: vscode.ExtensionContext): Promise<void> {
  const studios = new Studios(server, context.extensionUri);
  registerCommands(context, () => studios.activeDocument);
  context.subscriptions.push(
    studios,
    vscode.commands.registerCommand("btcore.show", async (uri?: unknown, tree?: unknown) => {
      await studios.show(uri, tree);
    }),
    vscode.commands.registerCommand("btcore.watch", () => studios.watch()),
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
