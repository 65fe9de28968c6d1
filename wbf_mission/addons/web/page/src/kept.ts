// Drafts stored in the browser, which survive a reload or a crash. Other pages may write to the same storage,
// so an invalid draft is ignored.
import type { OptionInfo, Values } from "./choices.js";
import type { Kind, Position, Sketch } from "./sketch.js";

const NAME = "wbf-mission studio";
const FORM = 1;
const MOST_CORNERS = 100_000;
const KINDS: Kind[] = ["field", "obstacle", "no-fly"];

interface Kept {
  sketch: Sketch;
  values: Values;
  /** Initial options of the program. */
  start: string;
  /** Whether the farm is not saved in a file. */
  unsaved: boolean;
}

/** Store a draft; returns whether the browser could. */
export function keepDraft(kept: Kept): boolean {
  try {
    const text = JSON.stringify({ form: FORM, ...kept });
    // Each page reloads its own draft; after a crash, the newest one is restored.
    for (const storage of [sessionStorage, localStorage]) storage.setItem(NAME, text);
    return true;
  } catch {
    return false;
  }
}

export function keptDraft(options: OptionInfo[]): Kept | null {
  for (const storage of ["sessionStorage", "localStorage"] as const) {
    try {
      const given: unknown = JSON.parse(window[storage].getItem(NAME) ?? "null");
      if (!isDraft(given)) continue;
      const { values, ...kept } = given as Kept;
      // The program may have had other options.
      const known = Object.entries(values).filter(([key]) => options.some((option) => option.key === key));
      return { ...kept, values: Object.fromEntries(known) };
    } catch {
      // Invalid JSON, or storage is disabled.
    }
  }
  return null;
}

type Check = (given: unknown) => boolean;

const isText: Check = (given) => typeof given === "string" && given.length <= 1000;
const isNumber = (given: unknown): given is number => Number.isFinite(given);
const isPlain: Check = (given) => isText(given) || isNumber(given) || typeof given === "boolean";
const isObject: Check = (given) => typeof given === "object" && given !== null && !Array.isArray(given);
const within = (low: number, high: number): Check => (given) => isNumber(given) && low <= given && given <= high;
const orNull = (check: Check): Check => (given) => given === null || check(given);
const listOf = (check: Check, least = 0, most = Infinity): Check => (given) =>
  Array.isArray(given) && given.length >= least && given.length <= most && given.every(check);
/** Check of an object's members by name; it may have further members. */
const withMembers = (checks: Record<string, Check>): Check => (given) =>
  isObject(given) && Object.entries(checks).every(([name, check]) => check((given as Record<string, unknown>)[name]));

const isMetres = orNull(within(0, Infinity));
const isPair = listOf(within(-360, 360), 2, 2);
const isPosition: Check = (given) => isPair(given) && within(-90, 90)((given as Position)[1]);
const isShape = withMembers({
  name: isText,
  kind: (given) => KINDS.includes(given as Kind),
  crop: isText,
  owner: isText,
  height_m: isMetres,
  margin_m: isMetres,
  rings: listOf(listOf(isPosition, 3, MOST_CORNERS), 1),
});
const isSketch = withMembers({
  known: orNull(isText),
  name: isText,
  owner: isText,
  home: orNull(isPosition),
  rally: listOf(isPosition),
  shapes: listOf(isShape),
  members: isObject,
});
const isDraft = withMembers({
  form: (given) => given === FORM,
  start: (given) => typeof given === "string",
  sketch: isSketch,
  values: (given) => isObject(given) && Object.values(given as object).every(isPlain),
});
