// Card of each vehicle, with its most important values.
import { vehicleColour } from "./colours.js";
import { element, setText } from "./dom.js";
import { TOLD_S } from "./heart.js";
import type { Model, Moment } from "./model.js";
import type { VehicleInfo } from "./schema.js";
import { clock, fixed, metres, percent } from "./text.js";

const LOW_BATTERY = 0.25;
const POOR_LINK = 0.8;
/** Maximum number of vehicles with open cards; above it, only the selected one's is open. */
const FEW = 2;

type Figures = Record<"height" | "speed" | "heading" | "item" | "link" | "heard" | "flight" | "plan", HTMLElement>;

class Card {
  readonly element: HTMLElement;
  private readonly name = element("span", { class: "name" });
  private readonly phase = element("span", { class: "phase" });
  private readonly mode = element("span", { class: "mode" });
  private readonly battery = element("span", { class: "battery" });
  private readonly bar = element("span", { class: "bar", "aria-hidden": "true" });
  private readonly doing = element("p", { class: "doing" });
  private readonly figures: Figures;

  constructor(
    private readonly model: Model,
    readonly info: VehicleInfo,
    number: number,
    chosen: () => void,
  ) {
    const dot = element("span", { class: "dot", "aria-hidden": "true" });
    dot.style.setProperty("--vehicle", vehicleColour(number));
    const names = {
      height: "Height",
      speed: "Speed",
      heading: "Heading",
      item: "Item",
      link: "Link",
      heard: "Heard",
      flight: "Flight",
      plan: "Plan",
    };
    const list = element("dl");
    this.figures = Object.fromEntries(
      Object.entries(names).map(([name, label]) => {
        const value = element("dd");
        list.append(element("div", { class: name }, element("dt", {}, label), value));
        return [name, value];
      }),
    ) as Figures;
    const head = element("button", { type: "button", class: "head", "aria-pressed": "false" });
    head.append(dot, this.name, this.mode, this.battery, this.bar, this.phase);
    head.addEventListener("click", chosen);
    this.element = element("li", { class: "card" }, head, element("div", { class: "body" }, this.doing, list));
  }

  show(moment: Moment | null, time_s: number, selected: boolean): void {
    setText(this.name, this.model.nameOf(this.info.system_id));
    this.element.classList.toggle("selected", selected);
    this.element.firstElementChild!.setAttribute("aria-pressed", String(selected));
    this.element.classList.toggle("silent", !!moment?.silent);
    this.element.classList.toggle("low", (moment?.battery ?? 1) < LOW_BATTERY);
    if (!moment) {
      setText(this.phase, "not heard yet");
      return;
    }
    setText(this.phase, moment.silent ? `no news for ${clock(moment.silent_s)}` : moment.phase);
    // Mode and arming are unknown without a log.
    setText(this.mode, moment.mode && `${moment.mode} · ${moment.armed ? "armed" : "disarmed"}`);
    setText(this.battery, moment.battery === null ? "" : percent(moment.battery));
    this.bar.style.setProperty("--part", `${100 * (moment.battery ?? 0)}%`);
    const plan = this.model.planAt(this.info.system_id, time_s);
    const { item, items } = moment;
    setText(this.doing, item === null ? "" : (plan?.items[item] ?? ""));
    const { height, speed, heading, item: at, link, heard, flight, plan: planned } = this.figures;
    setText(height, moment.height_m === null ? "–" : `${fixed(moment.height_m, 1)} m`);
    setText(speed, moment.speed_m_s === null ? "–" : `${moment.speed_m_s.toFixed(1)} m/s`);
    setText(heading, moment.heading_deg === null ? "–" : `${Math.round(moment.heading_deg)}°`);
    setText(at, item === null ? "–" : `${item + 1}${items === null ? "" : ` of ${items}`}`);
    setText(link, percent(moment.link));
    link.classList.toggle("bad", (moment.link ?? 1) < POOR_LINK);
    const ago = `${Math.round(moment.silent_s)} s`;
    if (moment.present) setText(heard, moment.silent_s < TOLD_S ? "now" : `${ago} ago`);
    else setText(heard, moment.silent_s < TOLD_S ? "–" : `${ago} before`);
    setText(flight, `${moment.day ? `day ${moment.day}, ` : ""}no. ${moment.flight}`);
    const parts =
      plan &&
      [
        plan.length_m !== null && metres(plan.length_m),
        plan.duration_s !== null && clock(plan.duration_s),
        plan.coverage !== null && `sees ${percent(plan.coverage)}`,
      ].filter(Boolean);
    setText(planned, parts?.join(", ") || "–");
  }
}

export class Vehicles {
  readonly element = element("ul", { class: "cards" });
  selected: { model: Model; system_id: number } | null = null;
  private cards: Card[] = [];

  constructor(
    private readonly models: Model[],
    private readonly chosen: (model: Model, id: number | null) => void,
  ) {}

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
    const all = this.models.flatMap((model) => (model.run?.vehicles ?? []).map((info, k) => ({ model, info, k })));
    if (
      all.length !== this.cards.length ||
      all.some(({ info }, k) => this.cards[k]!.info.system_id !== info.system_id)
    ) {
      this.cards = all.map(({ model, info, k }) => new Card(model, info, k, () => this.select(model, info.system_id)));
      this.element.replaceChildren(...this.cards.map((card) => card.element));
      this.element.classList.toggle("many", all.length > FEW);
    }
    all.forEach(({ model, info }, k) => {
      const selected = this.selected?.model === model && this.selected.system_id === info.system_id;
      this.cards[k]!.show(model.vehicleAt(info.system_id, time_s), time_s, selected);
    });
    if (!all.length && !this.element.firstChild)
      this.element.append(element("li", { class: "empty" }, "No vehicle has been heard yet."));
  }
}

/** Score in one line. */
export function scoreLine(model: Model, time_s: number): string {
  const score = model.scoreAt(time_s);
  return score === null ? "" : `Score ${fixed(score, 3)}`;
}
