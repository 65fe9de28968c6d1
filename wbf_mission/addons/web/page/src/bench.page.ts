// Report of a benchmark. `wbf_mission/addons/web/bench_page.py` makes its tables. This script makes them
// sortable, and adds filters and scores by seed to the table of all standings. The choices are kept behind
// the # of the address, so that a link restores them.
import { button, element, setText, svg } from "./dom.js";
import { detailOf, mainRows, sortable, type Order } from "./sorting.js";

/** Seed, score over the run, final score (for a failed run: as counted), failure, start of the key. */
type Run = [seed: number | string, run: number, end: number, failed: string, key: string];

const FILTERS: [key: string, label: string, column: number][] = [
  ["scenario", "Scenario", 0],
  ["planner", "Planner or policy", 1],
  ["estimator", "Estimator", 2],
];
const WIDTH = 480;
const HEIGHT = 34;
const EDGE = 10;

function show(table: HTMLTableElement, seeds: Run[][]): void {
  const rows = mainRows(table);
  const runs = new Map(rows.map((row, k) => [row, seeds[k] ?? []]));
  let order: Order | null = null;
  const sort = sortable(table, (chosen) => {
    order = chosen;
    remember();
  });
  const selects = FILTERS.map(([key, label, column]) => {
    const names = [...new Set(rows.map((row) => text(row, column)))].sort((a, b) => a.localeCompare(b, "en", { numeric: true }));
    const select = element("select", { name: key }, element("option", { value: "" }, "all"));
    select.append(...names.map((name) => element("option", { value: name }, name)));
    return { key, label, column, select };
  });
  const search = element("input", { type: "search", name: "text" });
  const count = element("p", { role: "status" });
  const filters = element("form", { class: "filters", role: "search" });
  filters.append(...selects.map((one) => element("label", {}, one.label, one.select)), element("label", {}, "Text", search), count);
  filters.addEventListener("input", () => {
    filter();
    remember();
  });
  filters.addEventListener("submit", (event) => event.preventDefault());
  table.parentElement?.before(filters);

  const filter = (): void => {
    const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
    let shown = 0;
    for (const row of rows) {
      const all = (row.textContent ?? "").toLowerCase();
      const fits =
        selects.every((one) => !one.select.value || text(row, one.column) === one.select.value) &&
        words.every((word) => all.includes(word));
      row.hidden = !fits;
      const detail = detailOf(row);
      if (detail) detail.hidden = !fits;
      shown += Number(fits);
    }
    setText(count, `${shown} of ${rows.length} rows`);
  };
  const remember = (): void => {
    const state = new URLSearchParams();
    for (const one of selects) if (one.select.value) state.set(one.key, one.select.value);
    if (search.value) state.set("text", search.value);
    if (order) state.set("sort", `${order.column}${order.down ? " down" : ""}`);
    history.replaceState(null, "", `#${state}`);
  };
  const restore = (): void => {
    const state = new URLSearchParams(location.hash.slice(1));
    for (const one of selects) {
      const wanted = state.get(one.key) ?? "";
      one.select.value = [...one.select.options].some((option) => option.value === wanted) ? wanted : "";
    }
    search.value = state.get("text") ?? "";
    const [column, down] = (state.get("sort") ?? "").split(" ");
    if (column) {
      order = { column: Number(column), down: down === "down" };
      sort(order);
    }
    filter();
  };
  for (const row of rows) {
    const cell = row.cells[1];
    if (!cell) continue;
    const opener = button("", () => open(row), { "aria-expanded": "false", class: "opener", title: "Scores by seed" });
    opener.append(...cell.childNodes); // Keeps the line break opportunities of the name
    cell.append(opener);
  }
  const open = (row: HTMLTableRowElement): void => {
    const detail = detailOf(row);
    row.querySelector(".opener")?.setAttribute("aria-expanded", String(!detail));
    if (detail) {
      detail.remove();
      return;
    }
    const scenario = text(row, 0);
    const others = rows.filter((one) => one !== row && text(one, 0) === scenario).flatMap((one) => runs.get(one) ?? []);
    const cell = element("td", { colspan: String(row.cells.length) });
    cell.append(strip(runs.get(row) ?? [], others), seedTable(runs.get(row) ?? []));
    row.after(element("tr", { class: "detail" }, cell));
  };
  addEventListener("hashchange", restore);
  restore();
}

function text(row: HTMLTableRowElement, column: number): string {
  return row.cells[column]?.textContent ?? "";
}

/** Formats a score as `score_text` of `wbf_mission/bench/intervals.py`. */
function told(score: number): string {
  const size = Math.abs(score);
  if (size >= 1e-3) return score.toFixed(4);
  if (size < 1e-9) return "0.0000";
  return size < 1e-4 ? score.toExponential(1) : score.toPrecision(2);
}

/** Scores over the run, one dot per seed, above those of the others in the same scenario. */
function strip(own: Run[], others: Run[]): SVGElement {
  const scores = [...own, ...others].map((run) => run[1]);
  const [low, high] = [Math.min(...scores), Math.max(...scores)];
  const at = (score: number): string => (EDGE + ((WIDTH - 2 * EDGE) * (score - low)) / (high - low || 1)).toFixed(1);
  const drawn = svg("svg", { class: "strip", viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img" });
  drawn.setAttribute("aria-label", `Scores over the run of ${own.length} seeds, among those of the others`);
  if (!scores.length) return drawn;
  for (const run of others) {
    const x = at(run[1]);
    drawn.append(svg("line", { class: "other", x1: x, x2: x, y1: "6", y2: "18" }));
  }
  for (const run of own) {
    const dot = svg("circle", { class: "own", cx: at(run[1]), cy: "12", r: "4" });
    dot.append(svg("title", {}, `seed ${run[0]}: ${told(run[1])}`));
    drawn.append(dot);
  }
  const ends: [number, string][] = [[low, "start"], [high, "end"]];
  for (const [score, anchor] of ends) {
    const x = anchor === "start" ? "0" : String(WIDTH);
    drawn.append(svg("text", { x, y: String(HEIGHT - 3), "text-anchor": anchor }, told(score)));
  }
  return drawn;
}

function seedTable(runs: Run[]): HTMLElement {
  const row = (tag: "td" | "th", ...cells: string[]): HTMLElement =>
    element("tr", {}, ...cells.map((cell) => element(tag, {}, cell)));
  const body = element("tbody", {});
  body.append(...runs.map(([seed, run, end, failed, key]) => row("td", String(seed), told(run), told(end), key, failed)));
  return element("table", { class: "seeds" }, element("thead", {}, row("th", "seed", "run", "end", "key", "why it failed")), body);
}

for (const table of document.querySelectorAll("table")) {
  const seeds = document.getElementById("seeds");
  if (table.id === "standings" && seeds) show(table, JSON.parse(seeds.textContent ?? "[]") as Run[][]);
  else sortable(table);
}
