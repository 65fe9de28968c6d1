// What the server sends: an `Update` with everything when a page connects, then with what is new since.
// `wbf_mission/addons/web/view.py` makes it, of the structs of `wbf_mission/addons/web/schema.py`; a test compares their names
// with these. Times are seconds since the run began, places metres of the farm frame. What is not finite is null.

/** A ring of points, x and y in turn: [x0, y0, x1, y1, ...]. */
export type Ring = number[];

export interface FarmShape {
  name: string;
  /** Latitude and longitude of the farm frame's origin, and their change for each metre along x and y. */
  georeference: { lat: number; lon: number; lat_x: number; lat_y: number; lon_x: number; lon_y: number };
  width_m: number;
  height_m: number;
  home_m: [number, number];
  /** In the order of painting: later ones lie over earlier ones. Rings: the outline, then the holes. */
  patches: { name: string; crop: string; own: boolean; rings: Ring[] }[];
  /** Without a height: a no-fly zone, or too high to be flown over. */
  obstacles: { name: string; height_m: number | null; rings: Ring[] }[];
  rally_m: [number, number][];
}

export interface FieldInfo {
  name: string;
  title: string;
  kind: "disease" | "continuous" | "measured";
  unit: string;
  /** What 0 and 1 stand for. */
  range: [number, number];
  /** Two or more, "#rrggbb", from 0 to 1; none where they are those of its kind, of which the page has its own. */
  colours: string[];
}

export interface Raster {
  /** Pixels along x and y, pixel (0, 0) at the frame's origin; a pixel covers `cells` x `cells` cells, `pixel_m`
   * a side. It shows the mean of the owner's cells that grow what the field concerns. */
  width: number;
  height: number;
  pixel_m: number;
  cells: number;
  tile: number;
}

/** Layers are named "value/FIELD", "uncertainty/FIELD", "truth/FIELD" or "acquisition". */
export type LayerName = string;

/** Tile (x, y) begins at pixel (x * tile, y * tile); those at the far borders are cut off by them. A byte a
 * pixel, row by row from the bottom up: 0 to 254 for 0 to the layer's scale, 255 where there is nothing; packed by
 * zlib, in base64. It replaces the tile of the same place; what never came holds nothing. */
export interface Tile {
  layer: LayerName;
  x: number;
  y: number;
  data: string;
}

export interface VehicleInfo {
  system_id: number;
  name: string;
  kind: string;
}

export interface Plan {
  system_id: number;
  day: number;
  flight: number;
  time_s: number;
  path: Ring;
  fence: { rings: Ring[]; inclusion: boolean }[];
  /** In words, in the order of the mission's items. */
  items: string[];
  duration_s: number | null;
  length_m: number | null;
  coverage: number | null;
}

/** States of one vehicle as columns, one entry for each moment. */
export interface States {
  time_s: number[];
  day: number[];
  flight: number[];
  x: number[];
  y: number[];
  height_m: (number | null)[];
  speed_m_s: (number | null)[];
  heading_deg: (number | null)[];
  battery: (number | null)[];
  link: (number | null)[];
  item: (number | null)[];
  items: (number | null)[];
  mode: string[];
  phase: string[];
  armed: boolean[];
  silent_s: number[];
}

export interface Readings {
  time_s: number[];
  x: number[];
  y: number[];
  /** By field, null where the camera told nothing, and where none of the field's crops grows. */
  values: Record<string, (number | null)[]>;
}

/** Estimates as columns; the losses by field. */
export interface Scores {
  time_s: number[];
  day: number[];
  observations: number[];
  score: (number | null)[];
  losses: Record<string, (number | null)[]>;
}

export interface Candidate {
  system_id: number;
  path: Ring;
  value: number;
  cost: number;
}

/** One with a number that is known already replaces that: outcomes change while they are carried out. */
export interface Decision {
  number: number;
  time_s: number;
  day: number;
  flight: number;
  event: string;
  reason: string;
  refused: string;
  compute_s: number;
  /** What was thought of, the best first. */
  candidates: Candidate[];
  changes: { system_id: number; path: Ring; cost: number; outcome: string }[];
}

export interface Said {
  time_s: number;
  /** 0 for a note of the program's own. */
  system_id: number;
  severity: number;
  text: string;
}

export interface Status {
  /** "running" or how the run ended. */
  outcome: string;
  /** The same as people read it. */
  words: string;
  reason: string;
  progress: { what: string; done: number; total: number } | null;
  question: { text: string; answers: string[]; number: number } | null;
  /** Orders that this page may give; none where it only shows. */
  orders: string[];
}

export interface Run {
  title: string;
  simulated: boolean;
  seed: number | null;
  estimator: string | null;
  planner: string | null;
  farm: FarmShape | null;
  fields: FieldInfo[];
  raster: Raster | null;
  vehicles: VehicleInfo[];
}

export interface Beat {
  /** On the program's own clock, since this page was connected. */
  time_s: number;
  /** How old the newest state of each vehicle is, by system id; of none in a simulation, whose time may stand. */
  silent_s: Record<string, number>;
}

/** What is new; what is missing did not change. Lists and columns are appended to what there is, the others
 * replace it (of `tiles` and `decisions` each its own kind). */
export interface Update {
  time_s: number;
  /** What begins anew, and is to be emptied before the rest of this update is taken: "plans", "said",
   * "decisions", "scores", "states/SYSTEM_ID", whose older rows were thinned out; "tiles", all layers and their
   * scales. */
  restart?: string[];
  run?: Run;
  plans?: Plan[];
  states?: Record<string, States>;
  readings?: Readings;
  scores?: Scores;
  decisions?: Decision[];
  said?: Said[];
  tiles?: Tile[];
  /** What 254 stands for, by layer; all of them with every update that has tiles. */
  scales?: Record<LayerName, number>;
  status?: Status;
  /** The tiles background that the server has, if any. */
  background?: { attribution: string; min_zoom: number; max_zoom: number } | null;
  /** What became of this page's request with this number, which no other page is told: no error, and it was
   * taken. */
  reply?: { order: string; error: string; number: number };
  /** The program lives: once a second, after all that was new. */
  beat?: Beat;
}

/** A finished run in a page of its own: all of it, and the layers as they were at some moments. */
export interface Recording extends Update {
  /** Moments in the order of their times; tiles of each replace those of the ones before. */
  moments: {
    time_s: number;
    day: number;
    observations: number;
    tiles: Tile[];
    /** What 254 stands for in its tiles, by layer. */
    scales: Record<LayerName, number>;
  }[];
}

/** When a request was given: by the newest beat that had come, on the page's clock since then. */
export interface Given {
  /** Greater than those before: each request counts once. */
  number: number;
  beat_s: number;
  after_s: number;
}

/** What the page asks for: an order to vehicles, or the answer to a question. */
export type Wish =
  | { order: string; system_ids: number[]; value?: string; confirmed?: boolean }
  | { answer: string; question: number };

/** What it sends, over the same WebSocket. */
export type Request = Wish & { given: Given };
