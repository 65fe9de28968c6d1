// Colours of crops, values and vehicles. Lightness changes along each ramp, so that red and green need not be
// distinguished.
import type { FieldInfo, LayerName } from "./schema.js";

/** Colours of crops, as in `wbf_mission/addons/base/plots.py`. */
const CROPS: Record<string, string> = {
  strawberry: "#e8a7a1",
  tomato: "#b7d39b",
  pond: "#8fbcd4",
  wetland: "#9ccfb8",
  none: "#f4f1ea",
};
const FURTHER_CROPS = ["#d9c58b", "#c9b3d6", "#a8cfd0", "#e3b78c", "#c2c2b0", "#d8a8c2"];

/** Palette of Okabe and Ito, extended, in an order with high contrast on a map. */
const VEHICLES = [
  "#0072b2", "#d55e00", "#cc79a7", "#009e73", "#e69f00", "#56b4e9", "#7a5cc9", "#8c6d31", "#c23b5a", "#4d6a6d",
];

const HEALTH = ["#4a0b16", "#8e1f1c", "#e2711d", "#f6c66a", "#dcebc4"];
const WATER = ["#fdfbd3", "#d3eeb3", "#7fcdbb", "#41a6c4", "#1d6fb0", "#253494", "#0b1d52"];
const MEASURED = ["#fde725", "#7ad151", "#22a884", "#2a788e", "#414487", "#440154"];
const UNSURE = ["#f6f2f8", "#d5c5e3", "#a583c1", "#77409a", "#3d1160"];
const ACQUIRE = ["#f4f9f6", "#b5dfc8", "#5db598", "#1e7c73", "#0b3b47"];

/** Colours of crops by name, each once. */
export function cropColours(names: string[]): Map<string, string> {
  const further = [...new Set(names)].filter((name) => !Object.hasOwn(CROPS, name));
  const colourOf = (name: string): string => FURTHER_CROPS[further.indexOf(name) % FURTHER_CROPS.length] ?? CROPS[name]!;
  return new Map(names.map((name) => [name, colourOf(name)]));
}

/** Colour of a vehicle, as `--vehicle` in page.css. */
export function vehicleColour(number: number): string {
  return VEHICLES[number % VEHICLES.length] ?? "#0072b2";
}

/** Colour of a vehicle on a canvas: lighter in the dark theme. */
export function lifted(number: number): string {
  return `color-mix(in srgb, white ${themed("lift")}, ${vehicleColour(number)})`;
}

/** Limit of a disease's value below which a plant is sick, and the colour of its ring. */
export const SICK = 0.75;
export const RING = "#a3123a";

/** Colours of a layer from 0 to its scale. */
export function ramp(layer: LayerName, field: FieldInfo | undefined): string[] {
  if (layer === "acquisition") return ACQUIRE;
  if (layer.startsWith("uncertainty/")) return UNSURE;
  if (field?.colours.length) return field.colours;
  return field?.kind === "disease" ? HEALTH : field?.kind === "measured" ? MEASURED : WATER;
}

type Rgb = [number, number, number];

const rgb = (colour: string): number[] => [1, 3, 5].map((k) => parseInt(colour.slice(k, k + 2), 16));

/** A ramp in `count` levels. */
export function levels(colours: string[], count: number): Rgb[] {
  return Array.from({ length: count }, (_, level) => {
    const place = (level / (count - 1)) * (colours.length - 1);
    const below = Math.min(Math.floor(place), colours.length - 2);
    const [from, to] = [rgb(colours[below]!), rgb(colours[below + 1]!)];
    return from.map((value, k) => Math.round(value + (to[k]! - value) * (place - below))) as Rgb;
  });
}

export function css([red, green, blue]: Rgb): string {
  return `rgb(${red} ${green} ${blue})`;
}

/** Colour as a number in the 32-bit view of an image's data. */
export function pixel([red, green, blue]: Rgb, alpha: number): number {
  return (alpha << 24) | (blue << 16) | (green << 8) | red;
}

const theme = getComputedStyle(document.documentElement);

/** Redraw when the reader's theme becomes dark or light. */
export function onTheme(redraw: () => void): void {
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
}

/** Variable of page.css, in the reader's present dark or light theme. */
export function themed(name: string): string {
  return theme.getPropertyValue(`--${name}`).trim();
}
