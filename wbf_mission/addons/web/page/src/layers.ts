// Layer panel of the map: field, layer, overlays, and the colour key.
import { RING, colourAt, cropColour, css, ramp } from "./colours.js";
import { checkbox, element, segments } from "./dom.js";
import { figureOf, layerName, layerTitle, type Choice } from "./map.js";
import type { Model } from "./model.js";
import type { Picture } from "./tiles.js";

const KINDS: [Choice["kind"], string][] = [
  ["value", "Estimate"],
  ["uncertainty", "Uncertainty"],
  ["truth", "Truth"],
  ["acquisition", "Acquisition"],
  ["none", "None"],
];
const DRAWN: ["crops" | "plans" | "trails" | "readings" | "decisions", string][] = [
  ["crops", "Crops"],
  ["plans", "Plans and fences"],
  ["trails", "Trails"],
  ["readings", "Camera readings"],
  ["decisions", "Decisions"],
];

export class LayerPanel {
  readonly element = element("div", { class: "layer-panel" });
  readonly legend = element("div", { class: "legend" });
  private shape = "";
  private told = "";

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
    const kinds = KINDS.filter(([kind]) => has(kind));
    const there = {
      crops: !!model.run?.farm,
      plans: true,
      trails: true,
      readings: fields.length > 0,
      decisions: this.models.some((one) => one.decisions.length),
    };
    const drawn = DRAWN.filter(([name]) => there[name]);
    const shape = [fields.map((field) => field.name), kinds, drawn, this.choice.field, this.choice.compare].join();
    if (shape !== this.shape) this.build(kinds, drawn);
    this.shape = shape;
    this.showLegend(picture);
  }

  private build(kinds: [Choice["kind"], string][], drawn: typeof DRAWN): void {
    const { choice, changed } = this;
    const focused = (document.activeElement as HTMLInputElement | null)?.value;
    const fields = this.models[0]!.fields.map(({ name, title }): [string, string] => [name, title]);
    const parts: HTMLElement[] = [];
    if (fields.length)
      parts.push(
        segments("Field", fields, choice.field, (value) => {
          choice.field = value;
          changed();
        }),
      );
    if (kinds.length > 1) {
      parts.push(
        segments("Layer", kinds, kinds.some(([kind]) => kind === choice.kind) ? choice.kind : "none", (value) => {
          choice.kind = value as Choice["kind"];
          changed();
        }),
      );
      const opacity = element("input", {
        type: "range",
        min: "0.1",
        max: "1",
        step: "0.05",
        value: String(choice.opacity),
      });
      opacity.addEventListener("input", () => {
        choice.opacity = Number(opacity.value);
        changed();
      });
      parts.push(element("label", { class: "opacity" }, element("span", {}, "Opacity"), opacity));
    }
    const boxes = element("div", { class: "checks" });
    if (kinds.some(([kind]) => kind === "truth"))
      boxes.append(
        checkbox("Compare with truth", choice.compare, (on) => {
          choice.compare = on;
          if (on && (choice.kind === "truth" || choice.kind === "none")) choice.kind = "value";
          changed();
        }),
      );
    for (const [name, label] of drawn)
      boxes.append(
        checkbox(label, choice[name], (on) => {
          choice[name] = on;
          changed();
        }),
      );
    parts.push(boxes);
    const inside = this.element.contains(document.activeElement);
    this.element.replaceChildren(...parts);
    if (inside) for (const input of this.element.querySelectorAll("input")) if (input.value === focused) input.focus();
  }

  private showLegend(picture: Picture | null): void {
    const { crops, readings, field } = this.choice;
    const key = JSON.stringify([
      picture?.layer,
      picture?.scale,
      crops,
      readings,
      field,
      this.models[0]?.run?.farm?.name,
    ]);
    if (key === this.told) return;
    this.told = key;
    const parts = [...(picture ? this.scaleOf(picture) : []), this.keys()];
    this.legend.replaceChildren(...parts);
    this.legend.hidden = !picture && !this.legend.querySelector(".key");
  }

  /** Colour key of a layer. */
  private scaleOf({ layer, scale }: Picture): HTMLElement[] {
    const model = this.models[0]!;
    const field = model.fieldOf(layer);
    const colours = ramp(layer, field);
    const stops = Array.from({ length: 13 }, (_, k) => css(colourAt(colours, k / 12)));
    const bar = element("div", { class: "ramp", "aria-hidden": "true" });
    bar.style.background = `linear-gradient(to right, ${stops.join(", ")})`;
    const sick = field?.kind === "disease" && !layer.startsWith("uncertainty/");
    const words = sick
      ? ["lost", "infected", "healthy"]
      : [0, 0.5, 1].map((part) => figureOf(model, layer, part * scale));
    const title = element("div", { class: "title" }, layerTitle(model, layer));
    if (field?.unit && !sick) title.append(element("span", { class: "unit" }, ` in ${field.unit}`));
    return [title, bar, element("div", { class: "ends" }, ...words.map((word) => element("span", {}, word)))];
  }

  /** Keys of crops, and of the rings around sick plants. */
  private keys(): HTMLElement {
    const { choice } = this;
    const patches = this.models[0]?.run?.farm?.patches ?? [];
    const crops = [...new Set(patches.map((patch) => patch.crop))];
    const keys = element("ul", { class: "keys" });
    const add = (name: string, colour: string, kind: string): void => {
      const swatch = element("span", { class: kind, "aria-hidden": "true" });
      swatch.style.setProperty("--key", colour);
      keys.append(element("li", { class: "key" }, swatch, name));
    };
    if (choice.crops) for (const crop of crops) add(crop, cropColour(crop, crops), "crop");
    if (choice.readings && this.models[0]?.field(choice.field)?.kind === "disease") add("seen sick", RING, "ring");
    return keys;
  }
}
