import { useEffect, useRef } from "preact/hooks";
import { store, stored } from "./storage";

const STEP_PX = 20;
const STORED = "btcore-studio-size-";

interface SplitterProps {
  /** The size's CSS variable, without "--". */
  name: string;
  label: string;
  /** "x" for a width, "y" for a height. */
  axis: "x" | "y";
  /** 1 if the pane grows to the right or down, otherwise -1. */
  direction: 1 | -1;
  initial: number;
  min: number;
}

/** A border that can be moved, by the pointer and by arrows. */
export function Splitter({ name, label, axis, direction, initial, min }: SplitterProps) {
  const size = useRef(Number(stored(STORED + name)) || initial);
  const border = useRef<HTMLDivElement>(null);
  const set = (value: number) => {
    const max = (axis === "x" ? innerWidth : innerHeight) * 0.7;
    size.current = Math.round(Math.max(min, Math.min(max, value)));
    document.documentElement.style.setProperty(`--${name}`, `${size.current}px`);
    border.current?.setAttribute("aria-valuenow", String(size.current));
    border.current?.setAttribute("aria-valuemax", String(Math.round(max)));
  };
  useEffect(() => set(size.current), []);
  const keep = () => store(STORED + name, String(size.current));
  const onKeyDown = (event: KeyboardEvent) => {
    const steps = { ArrowLeft: -1, ArrowUp: -1, ArrowRight: 1, ArrowDown: 1 }[event.key];
    if (!steps) return;
    set(size.current + steps * direction * STEP_PX);
    keep();
    event.preventDefault();
  };
  const onPointerDown = (event: PointerEvent) => {
    const target = event.currentTarget as HTMLElement;
    const from = axis === "x" ? event.clientX : event.clientY, before = size.current;
    target.setPointerCapture(event.pointerId);
    target.onpointermove = (move) => set(before + direction * ((axis === "x" ? move.clientX : move.clientY) - from));
    target.onlostpointercapture = () => {
      target.onpointermove = target.onlostpointercapture = null;
      keep();
    };
    event.preventDefault();
  };
  return (
    <div class={`splitter ${axis}`} ref={border} role="separator" tabIndex={0} aria-label={label} aria-valuemin={min}
      aria-orientation={axis === "x" ? "vertical" : "horizontal"} onKeyDown={onKeyDown} onPointerDown={onPointerDown}
      onDblClick={() => { set(initial); keep(); }} />
  );
}
