// Data received of a run, and its state at any time.
import type {
  Decision, FieldInfo, Plan, Readings, Recording, Run, Said, Scores, States, Status, Update, VehicleInfo,
} from "./schema.js";
import { Tiles } from "./tiles.js";

/** Age from which a vehicle counts as silent (s). */
export const SILENT_S = 3;

/** Number of ascending times that are not after a time. */
export function upTo(times: number[], time_s: number): number {
  let [low, high] = [0, times.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle]! <= time_s) low = middle + 1;
    else high = middle;
  }
  return low;
}

type Table = { time_s: number[] };
type Columns = Record<string, unknown[] | Record<string, unknown[]>>;

/** Append the rows of a table; columns by field that one of the tables lacks are filled with null. */
function extend<T extends Table>(table: T, added: T): void {
  const [known, fresh] = [table.time_s.length, added.time_s.length];
  const columns = table as unknown as Columns;
  for (const [name, column] of Object.entries(added as unknown as Columns)) {
    const held = columns[name]!;
    if (Array.isArray(column)) for (const value of column) (held as unknown[]).push(value);
    else {
      const byField = held as Record<string, unknown[]>;
      for (const field of new Set([...Object.keys(byField), ...Object.keys(column)])) {
        const values = (byField[field] ??= new Array<null>(known).fill(null));
        for (let k = 0; k < fresh; k++) values.push(column[field]?.[k] ?? null);
      }
    }
  }
}

/** State values that are interpolated linearly. */
const BETWEEN = ["x", "y", "height_m", "speed_m_s", "battery"] as const;

/** Value at a time, interpolated between state `last` and the next. */
export function between(states: States, name: (typeof BETWEEN)[number], last: number, time_s: number): number | null {
  const [from, to] = [states[name][last] ?? null, states[name][last + 1] ?? null];
  const [from_s, to_s] = [states.time_s[last] ?? 0, states.time_s[last + 1] ?? 0];
  if (from === null || to === null || to_s <= from_s) return from;
  return from + ((to - from) * (time_s - from_s)) / (to_s - from_s);
}

/** State of a vehicle at a time. */
export interface Moment extends Row<States> {
  silent: boolean;
  /** Whether the state is the present one. */
  present: boolean;
}

type Row<T> = { [Name in keyof T]: T[Name] extends (infer Value)[] ? Value : never };

export class Model {
  run: Run | null = null;
  status: Status | null = null;
  background: Update["background"] = null;
  plans: Plan[] = [];
  states: Record<string, States> = {};
  readings: Readings = { time_s: [], x: [], y: [], values: {} };
  scores: Scores = { time_s: [], day: [], observations: [], score: [], losses: {} };
  decisions: Decision[] = [];
  said: Said[] = [];
  tiles = new Tiles();
  /** Time of the newest data. */
  end_s = 0;
  /** Age of each vehicle's newest state at the program's last beat. */
  private beat_s: Record<string, number> = {};

  /** `letter` distinguishes several runs; `age_s` is the age of the program's last beat in a live run. */
  constructor(readonly letter = "", readonly age_s: (() => number) | null = null) {}

  /** Whether the run is live, so that its newest data is the present. */
  get runs(): boolean {
    return this.age_s !== null && this.status?.outcome === "running";
  }

  take(update: Update): void {
    for (const name of update.restart ?? []) {
      const [list, id] = name.split("/") as ["plans" | "said" | "decisions" | "scores" | "states" | "tiles", string?];
      if (id) delete this.states[id];
      else Object.assign(this, { [list]: new Model()[list] });
    }
    if (update.run) this.run = update.run;
    if (update.status) this.status = update.status;
    if (update.background !== undefined) this.background = update.background;
    this.plans.push(...(update.plans ?? []));
    for (const [id, states] of Object.entries(update.states ?? {}))
      if (this.states[id]) extend(this.states[id], states);
      else this.states[id] = states;
    if (update.beat) this.beat_s = update.beat.silent_s;
    if (update.readings) this.takeReadings(update.readings);
    if (update.scores) extend(this.scores, update.scores);
    for (const decision of update.decisions ?? []) {
      const old = this.decisions.findIndex((one) => one.number === decision.number);
      this.decisions.splice(old < 0 ? this.decisions.length : old, 1, decision);
    }
    this.said.push(...(update.said ?? []));
    if (update.tiles) this.tiles.add(update.tiles, update.time_s, update.scales!);
    const { moments = [] } = update as Partial<Recording>;
    for (const { tiles, time_s, scales } of moments) this.tiles.add(tiles, time_s, scales);
    const flown_s = Object.values(this.states).map(({ time_s }) => time_s.at(-1) ?? 0);
    this.end_s = Math.max(this.end_s, update.time_s, ...moments.map(({ time_s }) => time_s), ...flown_s);
  }

  get vehicles(): VehicleInfo[] {
    return this.run?.vehicles ?? [];
  }

  /** Fields with a layer, or all before the first layer; other fields have no crop on the farm. */
  get fields(): FieldInfo[] {
    const all = this.run?.fields ?? [];
    const drawn = all.filter(({ name }) => ["value", "truth"].some((kind) => this.tiles.has(`${kind}/${name}`)));
    return drawn.length ? drawn : all;
  }

  field(name: string): FieldInfo | undefined {
    return this.run?.fields.find((field) => field.name === name);
  }

  /** Display name of a vehicle, with its number if the name is not unique. */
  nameOf(system_id: number): string {
    const name = this.vehicles.find((info) => info.system_id === system_id)?.name;
    const several = this.vehicles.filter((info) => info.name === name).length > 1;
    return [name ?? "vehicle", several || !name ? system_id : "", this.letter].filter(Boolean).join(" ");
  }

  vehicleAt(system_id: number, time_s: number): Moment | null {
    const states = this.states[system_id];
    const last = states ? upTo(states.time_s, time_s) - 1 : -1;
    if (!states || last < 0) return null;
    const row = Object.fromEntries(Object.entries(states).map(([name, column]) => [name, column[last]]));
    const moment = row as unknown as Moment;
    const since_s = time_s - moment.time_s;
    const present = this.runs && time_s >= this.end_s;
    const now_s = present ? (this.beat_s[system_id] ?? 0) + (this.age_s?.() ?? 0) : 0;
    const silent_s = Math.max(moment.silent_s + (this.status?.outcome === "running" ? since_s : 0), now_s);
    Object.assign(moment, { silent_s, silent: silent_s > SILENT_S, present });
    const flown = states.flight[last + 1] === moment.flight;
    for (const name of BETWEEN) {
      const value = between(states, name, last, time_s);
      if (flown && value !== null) moment[name] = value;
    }
    return moment;
  }

  planAt(system_id: number, time_s: number): Plan | undefined {
    const its = this.plans.filter((plan) => plan.system_id === system_id);
    return its.findLast((plan) => plan.time_s <= time_s) ?? its[0];
  }

  scoreAt(time_s: number): number | null {
    return this.scores.score[upTo(this.scores.time_s, time_s) - 1] ?? null;
  }

  /** Day in words, if the run has several. */
  dayAt(time_s: number): string {
    const { day, time_s: times } = this.scores;
    return day[0] === day.at(-1) ? "" : `day ${day[Math.max(0, upTo(times, time_s) - 1)]}`;
  }

  /** Append readings and keep them in order of time; they may arrive late. */
  private takeReadings(readings: Readings): void {
    const known = this.readings.time_s.length;
    extend(this.readings, readings);
    const { time_s, x, y, values } = this.readings;
    const fresh = time_s.slice(Math.max(0, known - 1));
    if (fresh.every((time, k) => k === 0 || fresh[k - 1]! <= time)) return;
    const order = [...time_s.keys()].sort((a, b) => time_s[a]! - time_s[b]!);
    const sorted = <T>(column: T[]): T[] => order.map((k) => column[k]!);
    const byField = Object.entries(values).map(([name, column]) => [name, sorted(column)]);
    this.readings = { time_s: sorted(time_s), x: sorted(x), y: sorted(y), values: Object.fromEntries(byField) };
  }
}
