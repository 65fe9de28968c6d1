// Camera readings of a field: a square per cell, and rings around sick plants.
import { toPixels, type View } from "./canvas.js";
import { RING, SICK, colourAt, css, ramp, themed } from "./colours.js";
import { upTo, type Model } from "./model.js";
import type { FieldInfo } from "./schema.js";

type Context = CanvasRenderingContext2D;

const LEVELS = 64;
/** Size from which squares are drawn one by one, with a border. */
const LARGE_PX = 6;
const SMALLEST_PX = 1.4;

/** Visible part of the frame: minimum x and y, maximum x and y. */
function seen({ matrix, width, height }: View): [number, number, number, number] {
  const inverse = new DOMMatrix(matrix).inverse();
  const corners = [{}, { x: width }, { y: height }, { x: width, y: height }].map((at) => inverse.transformPoint(at));
  const [x, y] = [corners.map((corner) => corner.x), corners.map((corner) => corner.y)];
  return [Math.min(...x), Math.min(...y), Math.max(...x), Math.max(...y)];
}

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
  const [left, bottom, right, top] = seen(view);
  const [first, low] = [Math.floor(left / step), Math.floor(bottom / step)];
  const [columns, rows] = [Math.ceil(right / step) - first, Math.ceil(top / step) - low];
  const levels = new Uint8Array(columns * rows);
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
    levels[j * columns + i] = 1 + Math.round(value * (LEVELS - 1));
    if (field.kind !== "disease" || value >= SICK) continue;
    const [ringX, ringY] = toPixels(view, x[k]!, y[k]!);
    const place = Math.floor(ringY / radius) * across + Math.floor(ringX / radius);
    if (ringX < 0 || ringY < 0 || ringX > view.width || taken[place]) continue;
    taken[place] = 1;
    rings.push(ringX, ringY);
  }
  const colours = ramp(`value/${field.name}`, field);
  const table = Array.from({ length: LEVELS }, (_, level) => colourAt(colours, level / (LEVELS - 1)));
  context.save();
  context.transform(...view.matrix);
  context.scale(step, step);
  context.translate(first, low);
  if (step * view.scale > LARGE_PX) drawSquares(context, levels, columns, table.map(css), step * view.scale);
  else {
    context.imageSmoothingEnabled = false;
    context.drawImage(dots(levels, columns, rows, table), 0, 0);
  }
  context.restore();
  drawRings(context, rings, radius);
}

function drawSquares(context: Context, levels: Uint8Array, columns: number, colours: string[], size: number): void {
  context.lineWidth = 0.8 / size;
  context.strokeStyle = themed("ink");
  levels.forEach((level, place) => {
    if (!level) return;
    const [left, low] = [(place % columns) + 0.19, Math.floor(place / columns) + 0.19];
    context.globalAlpha = 0.9;
    context.fillStyle = colours[level - 1]!;
    context.fillRect(left, low, 0.62, 0.62);
    context.globalAlpha = 0.35;
    context.strokeRect(left, low, 0.62, 0.62);
  });
}

const sheet = document.createElement("canvas");

/** Draw the squares as an image of one pixel each. */
function dots(levels: Uint8Array, columns: number, rows: number, table: [number, number, number][]): HTMLCanvasElement {
  const image = new ImageData(columns, rows);
  const pixels = new Uint32Array(image.data.buffer);
  const colours = Uint32Array.from([
    0,
    ...table.map(([red, green, blue]) => (230 << 24) | (blue << 16) | (green << 8) | red),
  ]);
  for (let place = 0; place < levels.length; place++) pixels[place] = colours[levels[place]!]!;
  [sheet.width, sheet.height] = [columns, rows];
  sheet.getContext("2d")!.putImageData(image, 0, 0);
  return sheet;
}

function drawRings(context: Context, places: number[], radius: number): void {
  const [half, density] = [Math.ceil(radius + 3), 2];
  const ring = document.createElement("canvas");
  ring.width = ring.height = 2 * half * density;
  const pen = ring.getContext("2d")!;
  pen.scale(density, density);
  pen.arc(half, half, radius, 0, 2 * Math.PI);
  pen.strokeStyle = "#ffffff";
  pen.lineWidth = 4;
  pen.stroke();
  pen.strokeStyle = RING;
  pen.lineWidth = 2;
  pen.stroke();
  for (let k = 0; k + 1 < places.length; k += 2)
    context.drawImage(ring, places[k]! - half, places[k + 1]! - half, 2 * half, 2 * half);
}
