// A farm as it is drawn: shapes in degrees, from a GeoJSON farm file and back (docs/farm-files.md).

/** Longitude and latitude, degrees. */
export type Position = [number, number];

export type Kind = "field" | "obstacle" | "no-fly";

/** A polygon; its rings are open: the first position is not repeated. */
export interface Shape {
  name: string;
  kind: Kind;
  /** Of a field; ponds and wetlands are fields of theirs. */
  crop: string;
  owner: string;
  /** Of an obstacle. */
  height_m: number | null;
  margin_m: number | null;
  /** The outline, then holes. */
  rings: Position[][];
}

/** Never changed: an edit makes another one. */
export interface Sketch {
  /** The farm that it is as long as nothing was edited: one that the program knows by its name. */
  known: string | null;
  name: string;
  owner: string;
  home: Position | null;
  rally: Position[];
  shapes: Shape[];
  /** Further members of the file, as they are. */
  members: Record<string, unknown>;
}

/** Members that say where the grid of cells lies: they hold for the outlines that they came with. */
const OF_GRID = ["origin", "size_cells"];
const OWNER = "owner";

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

/** The farm file of a sketch, as `wbf-mission farm save` writes it. */
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

/** A farm without anything on it. */
export function emptySketch(name: string): Sketch {
  return { known: null, name, owner: OWNER, home: null, rally: [], shapes: [], members: {} };
}

/** A change: the sketch is no known farm any more, and where outlines change its grid lies elsewhere. */
export function changed(sketch: Sketch, change: Partial<Sketch>): Sketch {
  const members = { ...sketch.members };
  if (change.shapes) for (const name of OF_GRID) delete members[name];
  return { ...sketch, members, ...change, known: null };
}

export function withShape(sketch: Sketch, number: number, change: Partial<Shape>): Sketch {
  const shapes = sketch.shapes.map((shape, k) => (k === number ? { ...shape, ...change } : shape));
  return changed(sketch, { shapes });
}

export function withRing(sketch: Sketch, number: number, ring: number, positions: Position[]): Sketch {
  const rings = sketch.shapes[number]!.rings.map((one, k) => (k === ring ? positions : one));
  return withShape(sketch, number, { rings });
}

/** Without a corner; a ring of two corners is none: a hole goes, an outline takes its shape along. */
export function withoutCorner(sketch: Sketch, number: number, ring: number, corner: number): Sketch {
  const shape = sketch.shapes[number]!;
  const positions = shape.rings[ring]!.filter((_, k) => k !== corner);
  if (positions.length >= 3) return withRing(sketch, number, ring, positions);
  if (ring > 0) return withShape(sketch, number, { rings: shape.rings.filter((_, k) => k !== ring) });
  return withoutShape(sketch, number);
}

export function withoutShape(sketch: Sketch, number: number): Sketch {
  return changed(sketch, { shapes: sketch.shapes.filter((_, k) => k !== number) });
}

/** A name that no shape has yet. */
export function freeName(sketch: Sketch, what: string): string {
  const taken = new Set(sketch.shapes.map((shape) => shape.name));
  for (let number = 1; ; number++) if (!taken.has(`${what} ${number}`)) return `${what} ${number}`;
}

export function isInside([x, y]: Position, ring: Position[]): boolean {
  let inside = false;
  for (let k = 0, before = ring.length - 1; k < ring.length; before = k++) {
    const [[ax, ay], [bx, by]] = [ring[k]!, ring[before]!];
    if (ay > y !== by > y && x < ((bx - ax) * (y - ay)) / (by - ay) + ax) inside = !inside;
  }
  return inside;
}

/** The topmost field that has a position on its land. */
export function fieldAt(sketch: Sketch, place: Position): number | null {
  const found = sketch.shapes.findLastIndex(
    ({ kind, rings }) =>
      kind === "field" && isInside(place, rings[0]!) && !rings.slice(1).some((hole) => isInside(place, hole)),
  );
  return found < 0 ? null : found;
}

/** Sketches one after the other, for undo and redo. */
export class History {
  private past: Sketch[] = [];
  private future: Sketch[] = [];

  constructor(public now: Sketch) {}

  /** There is nothing before or after what is now. */
  forget(): void {
    [this.past, this.future] = [[], []];
  }

  push(sketch: Sketch): void {
    if (sketch === this.now) return;
    this.past.push(this.now);
    [this.future, this.now] = [[], sketch];
  }

  get canUndo(): boolean {
    return this.past.length > 0;
  }

  get canRedo(): boolean {
    return this.future.length > 0;
  }

  undo(): void {
    const before = this.past.pop();
    if (!before) return;
    this.future.push(this.now);
    this.now = before;
  }

  redo(): void {
    const after = this.future.pop();
    if (!after) return;
    this.past.push(this.now);
    this.now = after;
  }
}
