// Layer panel of the map: field, layer, overlays, and the colour key.
import { RING, cropColours, ramp } from "./colours.js";
import { checkbox, element, segments, Shown, slider } from "./dom.js";
import { KINDS, layerName, type Choice } from "./map.js";
import type { Model } from "./model.js";
import { capital } from "./text.js";
import { kindName, type Picture } from "./tiles.js";

const OVERLAYS = {
  crops: "Crops",
  plans: "Plans and fences",
  trails: "Trails",
  readings: "Camera readings",
  decisions: "Decisions",
};
type Overlay = keyof typeof OVERLAYS;

export class LayerPanel {
  readonly element = element("div", { class: "layer-panel" });
  readonly legend = element("div", { class: "legend" });
  private readonly shape = new Shown();
  private readonly told = new Shown();

  constructor(
    private readonly models: Model[],
    private readonly choice: Choice,
    private readonly changed: () => void,
  ) {}

  /** Update the panel to the available layers. */
  show(picture: Picture | null): void {
    const model = this.models[0]!;
    const fields = model.fields;
    const has = (kind: Choice["kind"]): boolean => {
      const name = layerName({ ...this.choice, kind });
      return !name || this.models.some((one) => one.tiles.has(name));
    };
    const kinds = KINDS.filter(has);
    const decides = this.models.some((one) => one.decisions.length);
    const lacks: Partial<Choice> = { crops: !model.run?.farm, readings: !fields.length, decisions: !decides };
    const overlays = (Object.keys(OVERLAYS) as Overlay[]).filter((name) => !lacks[name]);
    const names = fields.map((field) => field.name);
    const { field, compare } = this.choice;
    if (this.shape.changes(names, kinds, overlays, field, compare)) this.build(kinds, overlays);
    this.showLegend(picture);
  }

  private build(kinds: Choice["kind"][], overlays: Overlay[]): void {
    const { choice } = this;
    const change = (part: Partial<Choice>): void => {
      Object.assign(choice, part);
      this.changed();
    };
    // All checkboxes have the value "on".
    const nameOf = (input: HTMLInputElement): string => `${input.value} ${input.labels?.[0]?.textContent}`;
    const focused = document.activeElement instanceof HTMLInputElement ? nameOf(document.activeElement) : "";
    const fields = this.models[0]!.fields.map(({ name, title }): [string, string] => [name, title]);
    const parts: HTMLElement[] = [];
    if (fields.length) parts.push(segments("Field", fields, choice.field, (field) => change({ field })));
    if (kinds.length > 1) {
      const names = kinds.map((kind): [string, string] => [kind, capital(kindName(kind))]);
      const kind = kinds.includes(choice.kind) ? choice.kind : "none";
      parts.push(segments("Layer", names, kind, (chosen) => change({ kind: chosen as Choice["kind"] })));
      const range = { min: 0.1, max: 1, step: 0.05, value: choice.opacity };
      const opacity = slider(range, (value) => change({ opacity: value }));
      parts.push(element("label", { class: "opacity" }, element("span", {}, "Opacity"), opacity));
    }
    const boxes = overlays.map((name) => checkbox(OVERLAYS[name], choice[name], (on) => change({ [name]: on })));
    const takeCompare = (compare: boolean): void => {
      const alone = choice.kind === "truth" || choice.kind === "none";
      change({ compare, ...(compare && alone ? { kind: "value" } : {}) });
    };
    if (kinds.includes("truth")) boxes.unshift(checkbox("Compare with truth", choice.compare, takeCompare));
    parts.push(element("div", { class: "checks" }, ...boxes));
    const inside = this.element.contains(document.activeElement);
    this.element.replaceChildren(...parts);
    if (inside) for (const input of this.element.querySelectorAll("input")) if (nameOf(input) === focused) input.focus();
  }

  private showLegend(picture: Picture | null): void {
    const { crops, readings, field } = this.choice;
    const model = this.models[0]!;
    const farm = model.run?.farm;
    if (!this.told.changes(picture?.layer, picture?.scale, crops, readings, field, farm?.name)) return;
    const colours = cropColours((crops && farm?.patches.map(({ crop }) => crop)) || []);
    const keys = [...colours].map(([crop, colour]) => keyOf(crop, colour, "crop"));
    if (readings && model.field(field)?.kind === "disease") keys.push(keyOf("seen sick", RING, "ring"));
    this.legend.replaceChildren(...(picture ? scaleOf(picture) : []), element("ul", { class: "keys" }, ...keys));
  }
}

function keyOf(name: string, colour: string, kind: "crop" | "ring"): HTMLElement {
  const swatch = element("span", { class: kind, "aria-hidden": "true", "--key": colour });
  return element("li", { class: "key" }, swatch, name);
}

/** Colour key of a layer. */
function scaleOf(picture: Picture): HTMLElement[] {
  const { layer, field, scale, title } = picture;
  const bar = element("div", { class: "ramp", "aria-hidden": "true", "--colours": ramp(layer, field).join(", ") });
  const sick = field?.kind === "disease" && !layer.startsWith("uncertainty/");
  const words = sick ? ["lost", "infected", "healthy"] : [0, 0.5, 1].map((part) => picture.figure(part * scale));
  const unit = field?.unit && !sick ? element("span", { class: "unit" }, ` in ${field.unit}`) : null;
  const ends = words.map((word) => element("span", {}, word));
  return [element("div", { class: "title" }, title, unit), bar, element("div", { class: "ends" }, ...ends)];
}
