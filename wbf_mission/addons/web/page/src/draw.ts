// Drawing on the map's canvases.
import { toPixels, type View } from "./canvas.js";
import { cropColour, themed } from "./colours.js";
import { upTo, type Model, type Moment } from "./model.js";
import type { FarmShape, Plan, Ring, States } from "./schema.js";
import type { Picture } from "./tiles.js";

type Context = CanvasRenderingContext2D;

/** Minimum distance between the drawn points of a line (pixels). */
const SEEN_PX = 1.2;
const RECENT_S = 30;

function trace(context: Context, view: View, ring: Ring, closed: boolean): void {
  for (let k = 0; k + 1 < ring.length; k += 2) {
    const [x, y] = toPixels(view, ring[k]!, ring[k + 1]!);
    if (k) context.lineTo(x, y);
    else context.moveTo(x, y);
  }
  if (closed) context.closePath();
}

function shape(context: Context, view: View, rings: Ring[]): void {
  context.beginPath();
  for (const ring of rings) trace(context, view, ring, true);
}

function hatch(context: Context, colour: string, crossed: boolean): CanvasPattern | string {
  const cell = document.createElement("canvas");
  cell.width = cell.height = 8;
  const pen = cell.getContext("2d")!;
  pen.strokeStyle = colour;
  pen.beginPath();
  for (const shift of [-8, 0, 8]) {
    pen.moveTo(shift, 8);
    pen.lineTo(shift + 8, 0);
    if (crossed) {
      pen.moveTo(shift, 0);
      pen.lineTo(shift + 8, 8);
    }
  }
  pen.stroke();
  return context.createPattern(cell, "repeat") ?? colour;
}

export function drawFarm(context: Context, view: View, farm: FarmShape): void {
  const crops = [...new Set(farm.patches.map((patch) => patch.crop))];
  const strength = Number(themed("crop-strength"));
  for (const own of [false, true])
    for (const patch of farm.patches.filter((one) => one.own === own)) {
      shape(context, view, patch.rings);
      context.globalAlpha = own ? strength : 0.45 * strength;
      context.fillStyle = cropColour(patch.crop, crops);
      context.fill("evenodd");
    }
  context.globalAlpha = 1;
}

export function drawBorders(context: Context, view: View, farm: FarmShape): void {
  context.lineWidth = 1;
  context.strokeStyle = themed("border-line");
  context.setLineDash([5, 4]);
  for (const patch of farm.patches.filter((one) => one.own)) {
    shape(context, view, patch.rings);
    context.stroke();
  }
  context.setLineDash([]);
  const line = themed("obstacle");
  for (const obstacle of farm.obstacles) {
    shape(context, view, obstacle.rings);
    context.fillStyle = hatch(context, line, obstacle.height_m === null);
    context.fill("evenodd");
    context.strokeStyle = line;
    context.lineWidth = 1.2;
    context.stroke();
    const ring = obstacle.rings[0] ?? [];
    const name = [obstacle.name, obstacle.height_m === null ? "" : `${obstacle.height_m} m`].filter(Boolean);
    const width = Math.max(...ring.filter((_, k) => k % 2 === 0)) - Math.min(...ring.filter((_, k) => k % 2 === 0));
    if (width * view.scale > 24) label(context, name.join(", "), ...middle(view, ring));
  }
  for (const [x, y] of farm.rally_m) {
    const [left, top] = toPixels(view, x, y);
    mark(context, left, top, "R");
  }
  mark(context, ...toPixels(view, ...farm.home_m), "H");
}

function middle(view: View, ring: Ring): [number, number] {
  let [x, y] = [0, 0];
  for (let k = 0; k + 1 < ring.length; k += 2) [x, y] = [x + ring[k]!, y + ring[k + 1]!];
  return toPixels(view, (2 * x) / ring.length, (2 * y) / ring.length);
}

function label(context: Context, text: string, x: number, y: number): void {
  context.font = `600 11px ${themed("font")}`;
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.lineWidth = 3;
  context.lineJoin = "round";
  context.strokeStyle = themed("halo");
  context.strokeText(text, x, y);
  context.fillStyle = themed("ink");
  context.fillText(text, x, y);
}

function mark(context: Context, x: number, y: number, letter: string): void {
  context.beginPath();
  context.arc(x, y, 8, 0, 2 * Math.PI);
  context.fillStyle = themed("ink");
  context.fill();
  context.strokeStyle = themed("halo");
  context.lineWidth = 1.5;
  context.stroke();
  context.font = `700 10px ${themed("font")}`;
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillStyle = themed("halo");
  context.fillText(letter, x, y + 0.5);
}

/** Draw a layer's picture; `from` and `to` limit it to one side of a comparison. */
export function drawPicture(context: Context, view: View, picture: Picture, pixel_m: number, from = 0, to = 1): void {
  const [a, b, c, d, e, f] = view.matrix;
  context.save();
  context.beginPath();
  context.rect(from * view.width, 0, (to - from) * view.width, view.height);
  context.clip();
  context.transform(a * pixel_m, b * pixel_m, c * pixel_m, d * pixel_m, e, f);
  context.imageSmoothingEnabled = view.scale * pixel_m < 1;
  context.imageSmoothingQuality = "medium";
  context.drawImage(picture.canvas, 0, 0);
  context.restore();
}

/** Draw the line between estimate and truth. */
export function drawSplit(context: Context, view: View, split: number, names: [string, string]): void {
  const left = split * view.width;
  for (const [colour, width] of [
    [themed("halo"), 5],
    [themed("ink"), 1.5],
  ] as const) {
    context.beginPath();
    context.moveTo(left, 0);
    context.lineTo(left, view.height);
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.stroke();
  }
  context.font = `600 12px ${themed("font")}`;
  const [before, after] = names.map((name) => context.measureText(name).width / 2 + 12);
  label(context, names[0], left - before!, view.height / 2 - 34);
  label(context, names[1], left + after!, view.height / 2 - 34);
}

export function drawPlan(context: Context, view: View, plan: Plan, colour: string, fence: boolean): void {
  context.lineJoin = "round";
  if (fence)
    for (const { rings, inclusion } of plan.fence) {
      shape(context, view, rings);
      context.strokeStyle = themed(inclusion ? "fence" : "danger");
      context.lineWidth = 1.8;
      context.setLineDash([10, 5]);
      context.stroke();
      context.setLineDash([]);
    }
  context.beginPath();
  trace(context, view, plan.path, false);
  context.strokeStyle = themed("halo");
  context.globalAlpha = 0.4;
  context.lineWidth = 2.4;
  context.stroke();
  context.strokeStyle = colour;
  context.globalAlpha = 0.55;
  context.lineWidth = 0.9;
  context.stroke();
  context.globalAlpha = 1;
}

/** Time until which a trail is thin; it changes in steps, because long trails are slow to draw. */
export function oldUntil(time_s: number): number {
  return (Math.floor(time_s / RECENT_S) - 1) * RECENT_S;
}

/** Draw the older part of a vehicle's track. */
export function drawOldTrail(context: Context, view: View, states: States, time_s: number, colour: string): void {
  const count = upTo(states.time_s, time_s);
  trail(context, view, states, 0, Math.min(upTo(states.time_s, oldUntil(time_s)) + 1, count), count);
  context.lineJoin = "round";
  context.strokeStyle = colour;
  context.globalAlpha = 0.5;
  context.lineWidth = 1.2;
  context.stroke();
  context.globalAlpha = 1;
}

/** Draw the recent part of a vehicle's track. */
export function drawTrail(
  context: Context,
  view: View,
  states: States,
  time_s: number,
  now: Moment,
  colour: string,
): void {
  const count = upTo(states.time_s, time_s);
  trail(context, view, states, upTo(states.time_s, oldUntil(time_s)), count, count);
  context.lineTo(...toPixels(view, now.x, now.y));
  context.lineJoin = "round";
  context.strokeStyle = themed("halo");
  context.lineWidth = 5;
  context.globalAlpha = 0.8;
  context.stroke();
  context.globalAlpha = 1;
  context.strokeStyle = colour;
  context.lineWidth = 2.6;
  context.stroke();
}

function trail(context: Context, view: View, { x, y, flight }: States, from: number, to: number, count: number): void {
  const [a, b, c, d, e, f] = view.matrix;
  const flown = flight[count - 1];
  let [lastX, lastY, begun] = [-Infinity, -Infinity, false];
  context.beginPath();
  for (let k = from; k < to; k++) {
    if (flight[k] !== flown) continue;
    const left = a * x[k]! + c * y[k]! + e;
    const top = b * x[k]! + d * y[k]! + f;
    if (Math.abs(left - lastX) + Math.abs(top - lastY) < SEEN_PX && k < to - 1) continue;
    if (begun) context.lineTo(left, top);
    else context.moveTo(left, top);
    lastX = left;
    lastY = top;
    begun = true;
  }
}

/** Draw the paths considered by a policy, better ones stronger, and the chosen ones solid. */
export function drawDecision(
  context: Context,
  view: View,
  decision: Model["decisions"][number],
  colour: (id: number) => string,
): void {
  const values = decision.candidates.map((one) => one.value);
  const [low, high] = [Math.min(...values), Math.max(...values)];
  context.lineJoin = "round";
  for (const { path, value, system_id } of decision.candidates) {
    context.beginPath();
    trace(context, view, path, false);
    context.globalAlpha = 0.25 + 0.5 * (high > low ? (value - low) / (high - low) : 1);
    context.setLineDash([3, 4]);
    context.lineWidth = 1.6;
    context.strokeStyle = colour(system_id);
    context.stroke();
    // Some candidates have only an end point.
    const [x, y] = path.slice(-2);
    if (x === undefined || y === undefined) continue;
    const [a, b, c, d, e, f] = view.matrix;
    context.beginPath();
    context.setLineDash([]);
    context.arc(a * x + c * y + e, b * x + d * y + f, 4, 0, 2 * Math.PI);
    context.stroke();
  }
  context.setLineDash([]);
  context.globalAlpha = 1;
  for (const { path, system_id } of decision.changes) {
    context.beginPath();
    trace(context, view, path, false);
    context.lineWidth = 4.5;
    context.strokeStyle = themed("halo");
    context.stroke();
    context.lineWidth = 2;
    context.strokeStyle = colour(system_id);
    context.stroke();
  }
}
