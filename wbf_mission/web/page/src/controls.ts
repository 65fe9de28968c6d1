// Orders to vehicles, where this page may give them, and the answers to what the operator is asked.
import { button, element, setText } from "./dom.js";
import type { Model } from "./model.js";
import type { Request } from "./schema.js";
import { capital } from "./text.js";

/** After these motors may turn: they are confirmed first. */
const STARTS_MOTORS = new Set(["start", "arm", "takeoff"]);
/** Orders with a value, and what it is called. */
const VALUES: Record<string, string> = { "set item": "Item number", takeoff: "Height above home, m" };
const REPLY_SHOWN_MS = 8000;

export class Controls {
  readonly element = element("section", { class: "controls", "aria-label": "Orders" });
  readonly question = element("div", { class: "question", role: "alert" });
  private readonly target = element("select", { "aria-label": "Orders go to" });
  private readonly buttons = element("div", { class: "orders" });
  private readonly dialog = element("dialog", { "aria-labelledby": "confirm-title" });
  private readonly became = element("span", { class: "became", role: "status" });
  private shape = "";
  private asked = "";
  private hide = 0;

  constructor(
    private readonly model: Model,
    private readonly send: (request: Request) => void,
  ) {
    this.element.append(
      element("label", {}, element("span", { class: "hidden" }, "Orders go to"), this.target),
      this.buttons,
      this.became,
      this.dialog,
    );
  }

  /** Orders go to this vehicle from now on. */
  aim(system_id: number | null): void {
    this.target.value = system_id === null ? "" : String(system_id);
  }

  /** Tell what became of the last order. */
  reply({ order, error }: { order: string; error: string }): void {
    setText(this.became, error ? `Not done: ${error}` : `${capital(order)}: sent`);
    this.became.classList.toggle("refused", error !== "");
    clearTimeout(this.hide);
    this.hide = setTimeout(() => setText(this.became, ""), REPLY_SHOWN_MS);
  }

  show(): void {
    const orders = this.model.status?.orders ?? [];
    const vehicles = this.model.run?.vehicles ?? [];
    this.element.hidden = !orders.length;
    const shape = JSON.stringify([orders, vehicles]);
    if (shape !== this.shape) {
      this.shape = shape;
      const before = this.target.value;
      const all = vehicles.length === 1 ? [] : [element("option", { value: "" }, "All vehicles")];
      this.target.replaceChildren(
        ...all,
        ...vehicles.map((info) =>
          element("option", { value: String(info.system_id) }, this.model.nameOf(info.system_id)),
        ),
      );
      if ([...this.target.options].some((option) => option.value === before)) this.target.value = before;
      this.buttons.replaceChildren(
        ...orders.map((order) =>
          button(capital(order), () => this.give(order), { class: STARTS_MOTORS.has(order) ? "starts" : "" }),
        ),
      );
    }
    this.showQuestion();
  }

  private showQuestion(): void {
    const question = this.model.status?.question ?? null;
    const key = JSON.stringify(question);
    if (key === this.asked) return;
    this.asked = key;
    this.question.hidden = !question;
    const answers = (question?.answers ?? []).map((answer) => button(capital(answer), () => this.send({ answer })));
    this.question.replaceChildren(
      element("p", {}, question?.text ?? ""),
      element("div", { class: "orders" }, ...answers),
    );
  }

  private give(order: string): void {
    const system_id = this.target.value ? Number(this.target.value) : null;
    const who = this.target.selectedOptions[0]?.textContent ?? "";
    const [starts, value] = [STARTS_MOTORS.has(order), VALUES[order]];
    if (!starts && !value) this.send({ order, system_id });
    else
      this.ask(
        `${capital(order)}: ${who}`,
        starts ? "Motors may turn. Is everybody clear of the vehicle?" : "",
        value ?? null,
        (given) =>
          this.send({
            order,
            system_id,
            ...(given === null ? {} : { value: given }),
            ...(starts ? { confirmed: true } : {}),
          }),
      );
  }

  private ask(title: string, text: string, value: string | null, act: (value: string | null) => void): void {
    const heading = element("h2", { id: "confirm-title" });
    setText(heading, title);
    const input = element("input", { type: "number", min: "1", step: "any", required: "" });
    const form = element("form", { method: "dialog" }, heading);
    if (text) form.append(element("p", {}, text));
    if (value) form.append(element("label", {}, `${value} `, input));
    const cancel = button("Cancel", () => this.dialog.close());
    const confirm = element("button", { type: "submit", class: "starts" }, text ? "Yes, go on" : "Send");
    form.append(element("div", { class: "orders" }, cancel, confirm));
    form.addEventListener("submit", () => act(value ? input.value : null));
    this.dialog.replaceChildren(form);
    this.dialog.showModal();
    (value ? input : cancel).focus();
  }
}
