// Page of a live run, or of recordings of one or two runs.
import { Charts } from "./charts.js";
import { Controls } from "./controls.js";
import { button, element, setText, slider } from "./dom.js";
import { LayerPanel } from "./layers.js";
import { AT_START, MapView } from "./map.js";
import { Decisions, Messages } from "./messages.js";
import { Model } from "./model.js";
import type { Decision, Recording, Update } from "./schema.js";
import { connect, Heart, read, TOLD_S } from "./source.js";
import { capital, clock, percent } from "./text.js";
import { Time } from "./time.js";
import { scoreLine, Vehicles } from "./vehicles.js";

const CHARTS_MS = 400;
const PANELS_MS = 200;
/** Styles of outcomes; any other outcome is bad. */
const LOOKS: Record<string, string> = { completed: "good", running: "running", ended: "running", interrupted: "warn" };

class App {
  private readonly live = !this.recordings.length;
  private readonly models = (this.recordings.length > 1 ? ["A", "B"] : [""]).map(
    (letter) => new Model(letter, this.live ? () => this.heart.age_s ?? 0 : null),
  );
  private readonly root = document.getElementById("app")!;
  private readonly title = element("h1");
  private readonly link = element("span", { class: "pill connection" });
  private readonly outcome = element("span", { class: "pill outcome" });
  private readonly progress = element("span", { class: "progress" });
  private readonly lost = element("p", { class: "lost", role: "alert" });
  private readonly under = element("output", { class: "under-pointer", "aria-live": "off" });
  private readonly heart = new Heart();
  private readonly choice = { ...AT_START };
  private dirty = true;
  private chartsAt_ms = 0;
  private panelsAt_ms = 0;
  private stale = true;
  private scale: number | undefined;
  private maps: MapView[] = [];
  private readonly parts = this.build();

  /** Show recordings, or without any the program's run. */
  constructor(private readonly recordings: Recording[]) {
    addEventListener("beforeprint", () => this.print(true));
    addEventListener("afterprint", () => this.print(false));
    if (this.live) return;
    this.begin();
    recordings.forEach((recording, run) => this.take(recording, run));
    setText(this.link, "Recording");
  }

  /** Lay out for printing: maps and charts are redrawn at the size on paper. */
  private print(begins: boolean): void {
    document.documentElement.classList.toggle("printing", begins);
    for (const map of this.maps) map.print(begins);
    this.parts.charts.redraw();
  }

  /** Start over with new data; the reader's choices are kept. */
  begin(): void {
    for (const model of this.models) Object.assign(model, new Model(model.letter, model.age_s));
    const { main, side, messages } = this.parts;
    if (main.isConnected) return;
    this.root.append(main, side, messages.aloud);
    requestAnimationFrame((now_ms) => this.frame(now_ms));
  }

  take(update: Update, run = 0): void {
    this.models[run]!.take(update);
    // Show the first field until the reader chooses.
    const { fields } = this.models[0]!;
    if (!fields.some((one) => one.name === this.choice.field)) this.choice.field = fields[0]?.name ?? "";
    if (update.reply) this.parts.controls?.reply(update.reply);
    this.dirty = this.stale = true;
  }

  /** Lay out the page; before the first data only its header is shown. */
  private build() {
    const { live, models, choice } = this;
    const changed = (): void => {
      this.dirty = true;
      for (const map of this.maps) map.redraw();
    };
    const time = new Time(live, () => (this.dirty = true));
    const vehicles = new Vehicles(models, (model, id) => {
      models.forEach((one, k) => (this.maps[k]!.selected = one === model ? id : null));
      if (id !== null) this.maps[models.indexOf(model)]!.goTo(id);
      controls?.aim(id);
      this.dirty = this.stale = true;
    });
    const messages = new Messages(models);
    const draw = (model: Model, decision: Decision | null): void => {
      const map = this.maps[models.indexOf(model)]!;
      if (map.decision !== decision) this.dirty = true;
      map.decision = decision;
    };
    const decisions = new Decisions(models, draw, live ? null : time);
    const charts = new Charts(models, (time_s) => time.seek(time_s));
    const layers = new LayerPanel(models, choice, changed);
    const choose = (id: number | null): void => vehicles.choose(models[0]!, id);
    const send = live ? connect("live", this.heart, this) : null;
    const controls = send && new Controls(models[0]!, send, this.heart, choose);
    const stage = element("div", { class: "stage" });
    const alone = models.length === 1;
    const roomy = alone && !matchMedia("(max-width: 60rem)").matches;
    const summary = element("summary", {}, "Layers");
    const layerBox = element("details", { class: "layer-box", open: roomy }, summary, layers.element);
    const covered = (): number => (layerBox.open && alone && stage.clientWidth > 800 ? layerBox.offsetWidth : 0);
    this.maps = models.map((model, k) => {
      const label = `Map${alone ? "" : ` of run ${k + 1}`}; arrow keys move it, plus and minus zoom`;
      const room = element("div", { class: "map", tabindex: "0", role: "application", "aria-label": label });
      stage.append(alone ? room : element("div", { class: "one-of-two" }, element("h2", { class: "of-run" }), room));
      const told = (text: string): void => setText(this.under, text);
      return new MapView(room, model, choice, told, (id) => vehicles.select(model, id), covered, alone);
    });
    // The panel gets its width when its layers are known.
    new ResizeObserver(() => this.maps.forEach((map) => map.refit())).observe(layerBox);
    this.join();
    const takeSplit = (part: number): void => {
      choice.split = part;
      changed();
    };
    const sides = { class: "split", min: 0, max: 1, step: 0.005, value: choice.split };
    const split = slider({ ...sides, "aria-label": "Estimate left, truth right of here" }, takeSplit);
    const fit = button("Show all", () => this.maps.forEach((map) => map.fit()), { class: "fit" });
    stage.append(split, fit, layers.legend, this.under, layerBox);

    const panelOf = (name: string, child: Node): HTMLElement => {
      const heading = element("h2", {}, capital(name));
      return element("section", { "aria-label": capital(name), class: `panel ${name}` }, heading, child);
    };
    const side = element(
      "aside",
      { class: "side", "aria-label": "Vehicles and messages" },
      panelOf("vehicles", vehicles.element),
      panelOf("decisions", decisions.element),
      panelOf("messages", messages.element),
    );
    const header = element("header", { class: "top" }, this.title, this.outcome, this.progress, this.link);
    // Orders come first, so that messages do not move them under a finger.
    const orders = [controls?.element, controls?.question];
    const urgent = element("div", { class: "urgent" }, ...orders, this.lost, controls?.why, controls?.became);
    const below = [time.element, this.tabs(), panelOf("charts", charts.element)];
    const main = element("main", { class: "middle" }, stage, ...below);
    this.root.dataset["tab"] = "vehicles";
    this.root.replaceChildren(header, urgent);
    return { time, vehicles, messages, decisions, charts, layers, controls, main, side };
  }

  /** Tabs for phones, which show one panel at a time. */
  private tabs(): HTMLElement {
    const tabs = ["vehicles", "charts", "messages", "decisions"].map((name) => {
      const choose = (): void => {
        this.root.dataset["tab"] = name;
        for (const one of tabs) one.setAttribute("aria-pressed", String(one === tab));
        this.dirty = this.stale = true;
      };
      const tab = button(capital(name), choose, { "aria-pressed": String(name === "vehicles"), class: `tab-${name}` });
      return tab;
    });
    return element("nav", { class: "tabs", "aria-label": "Panels" }, ...tabs);
  }

  /** Keep the views of two maps equal. */
  private join(): void {
    let moving = false;
    for (const { map } of this.maps)
      map.on("move", () => {
        if (moving) return;
        moving = true;
        for (const other of this.maps)
          if (other.map !== map) other.map.setView(map.getCenter(), map.getZoom(), { animate: false });
        moving = false;
      });
  }

  /** Show the age of the data. */
  linked(): void {
    const { lost_ms, isLost, age_s } = this.heart;
    const model = this.models[0]!;
    const ended = model.status && !model.runs;
    const isOld = !ended && this.heart.isOld;
    const quiet = isOld || !model.runs ? [] : this.quiet(model);
    let words = "Live";
    if (ended) words = "Ended";
    else if (isOld) words = age_s === null ? "Connection lost" : `No news for ${clock(age_s)}`;
    else if (age_s === null) words = "Connecting …";
    else if (quiet.length) words = "Vehicle not heard";
    else if (age_s >= TOLD_S || lost_ms !== null) words = `${Math.floor(age_s)} s old`;
    setText(this.link, words);
    const isBad = isOld || quiet.length > 0;
    this.link.dataset["state"] = isBad ? "lost" : words === "Live" ? "live" : "";
    // Changes are read aloud, so the seconds are shown elsewhere.
    let warns = quiet.length ? `No news of ${quiet.join(", ")}: the page shows old data.` : "";
    if (isOld) warns = `${this.heart.trouble}: the page shows old data${isLost ? ". Trying again …" : ", and takes no orders."}`;
    setText(this.lost, warns);
    this.root.classList.toggle("old", isOld);
    this.parts.controls?.show();
    if (age_s !== null && age_s >= 1 && !ended) this.dirty = true; // The age of the data grows
  }

  /** Names of silent vehicles while the program is alive: the armed ones, or all. */
  private quiet(model: Model): string[] {
    const states = model.vehicles.map(({ system_id }) => ({ system_id, now: model.vehicleAt(system_id, model.end_s) }));
    const known = states.filter(({ now }) => now);
    const quiet = known.filter(({ now }) => now?.silent);
    const told = quiet.length === known.length ? quiet : quiet.filter(({ now }) => now?.armed);
    return told.map(({ system_id }) => model.nameOf(system_id));
  }

  private frame(now_ms: number): void {
    requestAnimationFrame((next_ms) => this.frame(next_ms));
    const { parts } = this;
    parts.time.tick(now_ms);
    const end_s = Math.max(...this.models.map((model) => model.end_s));
    if (this.dirty) {
      this.dirty = false;
      parts.time.reach(end_s);
      for (const map of this.maps) map.show(parts.time.time_s);
      parts.time.show();
      this.stale = true;
    }
    const scale = this.maps[0]?.picture?.scale;
    if (scale !== this.scale) this.stale = true; // Layers are decoded asynchronously, and the legend follows
    this.scale = scale;
    if (this.stale && now_ms - this.panelsAt_ms > PANELS_MS) {
      this.panelsAt_ms = now_ms;
      this.stale = now_ms - this.chartsAt_ms <= CHARTS_MS;
      this.showPanels();
      if (!this.stale) {
        this.chartsAt_ms = now_ms;
        parts.charts.show(parts.time.time_s, end_s);
      }
    }
  }

  private showPanels(): void {
    const { parts } = this;
    const time_s = parts.time.time_s;
    const model = this.models[0]!;
    parts.vehicles.show(time_s);
    parts.messages.show(time_s);
    parts.decisions.show(time_s);
    parts.layers.show(this.maps[0]!.picture);
    parts.controls?.show();
    this.root.classList.toggle("decides", parts.decisions.any);
    this.root.classList.toggle("compares", this.choice.compare);
    const titles = this.models.map((one) => [one.letter, one.run?.title].filter(Boolean).join(": "));
    setText(this.title, titles.join("  |  ") || "wbf-mission");
    for (const [k, heading] of this.root.querySelectorAll(".of-run").entries())
      setText(heading, [titles[k], scoreLine(this.models[k]!, time_s)].filter(Boolean).join(" · "));
    const { status } = model;
    const over = status && status.outcome !== "running";
    const words = over ? [status.words, status.reason] : [scoreLine(model, time_s)];
    const several = this.models.length > 1 ? [] : words;
    setText(this.outcome, capital([...several, model.dayAt(time_s)].filter(Boolean).join(" · ")));
    this.outcome.dataset["state"] = over ? (LOOKS[status.outcome] ?? "bad") : "running";
    const doing = status?.progress;
    setText(this.progress, doing ? [capital(doing.what), doing.total > 0 ? percent(doing.done / doing.total) : ""].join(" ").trim() : "");
    const isOld = this.root.classList.contains("old") ? "Old" : "";
    document.title = [isOld, clock(time_s), titles.join(" | ")].filter(Boolean).join(" · ");
  }
}

const kept = document.getElementById("recording");
// A report opens at its summary, also after a reload.
if (kept && !location.hash) history.scrollRestoration = "manual";
if (kept) void read(kept).then((recordings) => new App(recordings));
else new App([]).linked();
