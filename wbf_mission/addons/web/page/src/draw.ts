// Drawing on the map's canvases.
import { toPixels, type View } from "./canvas.js";
import { cropColour, themed } from "./colours.js";
import { upTo, type Moment } from "./model.js";
import type { Decision, FarmShape, Plan, Ring, States } from "./schema.js";
import type { Picture } from "./tiles.js";

type Context = CanvasRenderingContext2D;

/** Minimum distance between the drawn points of a line (pixels). */
const SEEN_PX = 1.2;
const RECENT_S = 30;

/** Make lines the current path; closed ones are shapes. */
function trace(context: Context, view: View, lines: Ring[], closed: boolean): void {
  context.beginPath();
  for (const line of lines) {
    for (let k = 0; k + 1 < line.length; k += 2) {
      const [x, y] = toPixels(view, line[k]!, line[k + 1]!);
      if (k) context.lineTo(x, y);
      else context.moveTo(x, y);
    }
    if (closed) context.closePath();
  }
}

/** Draw the current path as a line. */
function stroke(context: Context, colour: string, width: number, alpha = 1, dash: number[] = []): void {
  context.save();
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.lineJoin = "round";
  context.globalAlpha = alpha;
  context.setLineDash(dash);
  context.stroke();
  context.restore();
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
      trace(context, view, patch.rings, true);
      context.globalAlpha = own ? strength : 0.45 * strength;
      context.fillStyle = cropColour(patch.crop, crops);
      context.fill("evenodd");
    }
  context.globalAlpha = 1;
}

export function drawBorders(context: Context, view: View, farm: FarmShape): void {
  for (const patch of farm.patches.filter((one) => one.own)) {
    trace(context, view, patch.rings, true);
    stroke(context, themed("border-line"), 1, 1, [5, 4]);
  }
  const line = themed("obstacle");
  for (const obstacle of farm.obstacles) {
    trace(context, view, obstacle.rings, true);
    context.fillStyle = hatch(context, line, obstacle.height_m === null);
    context.fill("evenodd");
    stroke(context, line, 1.2);
    const ring = obstacle.rings[0] ?? [];
    const name = [obstacle.name, obstacle.height_m === null ? "" : `${obstacle.height_m} m`].filter(Boolean);
    const x = ring.filter((_, k) => k % 2 === 0);
    if ((Math.max(...x) - Math.min(...x)) * view.scale > 24) label(context, name.join(", "), ...middle(view, ring));
  }
  for (const place of farm.rally_m) mark(context, ...toPixels(view, ...place), "R");
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
  stroke(context, themed("halo"), 1.5);
  context.font = `700 10px ${themed("font")}`;
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillStyle = themed("halo");
  context.fillText(letter, x, y + 0.5);
}

/** Draw a layer's picture between two parts of the view's width. */
export function drawPicture(context: Context, view: View, picture: Picture, from: number, to: number): void {
  const { pixel_m } = picture.raster;
  context.save();
  context.beginPath();
  context.rect(from * view.width, 0, (to - from) * view.width, view.height);
  context.clip();
  context.transform(...view.matrix);
  context.scale(pixel_m, pixel_m);
  context.imageSmoothingEnabled = view.scale * pixel_m < 1;
  context.imageSmoothingQuality = "medium";
  context.drawImage(picture.canvas, 0, 0);
  context.restore();
}

/** Draw the line between estimate and truth. */
export function drawSplit(context: Context, view: View, split: number, names: [string, string]): void {
  const left = split * view.width;
  context.beginPath();
  context.moveTo(left, 0);
  context.lineTo(left, view.height);
  stroke(context, themed("halo"), 5);
  stroke(context, themed("ink"), 1.5);
  context.font = `600 12px ${themed("font")}`;
  const [before, after] = names.map((name) => context.measureText(name).width / 2 + 12);
  label(context, names[0], left - before!, view.height / 2 - 34);
  label(context, names[1], left + after!, view.height / 2 - 34);
}

export function drawPlan(context: Context, view: View, plan: Plan, colour: string, fence: boolean): void {
  if (fence)
    for (const { rings, inclusion } of plan.fence) {
      trace(context, view, rings, true);
      stroke(context, themed(inclusion ? "fence" : "danger"), 1.8, 1, [10, 5]);
    }
  trace(context, view, [plan.path], false);
  stroke(context, themed("halo"), 2.4, 0.4);
  stroke(context, colour, 0.9, 0.55);
}

/** Time until which a trail is thin; it changes in steps, because long trails are slow to draw. */
export function oldUntil(time_s: number): number {
  return (Math.floor(time_s / RECENT_S) - 1) * RECENT_S;
}

/** Draw the older part of a vehicle's track. */
export function drawOldTrail(context: Context, view: View, states: States, time_s: number, colour: string): void {
  const count = upTo(states.time_s, time_s);
  trail(context, view, states, 0, Math.min(upTo(states.time_s, oldUntil(time_s)) + 1, count), count);
  stroke(context, colour, 1.2, 0.5);
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
  stroke(context, themed("halo"), 5, 0.8);
  stroke(context, colour, 2.6);
}

function trail(context: Context, view: View, { x, y, flight }: States, from: number, to: number, count: number): void {
  let [lastX, lastY] = [-Infinity, -Infinity];
  context.beginPath();
  for (let k = from; k < to; k++) {
    if (flight[k] !== flight[count - 1]) continue;
    const [left, top] = toPixels(view, x[k]!, y[k]!);
    if (Math.abs(left - lastX) + Math.abs(top - lastY) < SEEN_PX && k < to - 1) continue;
    context.lineTo(left, top); // The first one of a path only moves there
    [lastX, lastY] = [left, top];
  }
}

/** Draw the paths considered by a policy, better ones stronger, and the chosen ones solid. */
export function drawDecision(context: Context, view: View, decision: Decision, colour: (id: number) => string): void {
  const values = decision.candidates.map((one) => one.value);
  const [low, high] = [Math.min(...values), Math.max(...values)];
  for (const { path, value, system_id } of decision.candidates) {
    const alpha = 0.25 + 0.5 * (high > low ? (value - low) / (high - low) : 1);
    trace(context, view, [path], false);
    stroke(context, colour(system_id), 1.6, alpha, [3, 4]);
    // Some candidates have only an end point.
    const [x, y] = path.slice(-2);
    if (x === undefined || y === undefined) continue;
    context.beginPath();
    context.arc(...toPixels(view, x, y), 4, 0, 2 * Math.PI);
    stroke(context, colour(system_id), 1.6, alpha);
  }
  for (const { path, system_id } of decision.changes) {
    trace(context, view, [path], false);
    stroke(context, themed("halo"), 4.5);
    stroke(context, colour(system_id), 2);
  }
}
