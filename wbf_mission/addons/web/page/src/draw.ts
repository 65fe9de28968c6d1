// Drawing on the map's canvases.
import { toPixels, type View } from "./canvas.js";
import { RING, SICK, cropColours, css, levels, pixel, ramp, themed } from "./colours.js";
import { element } from "./dom.js";
import { upTo, type Model, type Moment } from "./model.js";
import type { Decision, FarmShape, FieldInfo, Plan, Ring, States } from "./schema.js";
import type { Picture } from "./tiles.js";

type Context = CanvasRenderingContext2D;

/** Minimum distance between the drawn points of a line (pixels). */
const SEEN_PX = 1.2;
const RECENT_S = 30;
const LEVELS = 64;
/** Size from which squares are drawn one by one, with a border. */
const LARGE_PX = 6;
const SMALLEST_PX = 1.4;

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
  const pen = element("canvas", { width: 8, height: 8 }).getContext("2d")!;
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
  return context.createPattern(pen.canvas, "repeat") ?? colour;
}

export function drawFarm(context: Context, view: View, farm: FarmShape): void {
  const colours = cropColours(farm.patches.map(({ crop }) => crop));
  const strength = Number(themed("crop-strength"));
  for (const { own, crop, rings } of farm.patches.toSorted((a, b) => Number(a.own) - Number(b.own))) {
    trace(context, view, rings, true);
    context.globalAlpha = own ? strength : 0.45 * strength;
    context.fillStyle = colours.get(crop)!;
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

export function drawSplit(context: Context, view: View, split: number, names: [string, string]): void {
  const left = split * view.width;
  context.beginPath();
  context.moveTo(left, 0);
  context.lineTo(left, view.height);
  stroke(context, themed("halo"), 5);
  stroke(context, themed("ink"), 1.5);
  context.font = `600 11px ${themed("font")}`;
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

/** Draw a vehicle's track: the recent part until `now`, or without it the older part. */
export function drawTrail(
  context: Context,
  view: View,
  { time_s: times, x, y, flight }: States,
  time_s: number,
  colour: string,
  now: Moment | null,
): void {
  const [old, count] = [upTo(times, oldUntil(time_s)), upTo(times, time_s)];
  const to = now ? count : Math.min(old + 1, count);
  let [lastX, lastY] = [-Infinity, -Infinity];
  context.beginPath();
  for (let k = now ? old : 0; k < to; k++) {
    if (flight[k] !== flight[count - 1]) continue;
    const [left, top] = toPixels(view, x[k]!, y[k]!);
    if (Math.abs(left - lastX) + Math.abs(top - lastY) < SEEN_PX && k < to - 1) continue;
    context.lineTo(left, top); // The first one of a path only moves there
    [lastX, lastY] = [left, top];
  }
  if (!now) return stroke(context, colour, 1.2, 0.5);
  context.lineTo(...toPixels(view, now.x, now.y));
  stroke(context, themed("halo"), 5, 0.8);
  stroke(context, colour, 2.6);
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

/** Visible part of the frame, in metres. */
function seen({ matrix, width, height }: View): DOMRect {
  const inverse = new DOMMatrix(matrix).inverse();
  const corners = [{}, { x: width }, { y: height }, { x: width, y: height }].map((at) => inverse.transformPoint(at));
  return new DOMQuad(...corners).getBounds();
}

/** Draw camera readings of a field: a square per cell, and rings around sick plants. */
export function drawReadings(
  context: Context,
  view: View,
  model: Model,
  field: FieldInfo,
  time_s: number,
  cell_m: number,
): void {
  const { x, y, time_s: times } = model.readings;
  const values = model.readings.values[field.name];
  if (!values) return;
  const count = upTo(times, time_s);
  // Squares of visible size, so that the work depends on the screen and not on the number of readings.
  const step = Math.max(cell_m, SMALLEST_PX / view.scale);
  const { left, top, right, bottom } = seen(view);
  const [first, low] = [Math.floor(left / step), Math.floor(top / step)];
  const [columns, rows] = [Math.ceil(right / step) - first, Math.ceil(bottom / step) - low];
  const shown = new Uint8Array(columns * rows);
  const radius = Math.min(9, Math.max(2.5, 0.55 * step * view.scale));
  const across = Math.ceil(view.width / radius) + 1;
  const taken = new Uint8Array(across * (Math.ceil(view.height / radius) + 1));
  const rings: number[] = [];
  for (let k = 0; k < count; k++) {
    const value = values[k];
    if (value === null || value === undefined) continue;
    const i = Math.floor(x[k]! / step) - first;
    const j = Math.floor(y[k]! / step) - low;
    if (i < 0 || j < 0 || i >= columns || j >= rows) continue;
    shown[j * columns + i] = 1 + Math.round(value * (LEVELS - 1));
    if (field.kind !== "disease" || value >= SICK) continue;
    const [ringX, ringY] = toPixels(view, x[k]!, y[k]!);
    const place = Math.floor(ringY / radius) * across + Math.floor(ringX / radius);
    if (ringX < 0 || ringY < 0 || ringX > view.width || taken[place]) continue;
    taken[place] = 1;
    rings.push(ringX, ringY);
  }
  const table = levels(ramp(`value/${field.name}`, field), LEVELS);
  context.save();
  context.transform(...view.matrix);
  context.scale(step, step);
  context.translate(first, low);
  if (step * view.scale > LARGE_PX) drawSquares(context, shown, columns, table.map(css), step * view.scale);
  else {
    context.imageSmoothingEnabled = false;
    context.drawImage(dots(shown, columns, rows, table), 0, 0);
  }
  context.restore();
  drawRings(context, rings, radius);
}

function drawSquares(context: Context, shown: Uint8Array, columns: number, colours: string[], size: number): void {
  context.lineWidth = 0.8 / size;
  context.strokeStyle = themed("ink");
  shown.forEach((level, place) => {
    if (!level) return;
    const [left, low] = [(place % columns) + 0.19, Math.floor(place / columns) + 0.19];
    context.globalAlpha = 0.9;
    context.fillStyle = colours[level - 1]!;
    context.fillRect(left, low, 0.62, 0.62);
    context.globalAlpha = 0.35;
    context.strokeRect(left, low, 0.62, 0.62);
  });
}

/** Draw the squares as an image of one pixel each. */
function dots(shown: Uint8Array, columns: number, rows: number, table: [number, number, number][]): HTMLCanvasElement {
  const image = new ImageData(columns, rows);
  const colours = [0, ...table.map((colour) => pixel(colour, 230))];
  new Uint32Array(image.data.buffer).set(Array.from(shown, (level) => colours[level]!));
  const sheet = element("canvas", { width: columns, height: rows });
  sheet.getContext("2d")!.putImageData(image, 0, 0);
  return sheet;
}

function drawRings(context: Context, places: number[], radius: number): void {
  const [half, density] = [Math.ceil(radius + 3), 2];
  const size = 2 * half;
  const pen = element("canvas", { width: size * density, height: size * density }).getContext("2d")!;
  pen.scale(density, density);
  pen.arc(half, half, radius, 0, 2 * Math.PI);
  stroke(pen, "#ffffff", 4);
  stroke(pen, RING, 2);
  for (let k = 0; k + 1 < places.length; k += 2)
    context.drawImage(pen.canvas, places[k]! - half, places[k + 1]! - half, size, size);
}
