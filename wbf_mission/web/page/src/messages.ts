// What was said, and what a policy decided and why.
import { element, setText } from "./dom.js";
import type { Model } from "./model.js";
import type { Decision, Said } from "./schema.js";
import { capital, clock, figure, metres } from "./text.js";

const SHOWN = 100;
const WARNS = 4;
const SEVERITIES = ["Emergency", "Alert", "Critical", "Error", "Warning", "Notice", "Info", "Debug"];

function speaker(model: Model, said: Said): string {
  return said.system_id ? model.nameOf(said.system_id) : "";
}

/** The newest on top; warnings are also read aloud. */
export class Messages {
  readonly element = element("ol", { class: "messages", tabindex: "0", "aria-label": "Messages, the newest first" });
  readonly aloud = element("div", { class: "hidden", role: "status", "aria-live": "polite" });
  private shown = "";

  constructor(private readonly models: Model[]) {}

  show(time_s: number): void {
    const said = this.models.flatMap((model) =>
      model.said.map((one) => ({ model, one })).filter(({ one }) => one.time_s <= time_s),
    );
    if (this.models.length > 1) said.sort((a, b) => a.one.time_s - b.one.time_s);
    const key = `${said.length} ${said.at(-1)?.one.text ?? ""}`;
    if (key === this.shown) return;
    this.shown = key;
    const lines = said
      .slice(-SHOWN)
      .reverse()
      .map(({ model, one }) => {
        const who = speaker(model, one);
        const grade = one.severity <= 3 ? "error" : one.severity === WARNS ? "warning" : "plain";
        const name = SEVERITIES[one.severity] ?? "";
        const words = grade === "plain" ? "" : `${name}: `;
        return element(
          "li",
          { class: grade },
          element("time", {}, clock(one.time_s)),
          element("span", { class: "text" }, ...(who ? [element("b", {}, `${who} `)] : []), words + one.text),
        );
      });
    this.element.replaceChildren(
      ...(lines.length ? lines : [element("li", { class: "empty" }, "Nothing was said yet.")]),
    );
    const last = said.at(-1);
    if (last && last.one.severity <= WARNS)
      setText(this.aloud, `${speaker(last.model, last.one)} ${SEVERITIES[last.one.severity] ?? ""}: ${last.one.text}`);
  }
}

/** The decisions of a policy: the one that is open is on the map. */
export class Decisions {
  readonly element = element("ol", { class: "decisions" });
  private shown = "";
  private chosen: number | null = null;

  constructor(
    private readonly models: Model[],
    private readonly open: (model: Model, decision: Decision | null) => void,
  ) {}

  get any(): boolean {
    return this.models.some((model) => model.decisions.length);
  }

  show(time_s: number): void {
    const told = this.models.flatMap((model) =>
      model.decisions.filter((one) => one.time_s <= time_s).map((decision) => ({ model, decision })),
    );
    for (const model of this.models) {
      const its = told.filter((one) => one.model === model).map((one) => one.decision);
      const last = its.at(-1);
      const weighed = last?.candidates.length ? last : null;
      this.open(model, its.find((one) => one.number === this.chosen) ?? weighed);
    }
    const key = told
      .map(({ decision }) => `${decision.number} ${decision.changes.map((one) => one.outcome).join()}`)
      .join();
    if (key === this.shown) return;
    this.shown = key;
    const items = told
      .slice(-SHOWN)
      .reverse()
      .map(({ model, decision }) => this.item(model, decision));
    this.element.replaceChildren(
      ...(items.length ? items : [element("li", { class: "empty" }, "Nothing was decided yet.")]),
    );
  }

  private item(model: Model, decision: Decision): HTMLElement {
    const { number, changes, refused, candidates } = decision;
    const outcomes = [...new Set(changes.map((one) => one.outcome).filter(Boolean))];
    const outcome = refused ? "refused" : outcomes.join(", ") || "as it was";
    const title = element(
      "summary",
      {},
      element("time", {}, clock(decision.time_s)),
      ` ${capital(decision.event)} `,
      element("span", { class: "outcome" }, outcome),
    );
    const details = element("details", {}, title);
    details.open = number === this.chosen;
    details.addEventListener("toggle", () => {
      if (details.open) {
        this.chosen = number;
        for (const other of this.element.querySelectorAll("details")) if (other !== details) other.open = false;
        this.open(model, decision);
      } else if (this.chosen === number) this.chosen = null;
    });
    if (decision.reason) details.append(element("p", {}, capital(decision.reason)));
    if (refused) details.append(element("p", { class: "refused" }, `Refused: ${refused}`));
    if (candidates.length) details.append(table(model, decision));
    details.append(
      element("p", { class: "small" }, `Decision ${number}, thought of for ${figure(decision.compute_s)} s`),
    );
    return element("li", {}, details);
  }
}

function table(model: Model, { candidates, changes }: Decision): HTMLElement {
  const rows = [...candidates]
    .sort((a, b) => b.value - a.value)
    .slice(0, 12)
    .map((one) => {
      const taken = changes.some((change) => String(change.path) === String(one.path));
      const length = metres(lengthOf(one.path));
      const cells = [`${model.nameOf(one.system_id)}${taken ? " ✓" : ""}`, figure(one.value), figure(one.cost), length];
      return element("tr", taken ? { class: "taken" } : {}, ...cells.map((text) => element("td", {}, text)));
    });
  const heads = ["Vehicle", "Value", "Cost", "Path"].map((text) => element("th", { scope: "col" }, text));
  return element("table", {}, element("thead", {}, element("tr", {}, ...heads)), element("tbody", {}, ...rows));
}

function lengthOf(path: number[]): number {
  let length = 0;
  for (let k = 2; k + 1 < path.length; k += 2)
    length += Math.hypot(path[k]! - path[k - 2]!, path[k + 1]! - path[k - 1]!);
  return length;
}
