// Form for the options of a plan, built from their descriptions.
import { checkbox, datalist, element, entry, find } from "./dom.js";
import type { Options } from "./desk.js";
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
  private readonly element = find(".choices");

  values: Values = { ...this.given.start.options };

  constructor(private readonly given: Options, private readonly changed: () => void) {
    this.take(this.values);
  }

  take(values: Values): void {
    this.values = values;
    const rows = (isIn: (one: OptionInfo) => boolean): HTMLElement[] =>
      this.given.options.filter(isIn).map((one) => this.row(one));
    const first = rows((one) => one.first);
    const panels = [...new Set(this.given.options.filter((one) => !one.first).map(({ panel }) => panel))];
    const more = panels.map((panel) => {
      const summary = element("summary", {}, `More: ${panel.toLowerCase()}`);
      return element("details", {}, summary, ...rows((one) => !one.first && one.panel === panel));
    });
    this.element.replaceChildren(...first, ...more);
    this.fit();
  }

  private set(key: string, value: Value | null): void {
    if (value === null || value === "") delete this.values[key];
    else this.values[key] = value;
    this.fit();
    this.changed();
  }

  private row(one: OptionInfo): HTMLElement {
    const label = capital(one.label);
    if (one.type === "flag") {
      const on = Boolean(this.values[one.key] ?? one.default === "yes");
      const box = checkbox(label, on, (now) => this.set(one.key, now));
      return element("div", { class: "choice flag", "data-key": one.key }, box, element("small", {}, one.help));
    }
    const id = `choice-${one.key}`;
    const isSelect = one.choices.length > 0 && !one.several;
    const input = isSelect ? this.select(one, id) : this.input(one, id);
    input.setAttribute("aria-describedby", `${id}-help`);
    return element(
      "div",
      { class: "choice", "data-key": one.key },
      element("label", { for: id }, one.unit ? `${label}, ${one.unit}` : label),
      input,
      one.several && one.choices.length ? datalist(`${id}-list`, one.choices) : null,
      element("small", { id: `${id}-help` }, one.help),
      one.kind in this.given.parameters ? element("div", { class: "parameters" }) : null,
    );
  }

  private select(one: OptionInfo, id: string): HTMLSelectElement {
    const name = String(this.values[one.key] ?? "").split(":")[0]!;
    const known = one.choices.includes(one.default);
    const none = known ? `${one.default} (default)` : one.default.slice(0, LIST_AT_MOST) || "none";
    const names = one.choices.includes(name) || !name ? one.choices : [...one.choices, name];
    const choices = ["", ...names].map((choice) => new Option(choice || none, choice, false, choice === name));
    return element("select", { id, onchange: ({ value }) => this.set(one.key, value) }, ...choices);
  }

  private input(one: OptionInfo, id: string): HTMLInputElement {
    const isText = one.type === "text";
    const range = { min: one.low ?? "", max: one.high ?? "", step: one.type === "whole" ? 1 : "any" };
    return element("input", {
      id,
      ...range,
      type: isText ? "text" : "number",
      list: one.choices.length > 0 && `${id}-list`,
      placeholder: one.default,
      autocomplete: "off",
      value: this.values[one.key] ?? "",
      oninput: ({ value, validity }) => {
        // The program refuses a value out of range, with a message.
        if (!validity.badInput) this.set(one.key, isText || !value ? value.trim() : Number(value));
      },
    });
  }

  /** Enable the options with an effect, and show the parameters of the chosen planner or policy. */
  private fit(): void {
    const fleet = Number(this.values["vehicles"] ?? 1) > 1;
    for (const one of this.given.options) {
      const row = this.element.querySelector(`[data-key=${one.key}]`)!;
      const off =
        one.not_with.some((key) => this.values[key] !== undefined) ||
        (one.needs !== "" && !this.values[one.needs]) ||
        (one.needs_fleet && !fleet);
      row.classList.toggle("off", off);
      row.querySelector("input, select")!.toggleAttribute("disabled", off);
      if (one.kind in this.given.parameters) this.showParameters(one, row.querySelector(".parameters")!, off);
    }
  }

  /** Options to send, without those that have no effect. */
  get effective(): Values {
    const on = ([key]: [string, Value]): boolean => !this.element.querySelector(`[data-key=${key}].off`);
    return Object.fromEntries(Object.entries(this.values).filter(on));
  }

  private showParameters(one: OptionInfo, room: HTMLElement, off: boolean): void {
    const chosen = String(this.values[one.key] ?? one.default);
    const name = chosen.split(":")[0]!;
    if (room.dataset["of"] === `${name} ${off}`) return;
    room.dataset["of"] = `${name} ${off}`;
    const pairs = chosen.slice(name.length + 1).split(",").filter(Boolean);
    const given = new Map(pairs.map((pair) => pair.split("=") as [string, string]));
    const known = off ? {} : (this.given.parameters[one.kind]?.[name] ?? {});
    const inputs = Object.entries(known).map(([parameter, placeholder]) => {
      const take = (text: string): void => {
        if (text) given.set(parameter, text);
        else given.delete(parameter);
        const now = [...given].map((pair) => pair.join("=")).join(",");
        this.set(one.key, now ? `${name}:${now}` : name);
      };
      const input = entry({ placeholder, value: given.get(parameter) ?? "" }, take);
      return element("label", {}, parameter.replaceAll("_", " "), input);
    });
    const summary = element("summary", {}, `Parameters of ${name}`);
    room.replaceChildren(...(inputs.length ? [element("details", {}, summary, ...inputs)] : []));
  }
}
