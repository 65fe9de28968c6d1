// Report of a benchmark. `wbf_mission/addons/web/bench_page.py` makes its tables. This script makes them
// sortable, and adds filters and scores by seed to the table of all standings. The choices are kept behind
// the # of the address, so that a link restores them.
import { button, element, setText, svg, table as tableOf } from "./dom.js";

/** Seed, score over the run, final score (for a failed run: as counted), failure, start of the key. */
type Run = [seed: number | string, run: number, end: number, failed: string, key: string];

interface Order {
  column: number;
  down: boolean;
}

/** Filters by name, with their labels; their columns are the first ones. */
const FILTERS = { scenario: "Scenario", planner: "Planner or policy", estimator: "Estimator" };
const WIDTH = 480;
const HEIGHT = 34;
const EDGE = 10;

/** Make a table sortable by its headings; returns a sort function, and calls `chosen` with each order. */
function sortable(table: HTMLTableElement, chosen?: (order: Order) => void): (order: Order) => void {
  const headings = [...(table.tHead?.rows[0]?.cells ?? [])];
  let now: Order | null = null;
  const sort = (order: Order): void => {
    if (!headings[order.column]) return;
    now = order;
    for (const heading of headings) heading.removeAttribute("aria-sort");
    headings[order.column]!.setAttribute("aria-sort", order.down ? "descending" : "ascending");
    arrange(table, order);
  };
  headings.forEach((heading, column) => {
    const choose = (): void => {
      const order = { column, down: now?.column === column && !now.down };
      sort(order);
      chosen?.(order);
    };
    heading.replaceChildren(button(heading.textContent ?? "", choose));
  });
  return sort;
}

function arrange(table: HTMLTableElement, { column, down }: Order): void {
  const rows = mainRows(table);
  // A column of numbers may contain dashes, and words after a number.
  const numeric = rows.every((row) => /^[-+]?[\d.]|^-?$/.test(text(row, column)));
  const sign = down ? -1 : 1;
  rows.sort((one, two) => {
    const [a, b] = [text(one, column), text(two, column)];
    if (!numeric) return sign * a.localeCompare(b, "en", { numeric: true });
    const [x, y] = [parseFloat(a), parseFloat(b)];
    if (Number.isNaN(x) || Number.isNaN(y)) return Number(Number.isNaN(x)) - Number(Number.isNaN(y));
    return sign * (x - y);
  });
  table.tBodies[0]?.append(...rows.flatMap((row) => [row, detailOf(row)].filter((one) => one !== null)));
}

/** Rows of a table without their opened details. */
function mainRows(table: HTMLTableElement): HTMLTableRowElement[] {
  return [...(table.tBodies[0]?.rows ?? [])].filter((row) => !row.classList.contains("detail"));
}

function detailOf(row: HTMLTableRowElement): HTMLElement | null {
  const next = row.nextElementSibling as HTMLElement | null;
  return next?.classList.contains("detail") ? next : null;
}

/** Add filters and scores by seed to the table of all standings. */
function addFilters(table: HTMLTableElement, seeds: Run[][]): void {
  const rows = mainRows(table);
  const runs = new Map(rows.map((row, k) => [row, seeds[k] ?? []]));
  const sorted = element("input", { type: "hidden", name: "sort" });
  const sort = sortable(table, ({ column, down }) => {
    sorted.value = `${column}${down ? " down" : ""}`;
    remember();
  });
  const selects = Object.keys(FILTERS).map((name, column) => {
    const values = [...new Set(rows.map((row) => text(row, column)))];
    values.sort((a, b) => a.localeCompare(b, "en", { numeric: true }));
    return element("select", { name }, new Option("all", ""), ...values.map((value) => new Option(value, value)));
  });
  const search = element("input", { type: "search", name: "text" });
  const count = element("p", { role: "status" });
  const take = (): void => {
    filter();
    remember();
  };
  const filters = element(
    "form",
    { class: "filters", role: "search", oninput: take, onsubmit: (_, event) => event.preventDefault() },
    ...Object.values(FILTERS).map((label, k) => element("label", {}, label, selects[k]!)),
    element("label", {}, "Text", search),
    count,
    sorted,
  );
  table.parentElement?.before(filters);

  const filter = (): void => {
    const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
    for (const row of rows) {
      const all = (row.textContent ?? "").toLowerCase();
      const isChosen = selects.every(({ value }, column) => !value || text(row, column) === value);
      row.hidden = !isChosen || !words.every((word) => all.includes(word));
    }
    setText(count, `${rows.filter((row) => !row.hidden).length} of ${rows.length} rows`);
  };
  const remember = (): void => {
    const chosen = [...new FormData(filters)].filter(([, value]) => value) as [string, string][];
    history.replaceState(null, "", `#${new URLSearchParams(chosen)}`);
  };
  const restore = (): void => {
    const state = new URLSearchParams(location.hash.slice(1));
    for (const input of [...selects, search]) input.value = state.get(input.name) ?? "";
    for (const select of selects) if (select.selectedIndex < 0) select.value = "";
    sorted.value = state.get("sort") ?? sorted.value;
    const [column, down] = sorted.value.split(" ");
    if (column) sort({ column: Number(column), down: down === "down" });
    filter();
  };
  for (const row of rows) {
    const cell = row.cells[1]!;
    const attributes = { "aria-expanded": "false", class: "opener", title: "Scores by seed" };
    cell.append(button([...cell.childNodes], () => open(row), attributes)); // The name may still break in its places
  }
  const open = (row: HTMLTableRowElement): void => {
    const detail = detailOf(row);
    row.querySelector(".opener")?.setAttribute("aria-expanded", String(!detail));
    if (detail) return detail.remove();
    const own = runs.get(row) ?? [];
    const peers = rows.filter((one) => one !== row && text(one, 0) === text(row, 0));
    const others = peers.flatMap((one) => runs.get(one) ?? []);
    const cell = element("td", { colspan: row.cells.length }, strip(own, others), seedTable(own));
    row.after(element("tr", { class: "detail" }, cell));
  };
  addEventListener("hashchange", restore);
  restore();
}

const text = (row: HTMLTableRowElement, column: number): string => row.cells[column]?.textContent ?? "";

/** Formats a score as `score_text` of `wbf_mission/bench/intervals.py`. */
function told(score: number): string {
  const size = Math.abs(score);
  if (size >= 1e-3) return score.toFixed(4);
  if (size < 1e-9) return "0.0000";
  return size < 1e-4 ? score.toExponential(1) : score.toPrecision(2);
}

/** Scores of a row over the run, one dot per seed, above the scores of the other rows of its scenario. */
function strip(own: Run[], others: Run[]): SVGElement {
  const scores = [...own, ...others].map((run) => run[1]);
  const [low, high] = [Math.min(...scores), Math.max(...scores)];
  const at = (score: number): string => (EDGE + ((WIDTH - 2 * EDGE) * (score - low)) / (high - low || 1)).toFixed(1);
  const label = `Scores over the run of ${own.length} seeds, among the scores of the other rows`;
  const drawn = svg("svg", { class: "strip", viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": label });
  if (!scores.length) return drawn;
  for (const [, score] of others)
    drawn.append(svg("line", { class: "other", x1: at(score), x2: at(score), y1: 6, y2: 18 }));
  for (const [seed, score] of own) {
    const title = svg("title", {}, `seed ${seed}: ${told(score)}`);
    drawn.append(svg("circle", { class: "own", cx: at(score), cy: 12, r: 4 }, title));
  }
  drawn.append(
    svg("text", { x: 0, y: HEIGHT - 3, "text-anchor": "start" }, told(low)),
    svg("text", { x: WIDTH, y: HEIGHT - 3, "text-anchor": "end" }, told(high)),
  );
  return drawn;
}

function seedTable(runs: Run[]): HTMLElement {
  const rows = runs.map(([seed, run, end, failed, key]) => {
    const cells = [String(seed), told(run), told(end), key, failed];
    return element("tr", {}, ...cells.map((cell) => element("td", {}, cell)));
  });
  const made = tableOf(["seed", "run", "end", "key", "why it failed"], rows);
  made.className = "seeds";
  return made;
}

for (const table of document.querySelectorAll("table")) {
  const seeds = document.getElementById("seeds");
  if (table.id === "standings" && seeds) addFilters(table, JSON.parse(seeds.textContent ?? "[]") as Run[][]);
  else sortable(table);
}
