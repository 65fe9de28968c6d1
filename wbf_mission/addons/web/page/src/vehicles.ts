// Card of each vehicle, with its most important values.
import { vehicleColour } from "./colours.js";
import { button, element, fill, setText } from "./dom.js";
import type { Model } from "./model.js";
import type { Plan, VehicleInfo } from "./schema.js";
import { TOLD_S } from "./source.js";
import { capital, clock, fixed, metres, percent } from "./text.js";

const LOW_BATTERY = 0.25;
const POOR_LINK = 0.8;

const FIGURES = ["height", "speed", "heading", "item", "link", "heard", "flight", "plan"] as const;
type Figures<Value> = Record<(typeof FIGURES)[number], Value>;

class Card {
  private readonly dot = element("span", { class: "dot", "aria-hidden": "true", "--vehicle": this.colour });
  private readonly name = element("span", { class: "name" });
  private readonly phase = element("span", { class: "phase" });
  private readonly mode = element("span", { class: "mode" });
  private readonly battery = element("span", { class: "battery" });
  private readonly bar = element("span", { class: "bar", "aria-hidden": "true" });
  private readonly doing = element("p", { class: "doing" });
  private readonly parts = [this.dot, this.name, this.mode, this.battery, this.bar, this.phase];
  private readonly head = button(this.parts, this.chosen, { class: "head" });
  private readonly figures = Object.fromEntries(FIGURES.map((name) => [name, element("dd")])) as Figures<HTMLElement>;
  private readonly list = FIGURES.map((name) =>
    element("div", { class: name }, element("dt", {}, capital(name)), this.figures[name]),
  );
  private readonly body = element("div", { class: "body" }, this.doing, element("dl", {}, ...this.list));
  readonly element = element("li", { class: "card" }, this.head, this.body);

  constructor(
    readonly model: Model,
    readonly info: VehicleInfo,
    private readonly colour: string,
    private readonly chosen: () => void,
  ) {}

  show(time_s: number, selected: boolean): void {
    const { system_id } = this.info;
    const moment = this.model.vehicleAt(system_id, time_s);
    setText(this.name, this.model.nameOf(system_id));
    this.element.classList.toggle("selected", selected);
    this.head.setAttribute("aria-pressed", String(selected));
    this.element.classList.toggle("silent", !!moment?.silent);
    this.element.classList.toggle("low", (moment?.battery ?? 1) < LOW_BATTERY);
    if (!moment) return setText(this.phase, "not heard yet");
    setText(this.phase, moment.silent ? `no news for ${clock(moment.silent_s)}` : moment.phase);
    // Mode and arming are unknown without a log.
    setText(this.mode, moment.mode && `${moment.mode} · ${moment.armed ? "armed" : "disarmed"}`);
    setText(this.battery, moment.battery === null ? "" : percent(moment.battery));
    this.bar.style.setProperty("--part", `${100 * (moment.battery ?? 0)}%`);
    const plan = this.model.planAt(system_id, time_s);
    const { item, items } = moment;
    setText(this.doing, item === null ? "" : (plan?.items[item] ?? ""));
    const ago = `${Math.round(moment.silent_s)} s`;
    const known = (value: number | null, words: (value: number) => string): string =>
      value === null ? "–" : words(value);
    const told: Figures<string> = {
      height: known(moment.height_m, (height_m) => `${fixed(height_m, 1)} m`),
      speed: known(moment.speed_m_s, (speed_m_s) => `${speed_m_s.toFixed(1)} m/s`),
      heading: known(moment.heading_deg, (heading_deg) => `${Math.round(heading_deg)}°`),
      item: known(item, (number) => `${number + 1}${items === null ? "" : ` of ${items}`}`),
      link: percent(moment.link),
      heard: moment.silent_s < TOLD_S ? (moment.present ? "now" : "–") : `${ago} ${moment.present ? "ago" : "before"}`,
      flight: `${moment.day ? `day ${moment.day}, ` : ""}no. ${moment.flight}`,
      plan: plan ? planned(plan) : "–",
    };
    for (const name of FIGURES) setText(this.figures[name], told[name]);
    this.figures.link.classList.toggle("bad", (moment.link ?? 1) < POOR_LINK);
  }
}

function planned({ length_m, duration_s, coverage }: Plan): string {
  const parts = [
    length_m !== null && metres(length_m),
    duration_s !== null && clock(duration_s),
    coverage !== null && `sees ${percent(coverage)}`,
  ];
  return parts.filter(Boolean).join(", ") || "–";
}

export class Vehicles {
  readonly element = element("ul", { class: "cards" });
  selected: { model: Model; system_id: number } | null = null;
  private cards: Card[] = [];

  constructor(private readonly models: Model[], private readonly chosen: (model: Model, id: number | null) => void) {}

  /** Select a vehicle, or deselect the selected one. */
  select(model: Model, system_id: number): void {
    const same = this.selected?.model === model && this.selected.system_id === system_id;
    this.choose(model, same ? null : system_id);
  }

  choose(model: Model, system_id: number | null): void {
    this.selected = system_id === null ? null : { model, system_id };
    this.chosen(model, system_id);
  }

  show(time_s: number): void {
    const all = this.models.flatMap((model) => model.vehicles.map((info, k) => ({ model, info, k })));
    const ids = (vehicles: { info: VehicleInfo }[]): string => vehicles.map(({ info }) => info.system_id).join();
    if (ids(all) !== ids(this.cards) || !this.element.firstChild) {
      this.cards = all.map(({ model, info, k }) => {
        return new Card(model, info, vehicleColour(k), () => this.select(model, info.system_id));
      });
      fill(this.element, this.cards.map((card) => card.element), "No vehicle has been heard yet.");
    }
    for (const card of this.cards) {
      const { model, system_id } = this.selected ?? {};
      card.show(time_s, card.model === model && card.info.system_id === system_id);
    }
  }
}

export function scoreLine(model: Model, time_s: number): string {
  const score = model.scoreAt(time_s);
  return score === null ? "" : `Score ${fixed(score, 3)}`;
}
