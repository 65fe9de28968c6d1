// Drafts stored in the browser, which survive a reload or a crash. Other pages may write to the same storage,
// so an invalid draft is ignored.
import type { OptionInfo, Value, Values } from "./choices.js";
import type { Kind, Position, Shape, Sketch } from "./sketch.js";

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
      const found = readDraft(JSON.parse(window[storage].getItem(NAME) ?? "null"), options);
      if (found) return found;
    } catch {
      // Invalid JSON, or storage is disabled.
    }
  }
  return null;
}

type Any = Record<string, unknown>;

function readDraft(given: unknown, options: OptionInfo[]): Kept | null {
  if (!isObject(given) || given["form"] !== FORM || typeof given["start"] !== "string") return null;
  const { sketch, values, start } = given;
  if (!isSketch(sketch) || !isObject(values)) return null;
  const types = new Map(options.map(({ key, type }) => [key, type]));
  const fits = ([key, value]: [string, unknown]): boolean => {
    const type = types.get(key);
    if (type === "flag") return typeof value === "boolean";
    return type === "text" ? isText(value) : type !== undefined && isFinite(value);
  };
  const known = Object.fromEntries(Object.entries(values).filter(fits)) as Record<string, Value>;
  return { sketch, values: known, start, unsaved: given["unsaved"] === true };
}

function isObject(given: unknown): given is Any {
  return typeof given === "object" && given !== null && !Array.isArray(given);
}

const isText = (given: unknown): given is string => typeof given === "string" && given.length <= 1000;
const isFinite = (given: unknown): given is number => typeof given === "number" && Number.isFinite(given);
const isMetres = (given: unknown): boolean => given === null || (isFinite(given) && given >= 0);

function isPosition(given: unknown): given is Position {
  const [lon, lat] = Array.isArray(given) ? (given as unknown[]) : [];
  return isFinite(lon) && isFinite(lat) && Math.abs(lon) <= 360 && Math.abs(lat) <= 90 && (given as unknown[]).length === 2;
}

function isRing(given: unknown): given is Position[] {
  return Array.isArray(given) && given.length >= 3 && given.length <= MOST_CORNERS && given.every(isPosition);
}

function isShape(given: unknown): given is Shape {
  if (!isObject(given)) return false;
  const { kind, rings } = given;
  return (
    [given["name"], given["crop"], given["owner"]].every(isText) &&
    KINDS.includes(kind as Kind) &&
    [given["height_m"], given["margin_m"]].every(isMetres) &&
    Array.isArray(rings) && rings.length > 0 && rings.every(isRing)
  );
}

function isSketch(given: unknown): given is Sketch {
  if (!isObject(given)) return false;
  const { known, home, rally, shapes, members } = given;
  return (
    (known === null || isText(known)) && isText(given["name"]) && isText(given["owner"]) &&
    (home === null || isPosition(home)) &&
    Array.isArray(rally) && rally.every(isPosition) &&
    Array.isArray(shapes) && shapes.every(isShape) &&
    isObject(members)
  );
}
