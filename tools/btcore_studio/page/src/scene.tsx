// The world of the running tree from above: bodies, path, goals, the laser and named places.

import { useMemo } from "preact/hooks";
import type { Scene } from "./protocol";
import { live } from "./state";
import { sceneTexts } from "./texts";

const MARGIN_M = 0.3;
/** Robot poses that have a direction. */
const ARROWS = new Set(["goal", "estimate"]);

/** Return the pairs in a list of coordinates. The y axis of a picture points down. */
const points = (flat: readonly number[], width = 2): [x: number, y: number, yaw: number][] =>
  Array.from({ length: Math.floor(flat.length / width) }, (_, index) => [flat[index * width]!, -flat[index * width + 1]!, width > 2 ? -flat[index * width + 2]! : 0]);
const text = (flat: readonly number[], width = 2) => points(flat, width).map(([x, y]) => `${x},${y}`).join(" ");

/** Return the left, upper, right and lower end of the bodies. */
export function extent(bodies: Scene["bodies"]): [number, number, number, number] {
  const box: [number, number, number, number] = [Infinity, Infinity, -Infinity, -Infinity];
  for (const [, corners] of bodies) {
    for (const [x, y] of points(corners)) {
      box[0] = Math.min(box[0], x); box[1] = Math.min(box[1], y);
      box[2] = Math.max(box[2], x); box[3] = Math.max(box[3], y);
    }
  }
  return box;
}

const Body = ({ color: [red, green, blue, opacity], corners }: { color: Scene["bodies"][number][0]; corners: string }) => (
  <polygon points={corners} fill={`rgb(${red} ${green} ${blue} / ${opacity / 255})`} />
);

/** The scene, if the robot sends one. */
export function SceneView() {
  const state = live.value;
  const scene = state?.address ? state.scene : null;
  const [left, top, right, bottom] = useMemo(() => extent(scene?.bodies ?? []), [scene?.bodies.length]);
  if (!scene || !Number.isFinite(left)) return null;
  const size = Math.max(right - left, bottom - top);
  const unit = size / 100;
  return (
    <section class="scene">
      <h2>{sceneTexts.title}</h2>
      <svg role="img" aria-label={sceneTexts.label} viewBox={[left - MARGIN_M, top - MARGIN_M, right - left + 2 * MARGIN_M, bottom - top + 2 * MARGIN_M].join(" ")}>
        {scene.bodies.map(([color, corners], index) => <Body key={index} color={color} corners={text(corners)} />)}
        {points(scene.scan).map(([x, y], index) => <circle key={index} class="echo" cx={x} cy={y} r={0.35 * unit} />)}
        {scene.poses.map(([kind, poses], index) => kind === "path"
          ? <polyline key={index} class="path" points={text(poses, 3)} stroke-width={0.6 * unit} />
          : ARROWS.has(kind) && points(poses, 3).map(([x, y, yaw], number) => (
            <path key={`${index} ${number}`} class={kind} d="M2,0L-1.4,1.3L-.7,0L-1.4,-1.3z" transform={`translate(${x} ${y}) rotate(${(yaw * 180) / Math.PI}) scale(${unit})`} />
          )))}
        {scene.places.map(([name, x, y]) => (
          <g key={name} class="place" transform={`translate(${x} ${-y})`}>
            <circle r={0.7 * unit} />
            <text x={1.2 * unit} y={unit} font-size={3 * unit} stroke-width={0.8 * unit}>{name}</text>
          </g>
        ))}
      </svg>
    </section>
  );
}
