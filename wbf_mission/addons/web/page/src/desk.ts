// Requests of the studio page to the program, and the parts of the answers that the page reads.
import { element } from "./dom.js";
import type { OptionInfo, Parameters, Values } from "./choices.js";
import type { FarmShape, Plan, Update } from "./schema.js";

export interface Finding {
  severity: "error" | "warning" | "note";
  code?: string;
  told: string;
  place_m?: [number, number] | null;
}

export interface PlannedMission {
  /** Distinguishes several missions; empty for a single one. */
  name: string;
  plan: Plan;
  warnings: string[];
  findings: Finding[];
}

/** Totals of one vehicle over all its sorties. */
export interface Summary {
  predicted_time_s: number;
  time_with_changes_s?: number;
  length_m: number;
  predicted_energy_wh: number;
  battery_used: number | null;
  batteries: number | null;
  spacing_m: number | null;
  waypoints: number;
}

export interface Planned {
  farm: FarmShape;
  notes: string[];
  missions: PlannedMission[];
  /** Fraction of the target land seen by all missions together. */
  coverage: number;
  vehicles: Summary[];
  plan_s: number;
  check_s: number;
  /** Reason why the simulator cannot fly the plan; empty if it can. */
  not_flown: string;
  flown_note: string;
}

/** State of the latest flight: "none", "preparing", "flying" or an outcome, also in words. */
export interface FlightState {
  outcome: string;
  words: string;
}

/** Possible remedy for a refused farm. */
export type Remedy = "" | "repair" | "crop" | "crs";

export interface Options {
  options: OptionInfo[];
  farms: string[];
  crops: string[];
  parameters: Parameters;
  formats: { name: string; suffix: string }[];
  start: { farm: string; options: Values };
  background: Update["background"];
}

export interface FarmAnswer {
  document: Record<string, unknown>;
  notes: string[];
}

export interface Uploaded {
  vehicle: string;
  items: Record<string, number>;
  verified: boolean;
  accepted: boolean | null;
  texts: string[];
}

/** Input of the planner: a farm by name or as GeoJSON, and options. */
export interface Draft {
  farm: string | Record<string, unknown>;
  options: Values;
}

/** A request that the program refused; the message is one line. */
export class Refused extends Error {
  constructor(message: string, readonly superseded: "" | "here" | "given up" | "another page" = "", readonly remedy: Remedy = "") {
    super(message);
  }
}

async function ask(path: string, init: RequestInit = {}): Promise<Response> {
  try {
    return await fetch(path, init);
  } catch (error) {
    if (error instanceof DOMException && error.name === "AbortError") throw new Refused("superseded", "here");
    throw new Refused("The program does not answer: is it still running?");
  }
}

async function json<T>(asked: Promise<Response>): Promise<T> {
  const response = await asked;
  const text = await response.text();
  let told: T & { error?: string; superseded?: "given up" | "another page"; remedy?: Remedy };
  try {
    told = JSON.parse(text) as typeof told;
  } catch {
    throw new Refused(text || response.statusText);
  }
  if (told.superseded === "another page") throw new Refused("another page of the studio took over: ask again here", told.superseded);
  if (told.error !== undefined) throw new Refused(told.error, told.superseded, told.remedy);
  return told;
}

const query = (given: Record<string, string>): string => new URLSearchParams(given).toString();
const post = (draft: Draft, signal?: AbortSignal): RequestInit => ({
  method: "POST",
  headers: { "Content-Type": "application/json" },
  body: JSON.stringify(draft),
  ...(signal ? { signal } : {}),
});

export const desk = {
  options: (): Promise<Options> => json(ask("api/options")),
  farm: (name: string): Promise<FarmAnswer> => json(ask(`api/farm?${query({ name })}`)),
  read: (file: File, how: Record<string, string> = {}): Promise<FarmAnswer> =>
    json(ask(`api/farm?${query({ name: file.name, ...how })}`, { method: "POST", body: file })),
  /** Repair a drawn farm. */
  mend: (document: Record<string, unknown>): Promise<FarmAnswer> =>
    json(ask(`api/farm?${query({ repair: "true" })}`, { method: "POST", body: JSON.stringify(document) })),
  plan: (draft: Draft, signal: AbortSignal): Promise<Planned> => json(ask("api/plan", post(draft, signal))),
  cancel: (): Promise<unknown> => json(ask("api/cancel", { method: "POST" })),
  file: async (draft: Draft, mission: number, format: string): Promise<{ name: string; content: Blob }> => {
    const response = await ask(`api/export?${query({ mission: String(mission), format })}`, post(draft));
    if (!response.headers.has("Content-Disposition")) return json(Promise.resolve(response));
    const name = /filename\*=UTF-8''(.+)/.exec(response.headers.get("Content-Disposition") ?? "")?.[1];
    return { name: decodeURIComponent(name ?? `mission${format}`), content: await response.blob() };
  },
  upload: (draft: Draft, mission: number, link: string, system_id: string): Promise<Uploaded> =>
    json(ask(`api/upload?${query({ mission: String(mission), link, system_id, confirmed: "true" })}`, post(draft))),
  fly: (draft: Draft, pace: string): Promise<unknown> => json(ask(`api/fly?${query({ pace })}`, post(draft))),
  flight: (): Promise<FlightState> => json(ask("api/flight")),
  stop: (): Promise<{ stopped: boolean }> => json(ask("api/stop", { method: "POST" })),
};

/** Save a file in the browser. */
export function keep(name: string, content: Blob): void {
  const href = URL.createObjectURL(content);
  element("a", { href, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(href), 10_000);
}
