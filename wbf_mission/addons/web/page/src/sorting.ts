// Tables sorted by their headings, with mouse or keyboard.
import { button } from "./dom.js";

export interface Order {
  column: number;
  down: boolean;
}

/** Make a table sortable by its headings; returns a sort function, and calls `chosen` with each order. */
export function sortable(table: HTMLTableElement, chosen: (order: Order) => void = () => undefined): (order: Order) => void {
  const headings = [...(table.tHead?.rows[0]?.cells ?? [])];
  let now: Order | null = null;
  const sort = (order: Order): void => {
    if (!headings[order.column]) return;
    now = order;
    headings.forEach((one, k) => {
      if (k === order.column) one.setAttribute("aria-sort", order.down ? "descending" : "ascending");
      else one.removeAttribute("aria-sort");
    });
    arrange(table, order);
  };
  headings.forEach((heading, column) => {
    const label = heading.textContent ?? "";
    heading.replaceChildren(
      button(label, () => {
        const order = { column, down: now?.column === column && !now.down };
        sort(order);
        chosen(order);
      }),
    );
  });
  return sort;
}

/** Rows of a table without their opened details. */
export function mainRows(table: HTMLTableElement): HTMLTableRowElement[] {
  return [...(table.tBodies[0]?.rows ?? [])].filter((row) => !row.classList.contains("detail"));
}

/** Opened details of a row. */
export function detailOf(row: HTMLTableRowElement): HTMLTableRowElement | null {
  const next = row.nextElementSibling;
  return next instanceof HTMLTableRowElement && next.classList.contains("detail") ? next : null;
}

function arrange(table: HTMLTableElement, order: Order): void {
  const rows = mainRows(table);
  const texts = new Map(rows.map((row) => [row, row.cells[order.column]?.textContent ?? ""]));
  // A column of numbers may contain dashes, and words after a number.
  const numeric = rows.every((row) => /^[-+]?[\d.]|^-?$/.test(texts.get(row) ?? ""));
  const sign = order.down ? -1 : 1;
  rows.sort((one, two) => {
    const [a, b] = [texts.get(one) ?? "", texts.get(two) ?? ""];
    if (!numeric) return sign * a.localeCompare(b, "en", { numeric: true });
    const [x, y] = [parseFloat(a), parseFloat(b)];
    if (Number.isNaN(x) || Number.isNaN(y)) return Number(Number.isNaN(x)) - Number(Number.isNaN(y));
    return sign * (x - y);
  });
  for (const row of rows) {
    const detail = detailOf(row);
    table.tBodies[0]?.append(row, ...(detail ? [detail] : []));
  }
}
