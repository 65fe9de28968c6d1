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
  /** Height of an obstacle. */
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
const OWNER = "owner";
/** Maximum number of corners checked here; the program checks longer borders. */
const MOST_CHECKED = 1000;

type Json = Record<string, unknown>;

export function sketchOf(document: Json, known: string | null): Sketch {
  const { type: _, name, owner, home, rally, features, ...members } = document;
  const shapes = (features as { properties: Json; geometry: { coordinates: Position[][] } }[]).map((feature): Shape => {
    const { properties, geometry } = feature;
    const height_m = (properties["height_m"] as number | undefined) ?? null;
    return {
      name: String(properties["name"] ?? ""),
      kind: properties["obstacle"] !== true ? "field" : height_m === null ? "no-fly" : "obstacle",
      crop: String(properties["crop"] ?? ""),
      owner: String(properties["owner"] ?? ""),
      height_m,
      margin_m: (properties["margin_m"] as number | undefined) ?? null,
      rings: geometry.coordinates.map((ring) => ring.slice(0, -1).map(([lon, lat]) => [lon, lat] as Position)),
    };
  });
  return {
    known, shapes, members,
    name: String(name), owner: String(owner),
    home: (home as Position | undefined) ?? null,
    rally: (rally as Position[] | undefined) ?? [],
  };
}

/** Farm file of a sketch, as written by `wbf-mission farm save`. */
export function documentOf(sketch: Sketch): Json {
  const { name, owner, home, rally, shapes, members } = sketch;
  const features = shapes.map((shape) => ({
    type: "Feature",
    properties: {
      name: shape.name,
      ...(shape.kind === "field" ? { crop: shape.crop, owner: shape.owner } : { obstacle: true }),
      ...(shape.kind === "obstacle" ? { height_m: shape.height_m ?? 0 } : {}),
      ...(shape.margin_m === null ? {} : { margin_m: shape.margin_m }),
    },
    geometry: { type: "Polygon", coordinates: shape.rings.map((ring) => [...ring, ring[0]!]) },
  }));
  return {
    type: "FeatureCollection", name, owner, ...members,
    ...(home ? { home } : {}), ...(rally.length ? { rally } : {}), features,
  };
}

export function emptySketch(name: string): Sketch {
  return { known: null, name, owner: OWNER, home: null, rally: [], shapes: [], members: {} };
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
  return withoutShape(sketch, number);
}

export function cropsOf(sketch: Sketch): string[] {
  return [...new Set(sketch.shapes.filter(({ kind }) => kind === "field").map(({ crop }) => crop))];
}

export function withoutShape(sketch: Sketch, number: number): Sketch {
  return changed(sketch, { shapes: sketch.shapes.toSpliced(number, 1) });
}

/** First unused name. */
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
  const found: Position[] = [];
  const end = (k: number): Position => line[(k + 1) % line.length]!;
  for (let i = 0; i < count; i++)
    for (let j = i + 1; j < count; j++) {
      const before = j === i + 1;
      const around = isClosed && i === 0 && j === count - 1;
      if (before || around) {
        const [corner, one, other] = before ? [end(i), line[i]!, end(j)] : [line[0]!, end(0), line[j]!];
        if (turn(corner, one, other) === 0 && along(corner, one, other) > 0) found.push(corner);
        continue;
      }
      const place = meeting(line[i]!, end(i), line[j]!, end(j));
      if (place) found.push(place);
    }
  return found;
}

const turn = (a: Position, b: Position, c: Position): number => Math.sign((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]));
const along = (a: Position, b: Position, c: Position): number => (b[0] - a[0]) * (c[0] - a[0]) + (b[1] - a[1]) * (c[1] - a[1]);
const within = (a: Position, b: Position, c: Position): boolean =>
  Math.min(a[0], b[0]) <= c[0] && c[0] <= Math.max(a[0], b[0]) && Math.min(a[1], b[1]) <= c[1] && c[1] <= Math.max(a[1], b[1]);

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
  private steps: Sketch[];
  private at = 0;

  constructor(first: Sketch) {
    this.steps = [first];
  }

  get now(): Sketch {
    return this.steps[this.at]!;
  }

  /** Drop all undo and redo steps. */
  forget(): void {
    [this.steps, this.at] = [[this.now], 0];
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
