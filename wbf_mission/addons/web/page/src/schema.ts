// Made of schema.py by tools/write_page_schema.py.
// A page gets an `Update` with everything when it connects, then with what is new since. Times are seconds since
// the run began, places metres of the farm frame. What is not finite is null.

/** Points, x and y in turn: [x0, y0, x1, y1, ...]. */
export type Ring = number[];

/** Layers are named "value/FIELD", "uncertainty/FIELD", "truth/FIELD" or "acquisition". */
export type LayerName = string;

/** Degrees of the frame's origin, and their change for each metre along x and y. */
export interface Georeference {
  lat: number;
  lon: number;
  lat_x: number;
  lat_y: number;
  lon_x: number;
  lon_y: number;
}

/** A patch: its outline first, then its holes. */
export interface PatchShape {
  name: string;
  crop: string;
  own: boolean;
  rings: Ring[];
}

/** An obstacle or a no-fly zone. */
export interface ObstacleShape {
  name: string;
  /** None for a no-fly zone, or an obstacle that is too high to be flown over. */
  height_m: number | null;
  rings: Ring[];
}

/** The land. */
export interface FarmShape {
  name: string;
  georeference: Georeference;
  width_m: number;
  height_m: number;
  home_m: [number, number];
  /** In the order of painting: later ones lie over earlier ones. */
  patches: PatchShape[];
  obstacles: ObstacleShape[];
  rally_m: [number, number][];
}

/** A field. */
export interface FieldInfo {
  name: string;
  title: string;
  kind: "disease" | "continuous" | "measured";
  unit: string;
  /** What 0 and 1 stand for. */
  range: [number, number];
  /** Two or more, "#rrggbb", from 0 to 1; none where they are those of its kind, which the page has. */
  colours: string[];
}

/** The pixels of all layers: means of the owner's cells that grow what the field concerns. */
export interface Raster {
  width: number;
  /** Pixels along x and y; pixel (0, 0) is at the frame's origin. */
  height: number;
  pixel_m: number;
  /** Along a side of a pixel. */
  cells: number;
  /** Pixels along a side of a tile. */
  tile: number;
}

/** Pixels of a part of a layer, in place of its tile there; a part that never came holds nothing. */
export interface Tile {
  layer: LayerName;
  x: number;
  /** It begins at pixel (x * tile, y * tile); those at the far borders are cut off by them. */
  y: number;
  /** A byte a pixel, row by row from the bottom up: 0 to 254 for 0 to the layer's scale, 255 where there is
   * nothing; packed by zlib, in base64. */
  data: string;
}

/** A vehicle that takes part. */
export interface VehicleInfo {
  system_id: number;
  name: string;
  kind: string;
}

/** A part of a geofence. */
export interface FenceShape {
  rings: Ring[];
  inclusion: boolean;
}

/** What a vehicle is to fly from a time on. */
export interface Plan {
  system_id: number;
  day: number;
  flight: number;
  time_s: number;
  path: Ring;
  fence: FenceShape[];
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

/** Readings of cells as columns. */
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

/** A path that was thought of. */
export interface Candidate {
  system_id: number;
  path: Ring;
  value: number;
  cost: number;
}

/** A path that was chosen, and what became of it. */
export interface Change {
  system_id: number;
  path: Ring;
  cost: number;
  outcome: string;
}

/** An answer of a policy, in place of one with its number: outcomes change while it is carried out. */
export interface Decision {
  number: number;
  time_s: number;
  day: number;
  flight: number;
  event: string;
  reason: string;
  refused: string;
  compute_s: number;
  /** The best first. */
  candidates: Candidate[];
  changes: Change[];
}

/** A line of a vehicle's or of the program's. */
export interface Said {
  time_s: number;
  /** 0 for a note of the program's own. */
  system_id: number;
  severity: number;
  text: string;
}

/** How far some work is. */
export interface Progress {
  what: string;
  done: number;
  total: number;
}

/** What the operator is asked. */
export interface Question {
  text: string;
  answers: string[];
  number: number;
}

/** How the run is going. */
export interface Status {
  /** "running", or how the run ended. */
  outcome: string;
  /** The same as people read it. */
  words: string;
  reason: string;
  progress: Progress | null;
  question: Question | null;
  /** Orders that this page may give; none where it only shows. */
  orders: string[];
}

/** What is flown. */
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

/** The user's own map tiles. */
export interface Background {
  attribution: string;
  min_zoom: number;
  max_zoom: number;
}

/** The outcome of the request with this number, sent to its page only. */
export interface Reply {
  order: string;
  error: string;
  number: number;
}

/** A sign of life of the program, once a second, after all that was new. */
export interface Beat {
  /** On the program's own clock, since this page was connected. */
  time_s: number;
  /** Age of each vehicle's newest state, by system id; of none in a simulation, whose time may stand. */
  silent_s: Record<string, number>;
}

/** What is new; what is missing did not change. Lists and columns are appended; the others replace what there is
 * (`tiles`, `decisions` each its own kind). */
export interface Update {
  time_s: number;
  /** Emptied before the rest is taken: "plans", "said", "decisions", "scores", "states/SYSTEM_ID", whose older rows
   * were thinned out; "tiles", all layers and their scales. */
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
  background?: Background | null;
  reply?: Reply;
  beat?: Beat;
}

/** The layers as they were from a time on. */
export interface Moment {
  time_s: number;
  day: number;
  observations: number;
  tiles: Tile[];
  /** What 254 stands for in its tiles. */
  scales: Record<LayerName, number>;
}

/** A finished run in a page of its own: all of it, and the layers as they were at some moments. */
export interface Recording extends Update {
  /** In the order of their times; tiles of each replace those of the ones before. */
  moments: Moment[];
}

/** The time of a request: the newest beat of the page, and the seconds since then on its own clock. */
export interface Given {
  /** Greater than those before: each request counts once. */
  number: number;
  beat_s: number;
  after_s: number;
}

/** An order of a page to vehicles. */
export interface Order {
  order: string;
  system_ids: number[];
  given: Given;
  value?: string;
  confirmed?: boolean;
}

/** An answer of a page to the operator's question with this number. */
export interface Answer {
  answer: string;
  question: number;
  given: Given;
}
