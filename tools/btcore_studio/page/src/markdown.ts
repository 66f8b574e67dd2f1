// The server's descriptions. Their Markdown has bold words, code, links, and tables of ports.

const INLINE = /(\*\*.+?\*\*|`` .+? ``|`[^`]+`|\[[^\]]+\]\(https:\/\/[^\s)]+\))/;
const unescape = (text: string) => text.replace(/\\([<>[\]!|*_`])/g, "$1");

function inline(parent: HTMLElement, text: string): void {
  for (const piece of text.split(INLINE)) {
    const link = /^\[(.+)\]\((.+)\)$/.exec(piece);
    if (link) {
      const element = document.createElement("a");
      Object.assign(element, { href: link[2], target: "_blank", rel: "noreferrer", textContent: link[1] });
      parent.append(element);
    } else if (/^`/.test(piece)) {
      const element = document.createElement("code");
      element.textContent = piece.replace(/^`+ ?| ?`+$/g, "");
      parent.append(element);
    } else if (/^\*\*/.test(piece)) {
      const element = document.createElement("b");
      element.textContent = unescape(piece.slice(2, -2));
      parent.append(element);
    } else parent.append(unescape(piece));
  }
}

/** Return a description as elements. */
export function rendered(markdown: string): HTMLElement {
  const result = document.createElement("div");
  result.className = "about";
  for (const block of markdown.split(/\n{2,}/)) {
    if (block.startsWith("|")) {
      const table = document.createElement("table");
      for (const line of block.split("\n").slice(2)) {
        const row = table.insertRow();
        for (const cell of line.replace(/^\||\|$/g, "").split(/(?<!\\)\|/)) inline(row.insertCell(), cell.trim());
      }
      result.append(table);
    } else {
      const paragraph = document.createElement("p");
      inline(paragraph, block.replace(/\n/g, " "));
      result.append(paragraph);
    }
  }
  return result;
}
