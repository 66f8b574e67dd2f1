import * as vscode from "vscode";
import type { Place, Position } from "./changes";

/** A node of a drawing, with its element. */
export interface DrawnNode {
  key: string;
  place: Place;
}

const START_TAG = /^<(?:[^"'>]|"[^"]*"|'[^']*')*>?/;
const MAX_TAG_LINES = 200;

const sourceBreakpoints = (): vscode.SourceBreakpoint[] =>
  vscode.debug.breakpoints.filter((item): item is vscode.SourceBreakpoint => item instanceof vscode.SourceBreakpoint);

export const hasBreakpoints = (): boolean => sourceBreakpoints().some(({ enabled }) => enabled);

/** Return the nodes with breakpoints in the margin, at the lines of their start tags. */
async function nodesWithBreakpoints(nodes: readonly DrawnNode[]): Promise<[DrawnNode, vscode.SourceBreakpoint[]][]> {
  const byUri = new Map<string, vscode.SourceBreakpoint[]>();
  for (const item of sourceBreakpoints()) {
    const uri = item.location.uri.toString();
    byUri.set(uri, [...(byUri.get(uri) ?? []), item]);
  }
  const found: [DrawnNode, vscode.SourceBreakpoint[]][] = [];
  for (const node of nodes) {
    const { uri, position } = node.place;
    const items = byUri.get(uri);
    if (!items) continue;
    const last = lastLine(await vscode.workspace.openTextDocument(vscode.Uri.parse(uri)), position);
    const own = items.filter(({ location: { range } }) => position.line <= range.start.line && range.start.line <= last);
    if (own.length) found.push([node, own]);
  }
  return found;
}

/** Return the last line of a start tag. */
function lastLine(document: vscode.TextDocument, { line, character }: Position): number {
  const text = document.getText(new vscode.Range(line, character, line + MAX_TAG_LINES, 0));
  const tag = START_TAG.exec(text)?.[0] ?? "";
  return line + (tag.match(/\r\n|\r|\n/g)?.length ?? 0);
}

/** Return the keys of the nodes with a breakpoint in the margin. */
export async function keysOfBreakpoints(nodes: readonly DrawnNode[]): Promise<string[]> {
  const found = await nodesWithBreakpoints(nodes);
  return found.flatMap(([{ key }, items]) => (items.some(({ enabled }) => enabled) ? [key] : []));
}

/** Remove the breakpoints of nodes from the margin. */
export async function removeBreakpoints(nodes: readonly DrawnNode[]): Promise<void> {
  const found = await nodesWithBreakpoints(nodes);
  vscode.debug.removeBreakpoints([...new Set(found.flatMap(([, items]) => items))]);
}

/** Set breakpoints in the margin, at the first lines of nodes. */
export function addBreakpoints(nodes: readonly DrawnNode[]): void {
  const places = new Map(nodes.map(({ place }) => [`${place.position.line} ${place.uri}`, place]));
  vscode.debug.addBreakpoints(
    [...places.values()].map(({ uri, position }) => {
      const start = new vscode.Position(position.line, 0);
      return new vscode.SourceBreakpoint(new vscode.Location(vscode.Uri.parse(uri), start));
    }),
  );
}
