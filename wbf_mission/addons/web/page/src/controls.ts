// Orders to vehicles, if allowed to this page, and answers to questions to the operator.
import { ask, button, element, setText, Shown, type Child } from "./dom.js";
import type { Model } from "./model.js";
import type { Said } from "./schema.js";
import type { Heart, Send, Wish } from "./source.js";
import { capital } from "./text.js";
import { WARNS } from "./messages.js";

/** Orders that may start motors, which need a confirmation. */
const STARTS_MOTORS = new Set(["start", "arm", "takeoff"]);
/** Orders that end a flight, which need a confirmation for several vehicles. */
const ENDS_FLIGHT = new Set(["return", "land"]);
/** Orders with a value, and the label of the value. */
const VALUES: Record<string, string> = { "set item": "Item number", takeoff: "Height above home, m" };
/** Groups of orders; other orders are added to the second group. */
const GROUPS = [["start", "arm", "takeoff"], ["hold", "resume", "set item"], ["return", "land"]];
/** Orders with a fixed place from the start, so that no button appears under a finger. */
const OF_A_FLIGHT = ["start", "hold", "resume", "set item", "return", "land"];
const ALL = "all";
/** Return value of a dialog whose order is no longer allowed. */
const OVER = "over";
const REPLY_SHOWN_MS = 8000;
/** Timeout of an answer: the program ignores requests older than 2 s. */
const ANSWER_MS = 3000;

const isWarning = ({ system_id, severity }: Said): boolean => !system_id && severity <= WARNS;

export class Controls {
  readonly question = element("div", { class: "question", role: "alert" });
  readonly became = element("p", { class: "became", role: "status" });
  /** Reason why no order can be given. */
  readonly why = element("p", { class: "why", id: "why-no-order", role: "status" });
  private readonly target = element("select", {
    "aria-label": "Orders go to",
    onchange: ({ value }) => {
      if (value !== ALL) this.choose(value ? Number(value) : null);
      this.show();
    },
  });
  private readonly buttons = element("div", { class: "orders" });
  readonly element = element("section", { class: "controls", "aria-label": "Orders" }, this.target, this.buttons);
  private dialog: HTMLDialogElement | null = null;
  /** Whether the order of the open dialog is still allowed. */
  private stillMay = (): boolean => true;
  private readonly known = new Set<string>(OF_A_FLIGHT);
  private appeared = false;
  private wasFresh = false;
  private readonly shape = new Shown();
  private readonly asked = new Shown();
  private hide = 0;
  /** Pending requests in words, by number. */
  private readonly open = new Map<number, string>();
  /** Newest warning of the program before the last order; null without an order. */
  private before: string | null = null;

  constructor(
    private readonly model: Model,
    private readonly send: Send,
    private readonly heart: Heart,
    private readonly choose: (system_id: number | null) => void,
  ) {}

  /** Select the target of orders; null with several vehicles selects none. */
  aim(system_id: number | null): void {
    if (system_id !== null) this.target.value = String(system_id);
    else if (this.ids.length > 1) this.target.value = "";
  }

  /** Show the outcome of an order. */
  reply({ order, error, number }: { order: string; error: string; number: number }): void {
    const what = this.open.get(number) ?? capital(order);
    this.open.delete(number);
    this.say(error ? `${what}: not done: ${error}` : `${what}: sent`, error !== "");
  }

  show(): void {
    const orders = this.model.status?.orders ?? [];
    const { isFresh } = this.heart;
    if (this.wasFresh && !isFresh) {
      // The program is lost: old messages are cleared, and pending requests are not answered.
      this.say("", false);
      for (const number of [...this.open.keys()]) this.giveUp(number);
    }
    this.wasFresh = isFresh;
    // The buttons keep their places until the end of the run.
    this.appeared ||= orders.length > 0 || !!this.model.status?.question;
    this.element.hidden = !this.appeared || !this.model.runs;
    for (const order of orders) this.known.add(order);
    if (this.shape.changes([...this.known], this.model.run?.vehicles)) this.build();
    const may = isFresh && this.meant.length > 0;
    setText(this.why, this.element.hidden || !isFresh ? "" : this.reason(orders));
    for (const one of this.buttons.querySelectorAll("button"))
      one.disabled = !may || !orders.includes(one.dataset["order"]!);
    for (const one of this.question.querySelectorAll("button")) one.disabled = !isFresh;
    if (this.dialog?.open && !this.stillMay()) {
      this.dialog.close(OVER);
      this.say("Nothing was sent: your choice is no longer possible", true);
    }
    this.showQuestion();
    // A request may be refused later, and on a phone messages are in another panel.
    const warning = this.warning;
    if (this.before === null || warning === this.before || !this.model.runs) return;
    this.before = warning;
    this.say(this.model.said.findLast(isWarning)?.text ?? "", true);
  }

  private get warning(): string {
    const { time_s, text } = this.model.said.findLast(isWarning) ?? {};
    return `${time_s} ${text}`;
  }

  private reason(orders: string[]): string {
    if (!orders.length) return "The program takes no orders now.";
    if (!this.ids.length) return "No vehicle has been heard yet: orders have nowhere to go.";
    return this.meant.length ? "" : "Choose a vehicle: until then, orders go to no vehicle.";
  }

  private get ids(): number[] {
    return this.model.vehicles.map(({ system_id }) => system_id);
  }

  /** System ids of the vehicles that an order is for. */
  private get meant(): number[] {
    const { value } = this.target;
    if (value === ALL) return this.ids;
    return value ? [Number(value)] : [];
  }

  /** Rebuild the buttons; each order keeps its place, so that nothing moves under a finger. */
  private build(): void {
    const before = this.target.value;
    const several = this.ids.length > 1;
    const ones = this.ids.map((id) => new Option(this.model.nameOf(id), String(id)));
    const choices = [new Option("Choose a vehicle …", ""), ...ones, new Option(`All ${ones.length} vehicles`, ALL)];
    this.target.replaceChildren(...(several ? choices : ones));
    if ([...this.target.options].some(({ value }) => value === before)) this.target.value = before;
    const others = [...this.known].filter((order) => !GROUPS.flat().includes(order));
    const groups = GROUPS.map((group, k) => group.filter((order) => this.known.has(order)).concat(k === 1 ? others : []));
    const buttonOf = (order: string): HTMLElement => {
      const kind = STARTS_MOTORS.has(order) ? "starts" : ENDS_FLIGHT.has(order) ? "comes-down" : "";
      const attributes = { class: kind, "data-order": order, "aria-describedby": this.why.id };
      return button(capital(order), () => this.give(order), attributes);
    };
    const filled = groups.filter((group) => group.length);
    this.buttons.replaceChildren(...filled.map((group) => element("div", { class: "group" }, ...group.map(buttonOf))));
  }

  private showQuestion(): void {
    const question = this.model.status?.question ?? null;
    if (!this.asked.changes(question)) return;
    this.question.hidden = !question;
    const answers = (question?.answers ?? []).map((answer) =>
      button(capital(answer), () => this.answer(answer, question!.number)),
    );
    this.question.replaceChildren(
      element("p", {}, question?.text ?? ""),
      element("div", { class: "orders" }, ...answers),
    );
  }

  private answer(answer: string, question: number): void {
    const what = `Answer “${answer}”`;
    const tell = (): void => this.tell(what, { answer, question });
    if (!ENDS_FLIGHT.has(answer) || this.ids.length < 2) return tell();
    const stillMay = (): boolean => this.model.status?.question?.number === question;
    this.ask(what, `${capital(answer)}: all vehicles`, this.toSeveral(this.ids), null, tell, stillMay);
  }

  private give(order: string): void {
    const system_ids = this.meant;
    const who = this.target.selectedOptions[0]?.textContent ?? "";
    const what = this.ids.length > 1 ? `${capital(order)}, ${who}` : capital(order);
    const [starts, label] = [STARTS_MOTORS.has(order), VALUES[order]];
    const several = system_ids.length > 1 && (starts || ENDS_FLIGHT.has(order));
    const text = [
      starts ? "Motors may turn. Is everybody clear of the vehicle?" : "",
      several ? this.toSeveral(system_ids) : "",
    ].filter(Boolean).join(" ");
    const input = element("input", { type: "number", min: "1", step: "any", required: true });
    const tell = (): void => {
      const value = label ? { value: input.value } : {};
      this.tell(what, { order, system_ids, ...value, ...(text ? { confirmed: true } : {}) });
    };
    if (!text && !label) return tell();
    const stillMay = (): boolean => (this.model.status?.orders ?? []).includes(order);
    const value = label ? element("label", {}, `${label} `, input) : null;
    this.ask(what, `${capital(order)}: ${who}`, text, value, tell, stillMay);
  }

  private toSeveral(system_ids: number[]): string {
    return `The order goes to ${system_ids.length} vehicles: ${system_ids.map((id) => this.model.nameOf(id)).join(", ")}.`;
  }

  /** Send a request once, or show that it was not sent. */
  private tell(what: string, wish: Wish): void {
    this.show(); // A loss of the program is noticed first, as it clears messages
    const number = this.send(wish);
    if (number === null) return this.say(`${what}: not sent: the program does not answer`, true);
    this.open.set(number, what);
    this.before = this.warning;
    this.say(`${what} …`, false);
    setTimeout(() => this.giveUp(number), ANSWER_MS);
  }

  private giveUp(number: number): void {
    const what = this.open.get(number);
    if (what === undefined) return;
    // A reply may still arrive and then replaces this message.
    this.open.delete(number);
    this.say(`${what}: not answered: the request may or may not have arrived`, true);
  }

  private say(text: string, isBad: boolean): void {
    setText(this.became, text);
    this.became.classList.toggle("refused", isBad);
    clearTimeout(this.hide);
    if (!isBad) this.hide = setTimeout(() => setText(this.became, ""), REPLY_SHOWN_MS);
  }

  private ask(
    what: string,
    title: string,
    text: string,
    value: Child,
    act: () => void,
    stillMay: () => boolean,
  ): void {
    this.stillMay = () => this.heart.isFresh && stillMay();
    // Clear the message of the previous order.
    this.say("", false);
    const parts = [text ? element("p", {}, text) : null, value];
    const cancelled = (): void => this.say(`${what}: not sent`, false);
    this.dialog = ask(title, parts, text ? "Yes, go on" : "Send", act, cancelled);
  }
}
