// Sketch of a farm: shapes in degrees, read from and written to a GeoJSON farm file (docs/farm-files.md).

/** Longitude and latitude (degrees). */
export type Position = [number, number];

export type Kind = "field" | "obstacle" | "no-fly";

/** A polygon; its rings are open: the first position is not repeated. */
export interface Shape {
  name: string;
  kind: Kind;
  /** Crop of a field; ponds and wetlands are crops, too. */
  crop: string;
  owner: string;
  height_m: number | null;
  margin_m: number | null;
  /** Outline, then holes. */
  rings: Position[][];
}

/** Immutable: an edit returns a new sketch. */
export interface Sketch {
  /** Name of a farm known to the program; null after an edit. */
  known: string | null;
  name: string;
  owner: string;
  home: Position | null;
  rally: Position[];
  shapes: Shape[];
  /** Other members of the file, unchanged. */
  members: Record<string, unknown>;
}

/** Members that place the grid of cells, valid only for the original outlines. */
const OF_GRID = ["origin", "size_cells"];
/** Maximum number of corners checked here; the program checks longer borders. */
const MOST_CHECKED = 1000;

/** Farm file as `wbf-mission farm save` writes it. */
export interface FarmFile {
  type: "FeatureCollection";
  name: string;
  owner: string;
  home?: Position | undefined;
  rally?: Position[] | undefined;
  features: Feature[];
  [further: string]: unknown;
}

interface Feature {
  type: "Feature";
  properties: {
    name: string;
    crop?: string;
    owner?: string;
    obstacle?: boolean;
    height_m?: number | undefined;
    margin_m?: number | undefined;
  };
  geometry: { type: "Polygon"; coordinates: Position[][] };
}

export function sketchOf(file: FarmFile, known: string | null): Sketch {
  const { type: _, name, owner, home = null, rally = [], features, ...members } = file;
  const shapes = features.map(({ properties, geometry }): Shape => {
    const { name, crop = "", owner = "", obstacle, height_m = null, margin_m = null } = properties;
    const kind = !obstacle ? "field" : height_m === null ? "no-fly" : "obstacle";
    const rings = geometry.coordinates.map((ring) => ring.slice(0, -1).map(([lon, lat]): Position => [lon, lat]));
    return { name, kind, crop, owner, height_m, margin_m, rings };
  });
  return { known, name, owner, home, rally, shapes, members };
}

export function fileOf({ name, owner, home, rally, shapes, members }: Sketch): FarmFile {
  const features = shapes.map(({ name, kind, crop, owner, height_m, margin_m, rings }): Feature => ({
    type: "Feature",
    properties: {
      name,
      ...(kind === "field" ? { crop, owner } : { obstacle: true }),
      height_m: kind === "obstacle" ? (height_m ?? 0) : undefined,
      margin_m: margin_m ?? undefined,
    },
    geometry: { type: "Polygon", coordinates: rings.map((ring) => [...ring, ring[0]!]) },
  }));
  const places = { home: home ?? undefined, rally: rally.length ? rally : undefined };
  return { type: "FeatureCollection", name, owner, ...members, ...places, features };
}

export function emptySketch(name: string): Sketch {
  return { known: null, name, owner: "owner", home: null, rally: [], shapes: [], members: {} };
}

/** Apply a change: the farm is no longer a known one, and new outlines drop its grid. */
export function changed(sketch: Sketch, change: Partial<Sketch>): Sketch {
  const members = { ...sketch.members };
  if (change.shapes) for (const name of OF_GRID) delete members[name];
  return { ...sketch, members, ...change, known: null };
}

export function withShape(sketch: Sketch, number: number, change: Partial<Shape>): Sketch {
  return changed(sketch, { shapes: sketch.shapes.with(number, { ...sketch.shapes[number]!, ...change }) });
}

export function withRing(sketch: Sketch, number: number, ring: number, positions: Position[]): Sketch {
  return withShape(sketch, number, { rings: sketch.shapes[number]!.rings.with(ring, positions) });
}

/** Position of a new corner between a corner and the next one. */
export function middleOf(ring: Position[], corner: number): Position {
  const [[ax, ay], [bx, by]] = [ring[corner]!, ring[(corner + 1) % ring.length]!];
  return [(ax + bx) / 2, (ay + by) / 2];
}

/** Remove a corner; a ring of two is removed: a hole alone, an outline with its whole shape. */
export function withoutCorner(sketch: Sketch, number: number, ring: number, corner: number): Sketch {
  const shape = sketch.shapes[number]!;
  const positions = shape.rings[ring]!.toSpliced(corner, 1);
  if (positions.length >= 3) return withRing(sketch, number, ring, positions);
  if (ring > 0) return withShape(sketch, number, { rings: shape.rings.toSpliced(ring, 1) });
  return changed(sketch, { shapes: sketch.shapes.toSpliced(number, 1) });
}

export function cropsOf(sketch: Sketch): string[] {
  return [...new Set(sketch.shapes.filter(({ kind }) => kind === "field").map(({ crop }) => crop))];
}

export function freeName(sketch: Sketch, what: string): string {
  const taken = new Set(sketch.shapes.map((shape) => shape.name));
  for (let number = 1; ; number++) if (!taken.has(`${what} ${number}`)) return `${what} ${number}`;
}

function isInside([x, y]: Position, ring: Position[]): boolean {
  let inside = false;
  for (let k = 0, before = ring.length - 1; k < ring.length; before = k++) {
    const [[ax, ay], [bx, by]] = [ring[k]!, ring[before]!];
    if (ay > y !== by > y && x < ((bx - ax) * (y - ay)) / (by - ay) + ax) inside = !inside;
  }
  return inside;
}

/** Number of the topmost field with a position on its land, or -1. */
export function fieldAt(sketch: Sketch, place: Position): number {
  return sketch.shapes.findLastIndex(({ kind, rings }) => {
    const [isOn, ...isInHole] = rings.map((ring) => isInside(place, ring));
    return kind === "field" && isOn && !isInHole.includes(true);
  });
}

/** Points where sides that are no neighbours cross or touch, and spikes; the last side closes a ring. */
export function crossings(line: Position[], isClosed: boolean): Position[] {
  const count = isClosed ? line.length : line.length - 1;
  if (line.length > MOST_CHECKED) return [];
  const found: (Position | null)[] = [];
  const end = (k: number): Position => line[(k + 1) % line.length]!;
  for (let i = 0; i < count; i++)
    for (let j = i + 1; j < count; j++)
      if (j === i + 1) found.push(spike(end(i), line[i]!, end(j)));
      else if (isClosed && i === 0 && j === count - 1) found.push(spike(line[0]!, end(0), line[j]!));
      else found.push(meeting(line[i]!, end(i), line[j]!, end(j)));
  return found.filter((place) => place !== null);
}

const turn = (a: Position, b: Position, c: Position): number => Math.sign((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]));
const within = (a: Position, b: Position, c: Position): boolean =>
  Math.min(a[0], b[0]) <= c[0] && c[0] <= Math.max(a[0], b[0]) && Math.min(a[1], b[1]) <= c[1] && c[1] <= Math.max(a[1], b[1]);

/** Corner from which two sides go the same way, or null. */
function spike(a: Position, b: Position, c: Position): Position | null {
  const along = (b[0] - a[0]) * (c[0] - a[0]) + (b[1] - a[1]) * (c[1] - a[1]);
  return turn(a, b, c) === 0 && along > 0 ? a : null;
}

/** Point where two sides meet, or null. */
function meeting(a: Position, b: Position, c: Position, d: Position): Position | null {
  const [c1, d1, a1, b1] = [turn(a, b, c), turn(a, b, d), turn(c, d, a), turn(c, d, b)];
  if (c1 * d1 < 0 && a1 * b1 < 0) {
    const [ux, uy, vx, vy] = [b[0] - a[0], b[1] - a[1], d[0] - c[0], d[1] - c[1]];
    const part = ((c[0] - a[0]) * vy - (c[1] - a[1]) * vx) / (ux * vy - uy * vx);
    return [a[0] + part * ux, a[1] + part * uy];
  }
  if (c1 === 0 && within(a, b, c)) return c;
  if (d1 === 0 && within(a, b, d)) return d;
  if (a1 === 0 && within(c, d, a)) return a;
  return b1 === 0 && within(c, d, b) ? b : null;
}

/** Sketches for undo and redo. */
export class History {
  private readonly steps = [this.first];
  private at = 0;

  constructor(private readonly first: Sketch) {}

  get now(): Sketch {
    return this.steps[this.at]!;
  }

  push(sketch: Sketch): void {
    if (sketch !== this.now) this.steps.splice(++this.at, Infinity, sketch);
  }

  /** Whether there is a step before (-1) or after (1) the present one. */
  can(go: -1 | 1): boolean {
    return this.at + go in this.steps;
  }

  travel(go: -1 | 1): void {
    if (this.can(go)) this.at += go;
  }
}
