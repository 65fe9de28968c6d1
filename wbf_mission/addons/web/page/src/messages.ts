// Panels of messages and of policy decisions.
import { SICK } from "./colours.js";
import { button, element, fill, setText, Shown, table } from "./dom.js";
import { upTo, type Model } from "./model.js";
import type { Decision } from "./schema.js";
import { capital, clock, figure, fixed, metres } from "./text.js";
import type { Time } from "./time.js";

const SHOWN = 100;
/** Highest severity number of a warning. */
export const WARNS = 4;
const SEVERITIES = ["Emergency", "Alert", "Critical", "Error", "Warning", "Notice", "Info", "Debug"];

/** Messages, newest first; warnings are also read aloud. */
export class Messages {
  readonly element = element("ol", { class: "messages", tabindex: "0", "aria-label": "Messages, the newest first" });
  readonly aloud = element("div", { class: "hidden", role: "status", "aria-live": "polite" });
  private readonly shown = new Shown();

  constructor(private readonly models: Model[]) {}

  show(time_s: number): void {
    const said = this.models.flatMap((model) =>
      model.said.map((one) => ({ model, one })).filter(({ one }) => one.time_s <= time_s),
    );
    if (this.models.length > 1) said.sort((a, b) => a.one.time_s - b.one.time_s);
    if (!this.shown.changes(said.length, said.at(-1)?.one.text)) return;
    const lines = said.slice(-SHOWN).map(({ model, one }) => {
      const who = one.system_id ? element("b", {}, `${model.nameOf(one.system_id)} `) : null;
      const grade = one.severity < WARNS ? "error" : one.severity === WARNS ? "warning" : "plain";
      const words = grade === "plain" ? one.text : `${SEVERITIES[one.severity]}: ${one.text}`;
      const text = element("span", { class: "text" }, who, words);
      return element("li", { class: grade }, element("time", {}, clock(one.time_s)), text);
    });
    fill(this.element, lines.toReversed(), "There are no messages yet.");
    const last = lines.at(-1);
    if (last && last.className !== "plain") setText(this.aloud, last.querySelector(".text")!.textContent!);
  }
}

/** Decisions of a policy; the open one is drawn on the map. In a recording, buttons step through them. */
export class Decisions {
  private readonly list = element("ol", { class: "decisions" });
  private readonly note = element("p", { class: "small" });
  private readonly steps = element(
    "div",
    { class: "steps", role: "group", "aria-label": "Go through the decisions" },
    button("Previous", () => this.step(-1)),
    button("Next", () => this.step(1)),
  );
  readonly element = element("div", { class: "decided" }, this.time && this.steps, this.note, this.list);
  private shown = new Shown();
  private chosen: number | null = null;

  constructor(
    private readonly models: Model[],
    private readonly open: (model: Model, decision: Decision | null) => void,
    private readonly time: Time | null,
  ) {}

  /** Seek and open the previous or next decision. */
  private step(by: 1 | -1): void {
    const time = this.time!;
    const all = this.models.flatMap((model) => model.decisions).sort((a, b) => a.time_s - b.time_s);
    const open = all.findIndex((one) => one.number === this.chosen && one.time_s === time.time_s);
    const before = all.filter((one) => one.time_s <= time.time_s).length;
    const to = all[open >= 0 ? open + by : by > 0 ? before : before - 1];
    if (!to) return;
    this.chosen = to.number;
    this.shown = new Shown();
    time.seek(to.time_s);
  }

  get any(): boolean {
    return this.models.some((model) => model.decisions.length);
  }

  show(time_s: number): void {
    const maps = this.models.some((model) => model.tiles.has("acquisition"));
    const missing = this.time ? "No acquisition map is kept: see the summary." : "This policy has shown no acquisition map yet.";
    setText(this.note, maps || !this.any ? "" : missing);
    const told = this.models.flatMap((model) => {
      const its = model.decisions.filter((one) => one.time_s <= time_s);
      const last = its.at(-1);
      const weighed = last?.candidates.length ? last : null;
      this.open(model, its.find((one) => one.number === this.chosen) ?? weighed);
      return its.map((decision) => ({ model, decision }));
    });
    const states = told.map(({ decision }) => [decision.number, decision.changes.map((one) => one.outcome)]);
    if (!this.shown.changes(states, this.models.map((model) => model.status?.outcome))) return;
    const items = told.slice(-SHOWN).map(({ model, decision }) => this.item(model, decision));
    fill(this.list, items.toReversed(), "There are no decisions yet.");
  }

  private item(model: Model, decision: Decision): HTMLElement {
    const { number, changes, refused, candidates } = decision;
    const outcomes = [...new Set(changes.map((one) => one.outcome).filter(Boolean))];
    const outcome = refused ? "refused" : outcomes.join(", ") || "unchanged";
    const came = outcomeOf(model, decision);
    const what = [` ${capital(decision.event)} `, element("span", { class: "outcome" }, outcome)];
    const toggled = (details: HTMLDetailsElement): void => {
      if (details.open) {
        this.chosen = number;
        this.open(model, decision);
      } else if (this.chosen === number) this.chosen = null;
    };
    const details = element(
      "details",
      { name: "decision", open: number === this.chosen, ontoggle: toggled },
      element("summary", {}, element("time", {}, clock(decision.time_s)), ...what),
      decision.reason ? element("p", {}, capital(decision.reason)) : null,
      refused ? element("p", { class: "refused" }, `Refused: ${refused}`) : null,
      candidates.length ? considered(model, decision) : null,
      came ? element("p", { class: "came" }, came) : null,
      element("p", { class: "small" }, `Decision ${number}, computed in ${figure(decision.compute_s)} s`),
    );
    return element("li", {}, details);
  }
}

/** Readings and score change until the next decision; empty while unknown. */
function outcomeOf(model: Model, { number, time_s }: Decision): string {
  const next = model.decisions.find((one) => one.number > number && one.time_s > time_s);
  const over = model.status && model.status.outcome !== "running";
  if (!next && !over) return "";
  const end_s = next?.time_s ?? model.end_s;
  const { time_s: times, values } = model.readings;
  const [from, to] = [upTo(times, time_s), upTo(times, end_s)];
  const diseases = (model.run?.fields ?? []).filter((field) => field.kind === "disease");
  let sick = 0;
  for (let k = from; k < to; k++) if (diseases.some(({ name }) => (values[name]?.[k] ?? 1) < SICK)) sick++;
  const [before, after] = [model.scoreAt(time_s), model.scoreAt(end_s)];
  const score = after === null ? "" : `; score ${before === null ? "" : `${fixed(before, 4)} to `}${fixed(after, 4)}`;
  const until = next ? "Until the next decision" : "Until the end";
  return `${until}: ${to - from} ${to - from === 1 ? "reading" : "readings"}, ${sick} sick${score}`;
}

function considered(model: Model, { candidates, changes }: Decision): HTMLElement {
  const best = candidates.toSorted((a, b) => b.value - a.value).slice(0, 12);
  const rows = best.map(({ system_id, path, value, cost }) => {
    const taken = changes.some((change) => String(change.path) === String(path));
    const length = path.length > 2 ? metres(lengthOf(path)) : "–"; // Some have only an end point
    const cells = [`${model.nameOf(system_id)}${taken ? " ✓" : ""}`, figure(value), figure(cost), length];
    return element("tr", taken ? { class: "taken" } : {}, ...cells.map((text) => element("td", {}, text)));
  });
  return table(["Vehicle", "Value", "Cost", "Path"], rows);
}

function lengthOf(path: number[]): number {
  let length = 0;
  for (let k = 2; k + 1 < path.length; k += 2)
    length += Math.hypot(path[k]! - path[k - 2]!, path[k + 1]! - path[k - 1]!);
  return length;
}
