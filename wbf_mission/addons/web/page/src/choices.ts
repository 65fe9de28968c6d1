// Form for the options of a plan, built from their descriptions.
import { checkbox, element } from "./dom.js";
import { capital } from "./text.js";

export interface OptionInfo {
  key: string;
  label: string;
  help: string;
  panel: string;
  unit: string;
  low: number | null;
  high: number | null;
  kind: string;
  needs: string;
  not_with: string[];
  needs_fleet: boolean;
  /** Whether several choices may be given, separated by commas. */
  several: boolean;
  type: "flag" | "whole" | "number" | "text";
  choices: string[];
  default: string;
  first: boolean;
}

export type Value = string | number | boolean;
export type Values = Record<string, Value>;
/** Parameters of planners and policies by name, with defaults in words. */
export type Parameters = Record<string, Record<string, Record<string, string>>>;

const LIST_AT_MOST = 40;

export class Choices {
  readonly element = element("div", { class: "choices" });
  private readonly rows = new Map<string, { row: HTMLElement; input: HTMLElement }>();

  constructor(
    private readonly options: OptionInfo[],
    private readonly parameters: Parameters,
    public values: Values,
    private readonly changed: () => void,
  ) {
    this.build();
  }

  /** Show other values. */
  take(values: Values): void {
    this.values = values;
    this.element.replaceChildren();
    this.build();
  }

  private build(): void {
    const { options } = this;
    const panels = [...new Set(options.map(({ panel }) => panel))];
    this.element.append(...options.filter(({ first }) => first).map((one) => this.row(one)));
    for (const panel of panels) {
      const rows = options.filter((one) => !one.first && one.panel === panel).map((one) => this.row(one));
      if (rows.length) this.element.append(element("details", {}, element("summary", {}, `More: ${panel.toLowerCase()}`), ...rows));
    }
    this.fit();
  }

  private set(key: string, value: Value | null): void {
    if (value === null || value === "") delete this.values[key];
    else this.values[key] = value;
    this.fit();
    this.changed();
  }

  private row(one: OptionInfo): HTMLElement {
    if (one.type === "flag") {
      const box = checkbox(capital(one.label), Boolean(this.values[one.key] ?? one.default === "yes"), (on) => this.set(one.key, on));
      const row = element("div", { class: "choice flag" }, box, element("small", {}, one.help));
      this.rows.set(one.key, { row, input: box.querySelector("input")! });
      return row;
    }
    const id = `choice-${one.key}`;
    const input = one.choices.length && !one.several ? this.select(one, id) : this.input(one, id);
    const list = input instanceof HTMLInputElement && one.choices.length ? [element("datalist", { id: `${id}-list` }, ...one.choices.map((value) => element("option", { value })))] : [];
    if (list.length) input.setAttribute("list", `${id}-list`);
    const unit = one.unit ? `, ${one.unit}` : "";
    const row = element("div", { class: "choice" }, element("label", { for: id }, capital(one.label) + unit), input, ...list, element("small", { id: `${id}-help` }, one.help));
    input.setAttribute("aria-describedby", `${id}-help`);
    if (one.kind in this.parameters) row.append(element("div", { class: "parameters" }));
    this.rows.set(one.key, { row, input });
    return row;
  }

  private select(one: OptionInfo, id: string): HTMLSelectElement {
    const given = String(this.values[one.key] ?? "");
    const [name] = given.split(":");
    const none = element("option", { value: "" }, one.choices.includes(one.default) ? `${one.default} (default)` : one.default.slice(0, LIST_AT_MOST) || "none");
    const names = one.choices.includes(name!) || !name ? one.choices : [...one.choices, name];
    const select = element("select", { id }, none, ...names.map((choice) => element("option", { value: choice }, choice)));
    select.value = name ?? "";
    select.addEventListener("change", () => this.set(one.key, select.value));
    return select;
  }

  private input(one: OptionInfo, id: string): HTMLInputElement {
    const numeric = one.type !== "text";
    const input = element("input", { id, type: numeric ? "number" : "text", placeholder: one.default, autocomplete: "off" });
    if (numeric) {
      if (one.low !== null) input.min = String(one.low);
      if (one.high !== null) input.max = String(one.high);
      input.step = one.type === "whole" ? "1" : "any";
    }
    input.value = String(this.values[one.key] ?? "");
    input.addEventListener("input", () => {
      // The program refuses a value out of range, with a message.
      if (input.validity.badInput) return;
      this.set(one.key, numeric && input.value !== "" ? Number(input.value) : input.value.trim());
    });
    return input;
  }

  /** Enable the options with an effect, and show the parameters of the chosen planner or policy. */
  private fit(): void {
    const fleet = Number(this.values["vehicles"] ?? 1) > 1;
    for (const one of this.options) {
      const { row, input } = this.rows.get(one.key)!;
      const off =
        one.not_with.some((key) => this.values[key] !== undefined) ||
        (one.needs !== "" && !this.values[one.needs]) ||
        (one.needs_fleet && !fleet);
      row.classList.toggle("off", off);
      input.toggleAttribute("disabled", off);
      if (one.kind in this.parameters) this.showParameters(one, row.querySelector(".parameters")!, off);
    }
  }

  /** Options to send, without those that have no effect. */
  get given(): Values {
    const on = ([key]: [string, Value]): boolean => !this.rows.get(key)?.row.classList.contains("off");
    return Object.fromEntries(Object.entries(this.values).filter(on));
  }

  private showParameters(one: OptionInfo, room: HTMLElement, off: boolean): void {
    const chosen = String(this.values[one.key] ?? one.default);
    const name = chosen.split(":")[0]!;
    const known = off ? {} : (this.parameters[one.kind]?.[name] ?? {});
    if (room.dataset["of"] === `${name} ${off}`) return;
    room.dataset["of"] = `${name} ${off}`;
    const given = new Map(chosen.slice(name.length + 1).split(",").filter(Boolean).map((pair) => pair.split("=") as [string, string]));
    const inputs = Object.entries(known).map(([parameter, usual]) => {
      const input = element("input", { type: "text", placeholder: usual, autocomplete: "off" });
      input.value = given.get(parameter) ?? "";
      input.addEventListener("change", () => {
        if (input.value.trim()) given.set(parameter, input.value.trim());
        else given.delete(parameter);
        const pairs = [...given].map(([key, value]) => `${key}=${value}`).join(",");
        this.set(one.key, pairs ? `${name}:${pairs}` : name);
      });
      return element("label", {}, parameter.replaceAll("_", " "), input);
    });
    room.replaceChildren(...(inputs.length ? [element("details", {}, element("summary", {}, `Parameters of ${name}`), ...inputs)] : []));
  }
}
