// Charts over time: score, battery, speed and height, with a common cursor; a click seeks that time.
import uPlot from "uplot";
import { lifted, onTheme, themed } from "./colours.js";
import { element, Shown } from "./dom.js";
import { between, SILENT_S, upTo, type Model } from "./model.js";
import { clock, fixed, percent } from "./text.js";

/** Maximum number of points of a chart. */
const MOST = 600;
/** Possible tick intervals of the time axis (s). */
const MARKS_S = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 43200, 86400];

interface Line {
  label: string;
  colour: string;
  values: (number | null)[];
}

interface Kind {
  name: string;
  write: (value: number) => string;
  range: [number | null, number | null];
  lines: (model: Model, times: number[]) => Line[];
}

function states(of: "battery" | "speed_m_s" | "height_m"): Kind["lines"] {
  return (model, times) =>
    model.vehicles.flatMap((info, k) => {
      const columns = model.states[info.system_id];
      if (!columns) return [];
      const values = times.map((time_s) => {
        const last = upTo(columns.time_s, time_s) - 1;
        const until_s = columns.time_s.at(-1)! + SILENT_S + times[1]!;
        return last < 0 || time_s > until_s ? null : between(columns, of, last, time_s);
      });
      return [{ label: model.nameOf(info.system_id), colour: lifted(k), values }];
    });
}

const KINDS: Kind[] = [
  {
    name: "Score",
    write: (value) => fixed(value, 3),
    range: [null, null],
    lines: (model, times) => {
      const values = times.map((time_s) => model.scoreAt(time_s));
      return model.scores.time_s.length ? [{ label: "score", colour: themed("accent"), values }] : [];
    },
  },
  { name: "Battery", write: percent, range: [0, 1], lines: states("battery") },
  { name: "Speed (m/s)", write: (value) => value.toFixed(1), range: [0, null], lines: states("speed_m_s") },
  { name: "Height (m)", write: (value) => fixed(value, 1), range: [0, null], lines: states("height_m") },
];

class Chart {
  private readonly value = element("span", { class: "value" });
  private readonly room = element("div", { class: "room" });
  private readonly caption = element("figcaption", {}, element("span", {}, this.kind.name), this.value);
  readonly element = element("figure", { class: "chart" }, this.caption, this.room);
  private readonly now = element("div", { class: "moment" });
  private plot: uPlot | null = null;
  private readonly shape = new Shown();
  private time_s = 0;
  /** Lines with the number of their run; those of the second one are dashed. */
  private lines: (Line & { run: number })[] = [];
  private times: number[] = [];

  constructor(private readonly kind: Kind, private readonly seek: (time_s: number) => void) {}

  show(models: Model[], times: number[], time_s: number, fresh: boolean): void {
    this.time_s = time_s;
    if (fresh) {
      this.times = times;
      this.lines = models.flatMap((model, run) => this.kind.lines(model, times).map((line) => ({ ...line, run })));
      this.draw();
    } else if (this.plot) this.mark(this.plot);
    this.tell(upTo(this.times, time_s) - 1);
  }

  private draw(): void {
    const some = this.lines.some((line) => line.values.some((value) => value !== null));
    this.element.hidden = !some;
    const width = this.room.clientWidth;
    if (!width) return;
    const data = [this.times, ...this.lines.map((line) => line.values)] as uPlot.AlignedData;
    const isNew = this.shape.changes(width, themed("ink"), this.lines.map(({ label, colour }) => [label, colour]));
    if (this.plot && !isNew) return this.plot.setData(data);
    this.plot?.destroy();
    this.plot = new uPlot(this.options(width), data, this.room);
    this.plot.over.append(this.now);
    this.plot.over.addEventListener("click", () => this.seek(this.plot!.posToVal(this.plot!.cursor.left ?? 0, "x")));
  }

  private options(width: number): uPlot.Options {
    const axis = {
      stroke: themed("muted"),
      font: `11px ${themed("font")}`,
      grid: { stroke: themed("line"), width: 1 },
      ticks: { show: false },
      gap: 4,
    };
    const { write, range } = this.kind;
    const series = this.lines.map(({ colour, run }) => {
      return { stroke: colour, width: 1.6, dash: run ? [5, 4] : [], points: { show: false } };
    });
    return {
      width,
      height: this.room.clientHeight,
      legend: { show: false },
      padding: [6, 8, 0, 0],
      cursor: { sync: { key: "time" }, y: false, drag: { x: false, y: false }, points: { size: 6 } },
      scales: {
        x: { time: false },
        y: {
          // A value that stays at zero gets an axis of its unit, not of hundredths.
          range: (_, low, high) => [
            range[0] === null ? low - 0.05 * (high - low || 1) : Math.min(range[0], low),
            range[1] ?? Math.max(high + 0.08 * (high - low || 1), (range[0] ?? -Infinity) + 1),
          ],
        },
      },
      axes: [
        { ...axis, size: 20, incrs: MARKS_S, values: (_, splits) => splits.map(clock) },
        { ...axis, size: 46, values: (_, splits) => splits.map(write), space: 28 },
      ],
      series: [{}, ...series],
      hooks: {
        draw: [(plot) => this.mark(plot)],
        setCursor: [(plot) => this.tell(plot.cursor.idx ?? upTo(this.times, this.time_s) - 1)],
      },
    };
  }

  private mark(plot: uPlot): void {
    this.now.style.left = `${Math.round(plot.valToPos(this.time_s, "x"))}px`;
  }

  /** Show the values at the cursor or now; for more than two lines only their range. */
  private tell(index: number): void {
    const values = this.lines.map((line) => line.values[index]).filter((value) => typeof value === "number");
    const ends = [Math.min(...values), Math.max(...values)];
    const { write } = this.kind;
    this.value.textContent = values.length > 2 ? ends.map(write).join(" – ") : values.map(write).join(" / ");
  }
}

export class Charts {
  private readonly charts = KINDS.map((kind) => new Chart(kind, this.seek));
  readonly element = element("div", { class: "charts" }, ...this.charts.map((chart) => chart.element));
  private time_s = 0;
  private end_s = -1;
  private shown = new Shown();

  constructor(private readonly models: Model[], private readonly seek: (time_s: number) => void) {
    new ResizeObserver(() => this.redraw()).observe(this.element);
    onTheme(() => this.redraw());
  }

  show(time_s: number, end_s: number): void {
    const sizes = this.models.map(({ vehicles, scores, states }) => [vehicles, scores.time_s, Object.keys(states)]);
    const fresh = this.shown.changes(end_s, sizes.map((lists) => lists.map((list) => list.length)));
    [this.time_s, this.end_s] = [time_s, end_s];
    const times = Array.from({ length: MOST + 1 }, (_, k) => (k * end_s) / MOST);
    for (const chart of this.charts) chart.show(this.models, times, time_s, fresh);
  }

  redraw(): void {
    this.shown = new Shown();
    if (this.end_s >= 0) this.show(this.time_s, this.end_s);
  }
}
