// Made of schema.py by tools/write_page_schema.py.
// A page that connects receives an `Update` with all data; later updates have only new data. Times are seconds
// since the start of the run, places are metres in the farm frame. Infinite and missing numbers are null.

/** Points, alternating x and y: [x0, y0, x1, y1, ...]. */
export type Ring = number[];

/** Name of a layer: "value/FIELD", "uncertainty/FIELD", "truth/FIELD" or "acquisition". */
export type LayerName = string;

/** Latitude and longitude of the frame's origin, and their change per metre along x and y (degrees). */
export interface Georeference {
  lat: number;
  lon: number;
  lat_x: number;
  lat_y: number;
  lon_x: number;
  lon_y: number;
}

/** A patch of land: its outline, then its holes. */
export interface PatchShape {
  name: string;
  crop: string;
  own: boolean;
  rings: Ring[];
}

/** An obstacle or a no-fly zone. */
export interface ObstacleShape {
  name: string;
  /** None for a no-fly zone, or an obstacle too high to fly over. */
  height_m: number | null;
  rings: Ring[];
}

/** Map of the farm. */
export interface FarmShape {
  name: string;
  georeference: Georeference;
  width_m: number;
  height_m: number;
  home_m: [number, number];
  /** In drawing order: later patches cover earlier ones. */
  patches: PatchShape[];
  obstacles: ObstacleShape[];
  rally_m: [number, number][];
}

/** A field with its unit and colours. */
export interface FieldInfo {
  name: string;
  title: string;
  kind: "disease" | "continuous" | "measured";
  unit: string;
  /** Values in `unit` that 0 and 1 stand for. */
  range: [number, number];
  /** Two or more "#rrggbb" from 0 to 1; empty if the page's colours for this kind are used. */
  colours: string[];
}

/** Pixels of all layers: means over owned cells of the field's crops. */
export interface Raster {
  width: number;
  /** Pixels along x and y; pixel (0, 0) is at the frame's origin. */
  height: number;
  pixel_m: number;
  /** Cells along a side of a pixel. */
  cells: number;
  /** Pixels along a side of a tile. */
  tile: number;
}

/** New pixels of a part of a layer; a part for which no tile was sent is empty. */
export interface Tile {
  layer: LayerName;
  x: number;
  /** The tile starts at pixel (x * tile, y * tile); tiles at the far borders are smaller. */
  y: number;
  /** One byte per pixel, row by row from the bottom: bytes 0 to 254 stand for 0 to the layer's scale, 255 for no
   * value. The bytes are compressed by zlib and coded in base64. */
  data: string;
}

/** A vehicle of the run. */
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

/** A path that a vehicle is planned to fly from `time_s` on. */
export interface Plan {
  system_id: number;
  day: number;
  flight: number;
  time_s: number;
  path: Ring;
  fence: FenceShape[];
  /** Descriptions of the mission's items, in order. */
  items: string[];
  duration_s: number | null;
  length_m: number | null;
  coverage: number | null;
}

/** States of one vehicle as columns, one entry per time. */
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
  /** Values by field; null if there is no reading, or outside the field's crops. */
  values: Record<string, (number | null)[]>;
}

/** Scores of the estimates over time, as columns; losses by field. */
export interface Scores {
  time_s: number[];
  day: number[];
  observations: number[];
  score: (number | null)[];
  losses: Record<string, (number | null)[]>;
}

/** A path that a policy considered. */
export interface Candidate {
  system_id: number;
  path: Ring;
  value: number;
  cost: number;
}

/** A path that a policy chose, and its outcome. */
export interface Change {
  system_id: number;
  path: Ring;
  cost: number;
  outcome: string;
}

/** A decision of a policy; it replaces its older version, as outcomes change while it is executed. */
export interface Decision {
  number: number;
  time_s: number;
  day: number;
  flight: number;
  event: string;
  reason: string;
  refused: string;
  compute_s: number;
  /** Best first. */
  candidates: Candidate[];
  changes: Change[];
}

/** A message of a vehicle or of the program. */
export interface Said {
  time_s: number;
  /** 0 for the program. */
  system_id: number;
  severity: number;
  text: string;
}

/** Progress of a task. */
export interface Progress {
  what: string;
  done: number;
  total: number;
}

/** A question to the operator. */
export interface Question {
  text: string;
  answers: string[];
  number: number;
}

/** State of the run. */
export interface Status {
  /** "running", or the outcome of the run. */
  outcome: string;
  /** The outcome in words. */
  words: string;
  reason: string;
  progress: Progress | null;
  question: Question | null;
  /** Orders that this page may give; empty if it may give no orders. */
  orders: string[];
}

/** The run: its title, farm, fields and vehicles. */
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

/** Outcome of the request with this number, sent only to its page. */
export interface Reply {
  order: string;
  error: string;
  number: number;
}

/** Heartbeat of the program, once per second, after all new data. */
export interface Beat {
  /** Time on the program's own clock since this page connected. */
  time_s: number;
  /** Age of each vehicle's newest state, by system id; empty in a simulation, where time may stop. */
  silent_s: Record<string, number>;
}

/** New data; a missing member is unchanged. Rows of lists and columns are appended. Other members are replaced
 * whole, `tiles` and `decisions` by item. */
export interface Update {
  time_s: number;
  /** Members to empty first: "plans", "said", "decisions", "scores" and "states/SYSTEM_ID", if older rows were
   * thinned out; "tiles" for all layers and scales. */
  restart?: string[];
  run?: Run;
  plans?: Plan[];
  states?: Record<string, States>;
  readings?: Readings;
  scores?: Scores;
  decisions?: Decision[];
  said?: Said[];
  tiles?: Tile[];
  /** Value of byte 254, by layer; complete in every update with tiles. */
  scales?: Record<LayerName, number>;
  status?: Status;
  background?: Background | null;
  reply?: Reply;
  beat?: Beat;
}

/** A moment of a recording: the changes of its layers at one time. */
export interface Moment {
  time_s: number;
  day: number;
  observations: number;
  tiles: Tile[];
  /** Value of byte 254 in its tiles. */
  scales: Record<LayerName, number>;
}

/** A finished run within a page: all data, and the layers at some moments. */
export interface Recording extends Update {
  /** In order of time; a tile replaces the same tile of earlier moments. */
  moments: Moment[];
}

/** Time of a request: the page's newest beat, and the seconds since this beat by the page's clock. */
export interface Given {
  /** Greater than all earlier numbers: each request counts once. */
  number: number;
  beat_s: number;
  after_s: number;
}

/** An order from a page to vehicles. */
export interface Order {
  order: string;
  system_ids: number[];
  given: Given;
  value?: string;
  confirmed?: boolean;
}

/** An answer from a page to the question with this number. */
export interface Answer {
  answer: string;
  question: number;
  given: Given;
}
