// List of a farm's shapes, with properties and corners of the selected one; usable without a map.
import { button, element } from "./dom.js";
import type { EditorHost } from "./editor.js";
import { crops } from "./editor.js";
import { capital } from "./text.js";
import { changed, withoutCorner, withoutShape, withRing, withShape, type Position, type Shape } from "./sketch.js";

const MOST_ROWS = 500;

export class Outline {
  readonly element = element("div", { class: "outline" });
  private tableOpen = false;

  constructor(private readonly host: EditorHost, private readonly crops: string[]) {}

  show(): void {
    const { sketch, selected } = this.host;
    const focus = (document.activeElement as HTMLElement | null)?.dataset["focus"];
    const list = element("ul", { class: "shapes" });
    for (const [k, shape] of sketch.shapes.entries()) {
      const what = shape.kind === "field" ? shape.crop : shape.kind;
      const label = button("", () => this.host.select(k === selected ? null : k), { "aria-pressed": String(k === selected), "data-focus": `shape-${k}` });
      label.append(element("span", { class: "name" }, shape.name || "(no name)"), element("span", { class: "what" }, what));
      list.append(element("li", {}, label));
    }
    const shape = selected === null ? undefined : sketch.shapes[selected];
    const places = this.places();
    this.element.replaceChildren(
      sketch.shapes.length ? list : element("p", { class: "empty" }, "Nothing is drawn yet: choose Field above, and click its corners on the map."),
      ...(selected !== null && shape ? [this.properties(selected, shape), this.table(selected, shape)] : []),
      ...(places ? [places] : []),
    );
    if (focus) this.element.querySelector<HTMLElement>(`[data-focus="${CSS.escape(focus)}"]`)?.focus();
  }

  private properties(number: number, shape: Shape): HTMLElement {
    const change = (part: Partial<Shape>, told: string): void => this.host.edit(withShape(this.host.sketch, number, part), told);
    const text = (label: string, value: string, take: (text: string) => void, more: Record<string, string> = {}): HTMLElement => {
      const input = element("input", { type: "text", maxlength: "200", "data-focus": label, ...more });
      input.value = value;
      input.addEventListener("change", () => take(input.value.trim()));
      return element("label", {}, label, input);
    };
    const metres = (label: string, value: number | null, take: (metres: number | null) => void): HTMLElement => {
      const input = element("input", { type: "number", min: "0", max: "1000", step: "any", "data-focus": label });
      input.value = value === null ? "" : String(value);
      input.addEventListener("change", () => input.checkValidity() && take(input.value === "" ? null : Number(input.value)));
      return element("label", {}, label, input);
    };
    const fields = [text("Name", shape.name, (name) => change({ name: name || shape.name }, "Renamed"))];
    if (shape.kind === "field") {
      const names = [...new Set([...this.crops, ...crops(this.host.sketch)])];
      const list = element("datalist", { id: "crops" }, ...names.map((name) => element("option", { value: name })));
      const take = (crop: string): void => change({ crop: crop.toLowerCase() || shape.crop }, "Crop changed");
      fields.push(text("Crop", shape.crop, take, { list: "crops" }), list);
      fields.push(text("Owner", shape.owner, (owner) => change({ owner: owner || shape.owner }, "Owner changed")));
    }
    if (shape.kind === "obstacle") fields.push(metres("Height, m", shape.height_m, (height_m) => change({ height_m: height_m ?? 0 }, "Height changed")));
    if (shape.kind !== "field") fields.push(metres("Margin, m", shape.margin_m, (margin_m) => change({ margin_m }, "Margin changed")));
    const remove = button("Delete", () => {
      this.host.select(null);
      this.host.edit(withoutShape(this.host.sketch, number), `${shape.name} deleted`);
    }, { class: "starts" });
    const legend = element("legend", {}, capital(shape.kind === "no-fly" ? "no-fly zone" : shape.kind));
    return element("fieldset", { class: "properties" }, legend, ...fields, remove);
  }

  private table(number: number, shape: Shape): HTMLElement {
    const count = shape.rings.reduce((sum, ring) => sum + ring.length, 0);
    const box = element("details", { class: "corners" }, element("summary", {}, `${count} corners as numbers`));
    box.open = this.tableOpen;
    const fill = (): void => {
      if (box.childElementCount > 1) return;
      box.append(...shape.rings.map((ring, r) => this.ring(number, ring, r)));
    };
    box.addEventListener("toggle", () => {
      this.tableOpen = box.open;
      if (box.open) fill();
    });
    if (box.open) fill();
    return box;
  }

  private ring(number: number, ring: Position[], r: number): HTMLElement {
    const name = r === 0 ? "Outline" : `Hole ${r}`;
    const rows = ring.slice(0, MOST_ROWS).map((corner, k) => {
      const set = (part: 0 | 1, value: number): void => {
        const moved = ring.map((one, n): Position => (n === k ? (part === 0 ? [value, one[1]] : [one[0], value]) : one));
        this.host.edit(withRing(this.host.sketch, number, r, moved), "Corner moved");
      };
      const next = ring[(k + 1) % ring.length]!;
      const middle: Position = [(corner[0] + next[0]) / 2, (corner[1] + next[1]) / 2];
      const add = (): void => this.host.edit(withRing(this.host.sketch, number, r, [...ring.slice(0, k + 1), middle, ...ring.slice(k + 1)]), "Corner added");
      const remove = (): void => this.host.edit(withoutCorner(this.host.sketch, number, r, k), "Corner deleted");
      return element("tr", {},
        element("th", { scope: "row" }, String(k + 1)),
        element("td", {}, degrees(corner[1], 75, `${name}, latitude of corner ${k + 1}`, `lat-${r}-${k}`, (value) => set(1, value))),
        element("td", {}, degrees(corner[0], 180, `${name}, longitude of corner ${k + 1}`, `lon-${r}-${k}`, (value) => set(0, value))),
        element("td", {},
          button("+", add, { class: "small", "aria-label": `Add a corner after corner ${k + 1}`, "data-focus": `add-${r}-${k}` }),
          button("−", remove, { class: "small", "aria-label": `Delete corner ${k + 1}`, "data-focus": `del-${r}-${k}` })),
      );
    });
    const head = element("tr", {}, ...["", "Latitude", "Longitude", ""].map((title) => (title ? element("th", { scope: "col" }, title) : element("td"))));
    const more = ring.length > MOST_ROWS ? [element("p", { class: "empty" }, `and ${ring.length - MOST_ROWS} more`)] : [];
    return element("div", {}, element("table", {}, element("caption", {}, name), element("thead", {}, head), element("tbody", {}, ...rows)), ...more);
  }

  /** Table of home and rally points. */
  private places(): HTMLElement | null {
    const { home, rally } = this.host.sketch;
    if (!home && !rally.length) return null;
    const row = (name: string, place: Position, set: (place: Position) => void, remove: () => void): HTMLElement =>
      element("tr", {}, element("th", { scope: "row" }, name),
        element("td", {}, degrees(place[1], 75, `${name}, latitude`, `${name}-lat`, (lat) => set([place[0], lat]))),
        element("td", {}, degrees(place[0], 180, `${name}, longitude`, `${name}-lon`, (lon) => set([lon, place[1]]))),
        element("td", {}, button("−", remove, { class: "small", "aria-label": `Delete ${name}` })));
    const edit = (change: Parameters<typeof changed>[1], told: string): void => this.host.edit(changed(this.host.sketch, change), told);
    const rows = rally.map((place, k) =>
      row(`Rally point ${k + 1}`, place, (to) => edit({ rally: rally.map((one, n) => (n === k ? to : one)) }, "Rally point moved"),
        () => edit({ rally: rally.filter((_, n) => n !== k) }, "Rally point deleted")));
    if (home) rows.unshift(row("Home", home, (to) => edit({ home: to }, "Home moved"), () => edit({ home: null }, "Home deleted")));
    return element("details", { class: "corners" }, element("summary", {}, "Home and rally points"), element("table", {}, element("tbody", {}, ...rows)));
  }
}

function degrees(value: number, most: number, label: string, focus: string, take: (value: number) => void): HTMLInputElement {
  const input = element("input", { type: "number", step: "any", min: String(-most), max: String(most), "aria-label": label, "data-focus": focus, required: "" });
  input.value = String(Number(value.toFixed(8)));
  input.addEventListener("change", () => input.checkValidity() && take(Number(input.value)));
  return input;
}
