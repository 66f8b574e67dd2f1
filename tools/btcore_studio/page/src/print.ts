// The picture as a PDF: the browser prints it on one page of its size, and its printer "Save as PDF" keeps the vectors.

import type { Drawing } from "./protocol";

/** The largest page of a PDF is 200 inches wide and high; an inch has 96 pixels. */
const MAX_SIDE = 200 * 96;

/** Open the browser's dialog to print a drawing without its own style sheet, in light colours. */
export function printDrawing({ svg, tree }: Drawing): void {
  const template = document.createElement("template");
  template.innerHTML = svg; // the server has escaped every text of the drawing
  const picture = template.content.querySelector("svg");
  if (!picture) return;
  picture.querySelector("style")?.remove();
  picture.classList.add("picture");
  const paper = document.createElement("div");
  paper.className = "paper";
  paper.append(picture);
  const { width, height } = picture.viewBox.baseVal;
  const scale = Math.min(1, MAX_SIDE / Math.max(width, height));
  picture.setAttribute("width", String(width * scale));
  picture.setAttribute("height", String(height * scale));
  const page = new CSSStyleSheet();
  page.replaceSync(`@page { size: ${Math.ceil(width * scale)}px ${Math.ceil(height * scale)}px; margin: 0; }`);
  document.adoptedStyleSheets.push(page);
  document.body.append(paper);
  const title = document.title;
  document.title = tree; // the name of the file that the dialog proposes
  addEventListener("afterprint", () => {
    paper.remove();
    document.adoptedStyleSheets = document.adoptedStyleSheets.filter((sheet) => sheet !== page);
    document.title = title;
  }, { once: true });
  print();
}
