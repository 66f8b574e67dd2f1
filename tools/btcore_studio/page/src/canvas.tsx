import { useEffect, useRef } from "preact/hooks";
import { drawing } from "./state";

/** The picture of the tree. */
export function Canvas() {
  const frame = useRef<HTMLElement>(null);
  useEffect(() => {
    const template = document.createElement("template");
    template.innerHTML = drawing.value?.svg ?? "";
    frame.current?.replaceChildren(template.content);
  }, [drawing.value]);
  return <section class="canvas" aria-label="Drawing of the tree" ref={frame} />;
}
