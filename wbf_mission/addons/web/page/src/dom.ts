// HTML elements. Texts are inserted as text only, so names from files and vehicles never become markup.

/** Null or undefined stands for no child. */
export type Child = Node | string | null | undefined;
/** Values by name: of an attribute, of a style (`--part`), or what to do at an event (`onclick`). */
type Attributes<Made> = Record<string, string | number | boolean | ((made: Made, event: Event) => void)>;

export function element<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  attributes: Attributes<HTMLElementTagNameMap[K]> = {},
  ...children: Child[]
): HTMLElementTagNameMap[K] {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") made.addEventListener(name.slice("on".length), (event) => value(made, event));
    else if (name.startsWith("--")) made.style.setProperty(name, String(value));
    else if (value !== false) made.setAttribute(name, value === true ? "" : String(value));
  }
  made.append(...children.map((child) => child ?? ""));
  return made;
}

/** Element of the page's own HTML. */
export function find<Found extends HTMLElement = HTMLElement>(selector: string): Found {
  return document.querySelector<Found>(selector)!;
}

/** Button of the page's own HTML, and what it does. */
export function findButton(selector: string, act: () => void): HTMLButtonElement {
  const found = find<HTMLButtonElement>(selector);
  found.onclick = act;
  return found;
}

export function svg(tag: string, attributes: Record<string, string | number>, ...children: Child[]): SVGElement {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, String(value));
  made.append(...children.map((child) => child ?? ""));
  return made;
}

export function button(
  label: string | Node[],
  act: () => void,
  attributes: Attributes<HTMLButtonElement> = {},
): HTMLButtonElement {
  return element("button", { type: "button", onclick: act, ...attributes }, ...[label].flat());
}

/** Set a text only if it differs, to keep selections and avoid repeated announcements. */
export function setText(node: Node, text: string): void {
  if (node.textContent !== text) node.textContent = text;
}

/** What is shown, so that it is only built again when it changes. */
export class Shown {
  private key = "";

  /** Take what is to be shown; returns whether it differs from what was shown. */
  changes(...parts: unknown[]): boolean {
    const before = this.key;
    this.key = JSON.stringify(parts);
    return this.key !== before;
  }
}

/** Show the items of a list, or why there are none. */
export function fill(list: HTMLElement, items: HTMLElement[], empty: string): void {
  list.replaceChildren(...(items.length ? items : [element("li", { class: "empty" }, empty)]));
}

/** Text input that calls `take` with each new valid text. */
export function entry(attributes: Attributes<HTMLInputElement>, take: (text: string) => void): HTMLInputElement {
  const onchange = (made: HTMLInputElement): void => {
    if (made.checkValidity()) take(made.value.trim());
  };
  return element("input", { type: "text", autocomplete: "off", onchange, ...attributes });
}

/** Slider that calls `act` with each new value. */
export function slider(attributes: Attributes<HTMLInputElement>, act: (value: number) => void): HTMLInputElement {
  return element("input", { type: "range", oninput: ({ value }) => act(Number(value)), ...attributes });
}

/** Suggestions for a text input. */
export function datalist(id: string, values: string[]): HTMLElement {
  return element("datalist", { id }, ...values.map((value) => element("option", { value })));
}

/** Radio buttons that look like one switch. */
export function segments(
  label: string,
  choices: [value: string, label: string][],
  chosen: string,
  act: (value: string) => void,
): HTMLElement {
  const buttons = choices.map(([value, text]) => {
    const checked = value === chosen;
    const input = element("input", { type: "radio", name: label, value, checked, onchange: () => act(value) });
    return element("label", {}, input, element("span", {}, text));
  });
  return element("fieldset", { class: "segments" }, element("legend", { class: "hidden" }, label), ...buttons);
}

export function checkbox(label: string, checked: boolean, act: (on: boolean) => void): HTMLElement {
  const input = element("input", { type: "checkbox", checked, onchange: (made) => act(made.checked) });
  return element("label", { class: "check" }, input, element("span", {}, label));
}

/** Table of texts, whose column headings are empty for columns without one. */
export function table(headings: string[], rows: HTMLElement[]): HTMLElement {
  const cells = headings.map((text) => (text ? element("th", { scope: "col" }, text) : element("td")));
  return element("table", {}, element("thead", {}, element("tr", {}, ...cells)), element("tbody", {}, ...rows));
}

/** Open a dialog; exactly one of `act` and `cancelled` is called, or none if it is closed with a return value. */
export function ask(
  title: string,
  parts: Child[],
  confirm: string,
  act: () => void,
  cancelled: () => void,
): HTMLDialogElement {
  const closed = (made: HTMLDialogElement): void => {
    made.remove();
    if (!made.returnValue) cancelled();
  };
  const cancel = button("Cancel", () => dialog.close());
  const send = element("button", { type: "submit", class: "starts", value: "sent" }, confirm);
  const form = element(
    "form",
    { method: "dialog", onsubmit: act },
    element("h2", { id: "dialog-title" }, title),
    ...parts,
    element("div", { class: "orders" }, cancel, send),
  );
  const dialog = element("dialog", { "aria-labelledby": "dialog-title", onclose: closed }, form);
  document.body.append(dialog);
  dialog.showModal();
  return dialog;
}
