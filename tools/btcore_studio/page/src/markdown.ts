// The server's descriptions. Their Markdown has bold words, code, links, and tables of ports.

const INLINE = /(\*\*.+?\*\*|`` .+? ``|`[^`]+`|\[(?:\\.|[^\]\\])+\]\(<?(?:https|file):\/\/[^\s)>]+>?\))/;
const unescape = (text: string) => text.replace(/\\([<>[\]!|*_`-])/g, "$1");

type OpenPlace = (uri: string, line: number) => void;

function inline(parent: HTMLElement, text: string, open: OpenPlace): void {
  for (const piece of text.split(INLINE)) {
    const link = /^\[(.+)\]\(<?((https|file):[^>]+?)>?\)$/.exec(piece);
    const bold = /^\*\*(.+)\*\*$/.exec(piece);
    if (link) {
      const [, label = "", address = "", scheme] = link;
      const element = document.createElement("a");
      element.href = address;
      if (scheme === "file") {
        const [uri = "", line] = address.split("#L");
        element.onclick = (event) => {
          event.preventDefault();
          open(uri, Number(line ?? 1) - 1);
        };
      } else Object.assign(element, { target: "_blank", rel: "noreferrer" });
      inline(element, label, open);
      parent.append(element);
    } else if (bold) {
      const element = document.createElement("b");
      inline(element, bold[1] ?? "", open);
      parent.append(element);
    } else if (piece.startsWith("`")) {
      const element = document.createElement("code");
      element.textContent = piece.replace(/^`+ ?| ?`+$/g, "");
      parent.append(element);
    } else parent.append(unescape(piece));
  }
}

/** Return a docstring without the marks of its emphasized words. */
export const plain = (text: string): string => text.replace(/(?<![\w*])\*([^\s*](?:[^*`]*[^\s*])?)\*(?![\w*])/g, "$1");

/**
 * Return a description as elements.
 *
 * @param open Called when the user follows a link to a place in a file.
 */
export function rendered(markdown: string, open: OpenPlace): HTMLElement {
  const result = document.createElement("div");
  result.className = "about";
  for (const block of markdown.split(/\n{2,}/)) {
    if (block.startsWith("|")) {
      const table = document.createElement("table");
      for (const line of block.split("\n").slice(2)) {
        const row = table.insertRow();
        for (const cell of line.replace(/^\||\|$/g, "").split(/(?<!\\)\|/)) inline(row.insertCell(), cell.trim(), open);
      }
      result.append(table);
    } else if (block.startsWith("- ")) {
      const list = document.createElement("ul");
      for (const item of block.slice(2).split("\n- ")) {
        const element = document.createElement("li");
        inline(element, item.replace(/\n/g, " "), open);
        list.append(element);
      }
      result.append(list);
    } else {
      const paragraph = document.createElement("p");
      inline(paragraph, block.replace(/\n/g, " "), open);
      result.append(paragraph);
    }
  }
  return result;
}
