// HTML elements. Texts are inserted as text only, so names from files and vehicles never become markup.

type Child = Node | string;

export function element<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  attributes: Record<string, string> = {},
  ...children: Child[]
): HTMLElementTagNameMap[K] {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

export function svg(tag: string, attributes: Record<string, string>, ...children: Child[]): SVGElement {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

export function button(label: string, act: () => void, attributes: Record<string, string> = {}): HTMLButtonElement {
  const made = element("button", { type: "button", ...attributes }, label);
  made.addEventListener("click", act);
  return made;
}

/** Set a text only if it differs, to keep selections and avoid repeated announcements. */
export function setText(node: Node, text: string): void {
  if (node.textContent !== text) node.textContent = text;
}

/** Radio buttons that look like one switch. */
export function segments(
  label: string,
  choices: [value: string, label: string][],
  chosen: string,
  act: (value: string) => void,
): HTMLElement {
  const name = `choice-${Math.random().toString(36).slice(2)}`;
  const group = element("fieldset", { class: "segments" }, element("legend", { class: "hidden" }, label));
  for (const [value, text] of choices) {
    const input = element("input", { type: "radio", name, value });
    input.checked = value === chosen;
    input.addEventListener("change", () => act(value));
    group.append(element("label", {}, input, element("span", {}, text)));
  }
  return group;
}

export function checkbox(label: string, checked: boolean, act: (on: boolean) => void): HTMLElement {
  const input = element("input", { type: "checkbox" });
  input.checked = checked;
  input.addEventListener("change", () => act(input.checked));
  return element("label", { class: "check" }, input, element("span", {}, label));
}
