// Requests of the studio page to the program, and the parts of the answers that the page reads.
import { element } from "./dom.js";
import type { OptionInfo, Parameters, Values } from "./choices.js";
import type { FarmShape, Plan, Update } from "./schema.js";
import type { FarmFile } from "./sketch.js";

export interface Finding {
  severity: "error" | "warning" | "note";
  code?: string;
  told: string;
  place_m?: [number, number] | null;
}

/** Totals of one vehicle over all its sorties. */
interface Summary {
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
  /** The names distinguish several missions; the name of a single one is empty. */
  missions: { name: string; plan: Plan; warnings: string[]; findings: Finding[] }[];
  /** Fraction of the target land seen by all missions together. */
  coverage: number;
  vehicles: Summary[];
  plan_s: number;
  check_s: number;
  /** Reason why the simulator cannot fly the plan; empty if it can. */
  not_flown: string;
  flown_note: string;
}

export interface Options {
  options: OptionInfo[];
  farms: string[];
  crops: string[];
  parameters: Parameters;
  formats: { name: string; suffix: string }[];
  start: { farm: string; options: Values };
  background: Update["background"];
}

interface Uploaded {
  vehicle: string;
  items: Record<string, number>;
  verified: boolean;
  accepted: boolean | null;
  texts: string[];
}

/** Input of the planner: a farm by name or as GeoJSON, and options. */
export interface Draft {
  farm: string | FarmFile;
  options: Values;
}

/** A request that the program refused, with a possible remedy for a farm; the message is one line. */
export class Refused extends Error {
  constructor(
    message: string,
    readonly superseded: "" | "given up" | "another page" = "",
    readonly remedy: "" | "repair" | "crop" | "crs" = "",
  ) {
    super(message);
  }
}

type Query = Record<string, string>;

/** Ask the program; a file, or an object as JSON, is sent by POST. */
async function ask(path: string, query: Query, body?: unknown, signal: AbortSignal | null = null): Promise<Response> {
  const address = new URL(`api/${path}`, location.href);
  address.search = String(new URLSearchParams(query));
  const sent = body instanceof File ? body : JSON.stringify(body);
  try {
    return await fetch(address, body === undefined ? {} : { method: "POST", body: sent, signal });
  } catch {
    throw new Refused("The program does not answer: is it still running?");
  }
}

async function json<T>(path: string, query: Query = {}, body?: unknown, signal?: AbortSignal): Promise<T> {
  return told(await ask(path, query, body, signal));
}

async function told<T>(response: Response): Promise<T> {
  const text = await response.text();
  let answer: T & { error?: string } & Partial<Pick<Refused, "superseded" | "remedy">>;
  try {
    answer = JSON.parse(text) as typeof answer;
  } catch {
    throw new Refused(text || response.statusText);
  }
  const { error, superseded, remedy } = answer;
  if (superseded === "another page")
    throw new Refused("another page of the studio replaced this draft: plan again here", superseded);
  if (error !== undefined) throw new Refused(error, superseded, remedy);
  return answer;
}

type FarmAnswer = { document: FarmFile; notes: string[] };

export const desk = {
  options: () => json<Options>("options"),
  farm: (name: string) => json<FarmAnswer>("farm", { name }),
  read: (file: File, how: Query) => json<FarmAnswer>("farm", { name: file.name, ...how }, file),
  mend: (farm: FarmFile) => json<FarmAnswer>("farm", { repair: "true" }, farm),
  plan: (draft: Draft, signal: AbortSignal) => json<Planned>("plan", {}, draft, signal),
  cancel: () => json("cancel", {}, {}),
  file: async (draft: Draft, mission: number, format: string): Promise<{ name: string; content: Blob }> => {
    const response = await ask("export", { mission: String(mission), format }, draft);
    const disposition = response.headers.get("Content-Disposition");
    if (disposition === null) return told(response);
    const name = /filename\*=UTF-8''(.+)/.exec(disposition)![1]!;
    return { name: decodeURIComponent(name), content: await response.blob() };
  },
  upload: (draft: Draft, mission: number, link: string, system_id: string) =>
    json<Uploaded>("upload", { mission: String(mission), link, system_id, confirmed: "true" }, draft),
  fly: (draft: Draft, pace: string) => json("fly", { pace }, draft),
  /** State of the latest flight: "none", "preparing", "flying" or an outcome, also in words. */
  flight: () => json<{ outcome: string; words: string }>("flight"),
  stop: () => json<{ stopped: boolean }>("stop", {}, {}),
};

export function keep(name: string, content: Blob): void {
  const href = URL.createObjectURL(content);
  element("a", { href, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(href), 10_000);
}
