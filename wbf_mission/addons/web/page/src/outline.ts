// List of a farm's shapes, with properties and corners of the selected one; usable without a map.
import { button, datalist, element, entry, find, table } from "./dom.js";
import { capital } from "./text.js";
import { cropsOf, middleOf, withShape, type Kind, type Position, type Shape } from "./sketch.js";
import type { Studio } from "./studio.page.js";

const MOST_ROWS = 500;
const TEXT = { maxlength: 200 };
const METRES = { type: "number", min: 0, max: 1000, step: "any" };

type Property = string | number | null;
type Input = [
  name: "name" | "crop" | "owner" | "height_m" | "margin_m",
  label: string,
  kinds: Kind[],
  attributes: Record<string, string | number>,
  read: (text: string, old: Property) => Property,
  told: string,
];
/** Inputs of the properties of some kinds of shapes. */
const INPUTS: Input[] = [
  ["name", "Name", ["field", "obstacle", "no-fly"], TEXT, (text, old) => text || old, "Renamed"],
  ["crop", "Crop", ["field"], { ...TEXT, list: "crops" }, (text, old) => text.toLowerCase() || old, "Crop changed"],
  ["owner", "Owner", ["field"], TEXT, (text, old) => text || old, "Owner changed"],
  ["height_m", "Height, m", ["obstacle"], METRES, Number, "Height changed"],
  ["margin_m", "Margin, m", ["obstacle", "no-fly"], METRES, (text) => (text ? Number(text) : null), "Margin changed"],
];

export class Outline {
  private readonly element = find(".outline");
  private tableOpen = false;

  constructor(private readonly studio: Studio, private readonly crops: string[]) {}

  show(): void {
    const { sketch, selected } = this.studio;
    const focus = (document.activeElement as HTMLElement | null)?.dataset["focus"];
    const items = sketch.shapes.map(({ name, kind, crop }, k) => {
      const what = element("span", { class: "what" }, kind === "field" ? crop : kind);
      const label = [element("span", { class: "name" }, name || "(no name)"), what];
      const select = (): void => this.studio.select(k === selected ? null : k);
      const attributes = { "aria-pressed": String(k === selected), "data-focus": `shape-${k}` };
      return element("li", {}, button(label, select, attributes));
    });
    const shape = selected === null ? undefined : sketch.shapes[selected];
    const empty = "Nothing is drawn yet: choose Field above, and click its corners on the map.";
    this.element.replaceChildren(
      items.length ? element("ul", { class: "shapes" }, ...items) : element("p", { class: "empty" }, empty),
      ...(selected !== null && shape ? [this.properties(selected, shape), this.table(selected, shape)] : []),
      ...this.places(),
    );
    if (focus) this.element.querySelector<HTMLElement>(`[data-focus="${CSS.escape(focus)}"]`)?.focus();
  }

  private properties(number: number, shape: Shape): HTMLElement {
    const { kind } = shape;
    const inputs = INPUTS.filter(([, , kinds]) => kinds.includes(kind));
    const labels = inputs.map(([name, label, , attributes, read, told]) => {
      const change = (text: string): Partial<Shape> => ({ [name]: read(text, shape[name]) });
      const take = (text: string): void => this.studio.edit(withShape(this.studio.sketch, number, change(text)), told);
      return element("label", {}, label, entry({ value: shape[name] ?? "", "data-focus": label, ...attributes }, take));
    });
    const remove = (): void => {
      this.studio.select(null);
      this.studio.change({ shapes: this.studio.sketch.shapes.toSpliced(number, 1) }, `${shape.name} deleted`);
    };
    return element(
      "fieldset",
      { class: "properties" },
      element("legend", {}, capital(kind === "no-fly" ? "no-fly zone" : kind)),
      ...labels,
      datalist("crops", [...new Set([...this.crops, ...cropsOf(this.studio.sketch)])]),
      button("Delete", remove, { class: "starts" }),
    );
  }

  private table(number: number, shape: Shape): HTMLElement {
    const summary = element("summary", {}, `${shape.rings.flat().length} corners as numbers`);
    const fill = (box: HTMLDetailsElement): void => {
      this.tableOpen = box.open;
      if (box.open && box.childElementCount === 1) box.append(...shape.rings.map((ring, r) => this.ring(number, ring, r)));
    };
    const box = element("details", { class: "corners", open: this.tableOpen, ontoggle: fill }, summary);
    fill(box);
    return box;
  }

  private ring(number: number, ring: Position[], r: number): HTMLElement {
    const name = r === 0 ? "Outline" : `Hole ${r}`;
    const edit = (moved: Position[], told: string): void => this.studio.setRing(number, r, moved, told);
    const small = (sign: string, label: string, act: () => void): HTMLElement =>
      button(sign, act, { class: "small", "aria-label": label, "data-focus": `${name}: ${label}` });
    const rows = ring.slice(0, MOST_ROWS).map((corner, k) => {
      const add = (): void => edit(ring.toSpliced(k + 1, 0, middleOf(ring, k)), "Corner added");
      return row(
        String(k + 1),
        corner,
        (part) => `${name}, ${part} of corner ${k + 1}`,
        (to) => edit(ring.with(k, to), "Corner moved"),
        small("+", `Add a corner after corner ${k + 1}`, add),
        small("−", `Delete corner ${k + 1}`, () => this.studio.deleteCorner(number, r, k)),
      );
    });
    const made = table(["", "Latitude", "Longitude", ""], rows);
    made.prepend(element("caption", {}, name));
    const more = ring.length - MOST_ROWS;
    return element("div", {}, made, more > 0 ? element("p", { class: "empty" }, `and ${more} more`) : null);
  }

  /** Table of home and rally points. */
  private places(): HTMLElement[] {
    const { home, rally } = this.studio.sketch;
    if (!home && !rally.length) return [];
    const place = (name: string, at: Position, set: (place: Position) => void, remove: () => void): HTMLElement => {
      const without = button("−", remove, { class: "small", "aria-label": `Delete ${name}` });
      return row(name, at, (part) => `${name}, ${part}`, set, without);
    };
    const rows = rally.map((at, k) => {
      const set = (to: Position): void => this.studio.change({ rally: rally.with(k, to) }, "Rally point moved");
      const remove = (): void => this.studio.change({ rally: rally.toSpliced(k, 1) }, "Rally point deleted");
      return place(`Rally point ${k + 1}`, at, set, remove);
    });
    const setHome = (to: Position | null): void => this.studio.change({ home: to }, to ? "Home moved" : "Home deleted");
    if (home) rows.unshift(place("Home", home, setHome, () => setHome(null)));
    const summary = element("summary", {}, "Home and rally points");
    const made = element("table", {}, element("tbody", {}, ...rows));
    return [element("details", { class: "corners" }, summary, made)];
  }
}

/** Row of a position: its name, latitude and longitude to change, and buttons. */
function row(
  name: string,
  [lon, lat]: Position,
  labelOf: (part: string) => string,
  set: (place: Position) => void,
  ...buttons: HTMLElement[]
): HTMLElement {
  const degrees = (part: string, value: number, most: number, take: (value: number) => void): HTMLElement => {
    const range = { type: "number", step: "any", min: -most, max: most, required: true };
    const names = { "aria-label": labelOf(part), "data-focus": labelOf(part) };
    const input = entry({ ...range, ...names, value: Number(value.toFixed(8)) }, (text) => take(Number(text)));
    return element("td", {}, input);
  };
  return element(
    "tr",
    {},
    element("th", { scope: "row" }, name),
    degrees("latitude", lat, 75, (to) => set([lon, to])),
    degrees("longitude", lon, 180, (to) => set([to, lat])),
    element("td", {}, ...buttons),
  );
}
