// List of a farm's shapes, with properties and corners of the selected one; usable without a map.
import { button, datalist, element, table } from "./dom.js";
import { capital } from "./text.js";
import {
  changed, cropsOf, middleOf, withoutCorner, withoutShape, withRing, withShape, type Position, type Shape,
} from "./sketch.js";
import type { Studio } from "./studio.page.js";

const MOST_ROWS = 500;

export class Outline {
  readonly element = element("div", { class: "outline" });
  private tableOpen = false;

  constructor(private readonly studio: Studio, private readonly crops: string[]) {}

  show(): void {
    const { sketch, selected } = this.studio;
    const focus = (document.activeElement as HTMLElement | null)?.dataset["focus"];
    const list = element("ul", { class: "shapes" });
    for (const [k, shape] of sketch.shapes.entries()) {
      const what = shape.kind === "field" ? shape.crop : shape.kind;
      const label = button("", () => this.studio.select(k === selected ? null : k), { "aria-pressed": String(k === selected), "data-focus": `shape-${k}` });
      label.append(element("span", { class: "name" }, shape.name || "(no name)"), element("span", { class: "what" }, what));
      list.append(element("li", {}, label));
    }
    const shape = selected === null ? undefined : sketch.shapes[selected];
    const empty = "Nothing is drawn yet: choose Field above, and click its corners on the map.";
    this.element.replaceChildren(
      sketch.shapes.length ? list : element("p", { class: "empty" }, empty),
      ...(selected !== null && shape ? [this.properties(selected, shape), this.table(selected, shape)] : []),
      ...this.places(),
    );
    if (focus) this.element.querySelector<HTMLElement>(`[data-focus="${CSS.escape(focus)}"]`)?.focus();
  }

  private properties(number: number, shape: Shape): HTMLElement {
    const change = (part: Partial<Shape>, told: string): void => this.studio.edit(withShape(this.studio.sketch, number, part), told);
    const input = (label: string, attributes: Record<string, string>, take: (text: string) => void): HTMLElement => {
      const onchange = (made: HTMLInputElement): void => {
        if (made.checkValidity()) take(made.value.trim());
      };
      return element("label", {}, label, element("input", { "data-focus": label, onchange, ...attributes }));
    };
    const text = (value: string): Record<string, string> => ({ type: "text", maxlength: "200", value });
    const metres = (value: number | null): Record<string, string> => {
      return { type: "number", min: "0", max: "1000", step: "any", value: String(value ?? "") };
    };
    const { name, kind, crop, owner, height_m, margin_m } = shape;
    const fields = [input("Name", text(name), (to) => change({ name: to || name }, "Renamed"))];
    if (kind === "field") {
      const ofCrop = { ...text(crop), list: "crops" };
      fields.push(
        input("Crop", ofCrop, (to) => change({ crop: to.toLowerCase() || crop }, "Crop changed")),
        datalist("crops", [...new Set([...this.crops, ...cropsOf(this.studio.sketch)])]),
        input("Owner", text(owner), (to) => change({ owner: to || owner }, "Owner changed")),
      );
    }
    if (kind === "obstacle")
      fields.push(input("Height, m", metres(height_m), (to) => change({ height_m: Number(to) }, "Height changed")));
    if (kind !== "field") {
      const take = (to: string): void => change({ margin_m: to ? Number(to) : null }, "Margin changed");
      fields.push(input("Margin, m", metres(margin_m), take));
    }
    const remove = button("Delete", () => {
      this.studio.select(null);
      this.studio.edit(withoutShape(this.studio.sketch, number), `${shape.name} deleted`);
    }, { class: "starts" });
    const legend = element("legend", {}, capital(shape.kind === "no-fly" ? "no-fly zone" : shape.kind));
    return element("fieldset", { class: "properties" }, legend, ...fields, remove);
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
    const edit = (moved: Position[], told: string): void =>
      this.studio.edit(withRing(this.studio.sketch, number, r, moved), told);
    const small = (sign: string, label: string, act: () => void): HTMLElement =>
      button(sign, act, { class: "small", "aria-label": label, "data-focus": `${name}: ${label}` });
    const rows = ring.slice(0, MOST_ROWS).map((corner, k) => {
      const add = (): void => edit(ring.toSpliced(k + 1, 0, middleOf(ring, k)), "Corner added");
      const remove = (): void => this.studio.edit(withoutCorner(this.studio.sketch, number, r, k), "Corner deleted");
      return row(
        String(k + 1),
        corner,
        (part) => `${name}, ${part} of corner ${k + 1}`,
        (to) => edit(ring.with(k, to), "Corner moved"),
        small("+", `Add a corner after corner ${k + 1}`, add),
        small("−", `Delete corner ${k + 1}`, remove),
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
    const edit = (change: Parameters<typeof changed>[1], told: string): void =>
      this.studio.edit(changed(this.studio.sketch, change), told);
    const place = (name: string, at: Position, set: (place: Position) => void, remove: () => void): HTMLElement => {
      const without = button("−", remove, { class: "small", "aria-label": `Delete ${name}` });
      return row(name, at, (part) => `${name}, ${part}`, set, without);
    };
    const rows = rally.map((at, k) => {
      const set = (to: Position): void => edit({ rally: rally.with(k, to) }, "Rally point moved");
      const remove = (): void => edit({ rally: rally.toSpliced(k, 1) }, "Rally point deleted");
      return place(`Rally point ${k + 1}`, at, set, remove);
    });
    const setHome = (to: Position | null): void => edit({ home: to }, to ? "Home moved" : "Home deleted");
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
    const input = element("input", {
      type: "number",
      step: "any",
      min: String(-most),
      max: String(most),
      required: true,
      value: String(Number(value.toFixed(8))),
      "aria-label": labelOf(part),
      "data-focus": labelOf(part),
      onchange: (made) => {
        if (made.checkValidity()) take(Number(made.value));
      },
    });
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
