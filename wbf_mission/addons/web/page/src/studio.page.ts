// Studio: drawing a farm, choosing options, and planning.
import * as L from "leaflet";
import { Answer } from "./answer.js";
import { Choices } from "./choices.js";
import { desk, keep, Refused, type Draft, type Options, type Planned } from "./desk.js";
import { button, datalist, element, entry, panel, setText } from "./dom.js";
import { keepDraft, keptDraft } from "./kept.js";
import { placeOf } from "./place.js";
import { Editor, TOOLS, type Tool } from "./editor.js";
import { CLOSEST, mapIn, showTiles } from "./map.js";
import { Outline } from "./outline.js";
import {
  changed, documentOf, emptySketch, History, sketchOf, withoutCorner, withRing, type Position, type Sketch,
} from "./sketch.js";
import { connect, Heart } from "./source.js";
import { Takeaway } from "./takeaway.js";
import { capital } from "./text.js";

/** Delay of planning after a change, so that fast changes are planned together. */
const WAIT_MS = 150;
/** Duration of planning from which the user may cancel it (s). */
const LONG_S = 3;
const MAP =
  "Map of the farm: arrow keys move it, plus and minus zoom; with a tool, the space bar sets a corner at the map's centre";
const FILES = ".geojson,.json,.kml,.kmz,.shp,.zip,.gpkg,.gpx";

export class Studio {
  selected: number | null = null;
  crop = "strawberry";
  private readonly history = new History(emptySketch("new farm"));
  private readonly room = element("div", { class: "map", tabindex: 0, role: "application", "aria-label": MAP });
  private readonly map = mapIn(this.room).setView([28.05, -82.15], 16, { animate: false });
  private readonly editor = new Editor(this.map, this);
  private readonly answer = new Answer(this.map);
  private readonly outline = new Outline(this, this.given.crops);
  private readonly choices = new Choices(this.given, () => this.planSoon());
  private readonly takeaway = new Takeaway(() => this.draft, this.given.formats);
  private readonly title = element("h1", {}, "Studio");
  private readonly hint = element("output", { class: "hint", "aria-live": "polite" });
  private readonly state = element("span", { class: "pill", role: "status" });
  private readonly problem = element("p", { class: "lost problem", role: "alert" });
  /** Message that the program does not respond. */
  private readonly lost = element("p", { class: "lost", role: "alert" });
  private readonly heart = new Heart();
  private wasLost = false;
  private readonly mend = button("Mend it", () => void this.mendDrawn(), { class: "mend", hidden: true });
  private readonly again = button("Plan here", () => void this.plan(), { hidden: true });
  /** Error and remedies of a file or farm that could not be opened; the open farm stays. */
  private readonly unopened = element("div", { class: "unopened", role: "alert" });
  /** Latest sketch that is saved in a file or was not drawn. */
  private saved = this.sketch;
  private keeps = true;
  private begun = false;
  private readonly tools = new Map<Tool, HTMLButtonElement>();
  private readonly undoButton = button("Undo", () => this.travel(-1), { title: "Ctrl+Z" });
  private readonly redoButton = button("Redo", () => this.travel(1), { title: "Ctrl+Shift+Z" });
  private readonly farms = element(
    "select",
    { id: "farms", "aria-label": "Farm", onchange: ({ value }) => void this.open(value) },
    element("option", { value: "", hidden: true }, "drawn or opened here"),
    ...this.given.farms.map((name) => new Option(name, name)),
  );
  private readonly file = element("input", {
    type: "file",
    accept: FILES,
    class: "hidden",
    "aria-label": "Farm file",
    tabindex: "-1",
    onchange: (made) => {
      const [chosen] = made.files ?? [];
      made.value = "";
      if (chosen) void this.open(chosen);
    },
  });
  private timer = 0;
  private asking: AbortController | null = null;
  private readonly giveUp = button("Give up", () => void desk.cancel(), { hidden: true, title: "End the planning" });

  constructor(private readonly root: HTMLElement, private readonly given: Options) {
    const { cards, findings } = this.answer;
    const told = [this.unopened, this.problem, this.mend, cards, findings];
    const results = element("section", { class: "results", "aria-label": "The plan" }, ...told);
    const side = element(
      "aside",
      { class: "side", "aria-label": "Farm, options, and uses of the plan" },
      panel("Farm", { class: "panel" }, this.farmLine(), this.toolbar(), this.outline.element),
      panel("Plan", { class: "panel" }, this.choices.element),
      panel("Take it along", { class: "panel" }, this.takeaway.element),
    );
    root.replaceChildren(
      element("header", { class: "top" }, this.title, this.undoButton, this.redoButton, this.giveUp, this.again, this.state),
      element("div", { class: "urgent" }, this.lost),
      element("main", { class: "middle" }, element("div", { class: "stage" }, this.room, this.hint), results),
      side,
    );
    if (given.background) showTiles(this.map, given.background);
    document.addEventListener("keydown", (event) => this.key(event));
    root.addEventListener("dragover", (event) => event.preventDefault());
    root.addEventListener("drop", (event) => {
      event.preventDefault();
      const chosen = event.dataTransfer?.files[0];
      if (chosen) void this.open(chosen);
    });
    new ResizeObserver(() => this.map.invalidateSize({ animate: false })).observe(this.room);
    this.take("select");
    window.addEventListener("beforeunload", (event) => this.unsaved && event.preventDefault());
    window.addEventListener("pagehide", () => this.keep());
    connect("beats", this.heart, { linked: () => this.look() });
    void this.begin();
  }

  /** Show whether the program responds. */
  private look(): void {
    const { isOld, isLost } = this.heart;
    const rest = "nothing can be planned, saved or flown. The drawing stays in this browser. Trying again …";
    setText(this.lost, isOld ? `${this.heart.trouble}: ${rest}` : "");
    this.root.classList.toggle("old", isOld);
    // Requests during the loss of the connection got no answer.
    if (this.wasLost && this.heart.isFresh) this.planSoon();
    this.wasLost = isLost || (this.wasLost && !this.heart.isFresh);
  }

  /** Open the initial farm, and restore an earlier drawing on top of it. */
  private async begin(): Promise<void> {
    const kept = keptDraft(this.given.options);
    await this.open(this.given.start.farm);
    this.history.forget();
    this.saved = this.sketch;
    this.begun = true;
    if (!kept) return this.show();
    const goesOn = kept.start === this.start;
    const { sketch } = kept;
    if (goesOn) this.choices.take(kept.values);
    const drawn = sketch.known === null && sketch.shapes.length > 0;
    if (!(drawn || (goesOn && sketch.known !== null && sketch.known !== this.sketch.known))) return this.show();
    this.goOn(sketch, !kept.unsaved, "This is your earlier drawing; Undo shows the farm with which the program began");
    this.fit();
  }

  /** Initial options of the program. */
  private get start(): string {
    return JSON.stringify(this.given.start);
  }

  private get unsaved(): boolean {
    return this.editor.drawing || (this.sketch.known === null && this.sketch.shapes.length > 0 && this.sketch !== this.saved);
  }

  private keep(): void {
    if (!this.begun) return;
    const kept = keepDraft({ sketch: this.sketch, values: this.choices.values, start: this.start, unsaved: this.unsaved });
    if (this.keeps && !kept) this.tell("The browser does not keep this draft: save the farm before you leave");
    this.keeps = kept;
  }

  // --- For the editor and the list of shapes ---

  get sketch(): Sketch {
    return this.history.now;
  }

  /** Take over a finished edit. */
  edit(sketch: Sketch, told: string): void {
    this.unopened.replaceChildren();
    this.history.push(sketch);
    this.tell(told);
    this.show();
    this.planSoon();
  }

  /** Take over a change of the farm. */
  change(change: Partial<Sketch>, told: string): void {
    this.edit(changed(this.sketch, change), told);
  }

  setRing(number: number, ring: number, positions: Position[], told: string): void {
    this.edit(withRing(this.sketch, number, ring, positions), told);
  }

  deleteCorner(number: number, ring: number, corner: number): void {
    this.edit(withoutCorner(this.sketch, number, ring, corner), "Corner deleted");
  }

  select(number: number | null): void {
    this.selected = number;
    this.show();
  }

  tell(text: string): void {
    setText(this.hint, text);
  }

  take(tool: Tool): void {
    for (const [name, one] of this.tools) one.setAttribute("aria-pressed", String(name === tool));
    if (tool !== "select") this.selected = null;
    this.editor.take(tool);
    this.show();
  }

  // --- The farm ---

  private farmLine(): HTMLElement {
    const fresh = button("New farm", () => this.goOn(emptySketch("new farm"), true, ""), {
      title: "Begin with an empty map at this place",
    });
    const load = button("Open file …", () => this.file.click());
    const save = button("Save farm", () => {
      const text = JSON.stringify(documentOf(this.sketch), null, 1);
      const name = this.sketch.name.replace(/[^\p{L}\p{N}-]+/gu, "-") || "farm";
      keep(`${name}.geojson`, new Blob([text], { type: "application/geo+json" }));
      this.saved = this.sketch;
      this.keep();
    });
    const place = entry({ placeholder: "28.05, -82.15" }, (text) => this.goTo(text));
    return element(
      "div",
      { class: "farm" },
      this.farms,
      element("div", { class: "line" }, fresh, load, save),
      this.file,
      element("label", { class: "crop" }, "Go to latitude, longitude", place),
    );
  }

  private goTo(text: string): void {
    if (!text) return;
    const place = placeOf(text);
    if (typeof place === "string") return this.tell(place);
    this.map.setView(place, 17, { animate: false });
    this.tell(place.map((degrees) => Number(degrees.toFixed(7))).join(", "));
  }

  /** Open a known farm by name, or a file. */
  private async open(source: string | File, how: Record<string, string> = {}): Promise<void> {
    this.unopened.replaceChildren();
    const isFile = source instanceof File;
    try {
      const { document, notes } = await (isFile ? desk.read(source, how) : desk.farm(source));
      this.goOn(sketchOf(document, isFile ? null : source), true, notes.join("; "));
      this.fit();
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      this.show();
      const remedies = isFile ? this.remedies(error, source) : [];
      this.unopened.replaceChildren(element("p", { class: "lost" }, capital(error.message)), ...remedies);
    }
  }

  /** Remedies for a refused file. */
  private remedies({ remedy }: Refused, file: File): HTMLElement[] {
    const again = (how: Record<string, string>): void => void this.open(file, how);
    if (remedy === "repair") return [button("Mend it", () => again({ repair: "true" }))];
    if (remedy === "crop") return [button(`Crop: ${this.crop}`, () => again({ crop: this.crop }))];
    if (remedy !== "crs") return [];
    const system = element("input", { type: "text", placeholder: "EPSG:32617", autocomplete: "off" });
    const open = button("Open it", () => again({ crs: system.value.trim() }));
    return [element("label", { class: "crop" }, "Coordinate system", system), open];
  }

  /** Repair the drawing, for example a ring that crosses itself; undoable. */
  private async mendDrawn(): Promise<void> {
    try {
      const { document, notes } = await desk.mend(documentOf(this.sketch));
      this.selected = null;
      this.edit(sketchOf(document, null), notes.join("; "));
    } catch (error) {
      this.refused(error);
    }
  }

  /** Replace the farm; undoable. */
  private goOn(sketch: Sketch, isSaved: boolean, told: string): void {
    this.unopened.replaceChildren();
    this.history.push(sketch);
    if (isSaved) this.saved = sketch;
    this.selected = null;
    this.take(sketch.shapes.length ? "select" : "field");
    if (told) this.tell(told);
    this.planSoon();
  }

  private get corners(): L.LatLng[] {
    return this.sketch.shapes.flatMap(({ rings }) => rings[0]!.map(([lon, lat]) => L.latLng(lat, lon)));
  }

  private fit(): void {
    const bounds = L.latLngBounds(this.corners);
    if (bounds.isValid()) this.map.fitBounds(bounds, { padding: [30, 30], maxZoom: CLOSEST - 2, animate: false });
  }

  private toolbar(): HTMLElement {
    for (const tool of Object.keys(TOOLS) as Tool[])
      this.tools.set(tool, button(TOOLS[tool][0], () => this.take(tool), { "aria-pressed": "false" }));
    const attributes = { list: "new-crops", maxlength: 40, value: this.crop };
    const crop = entry(attributes, (text) => (this.crop = text.toLowerCase() || this.crop));
    return element(
      "div",
      {},
      element("div", { class: "tools", role: "toolbar", "aria-label": "Draw" }, ...this.tools.values()),
      element("label", { class: "crop" }, "Crop of new fields", crop),
      datalist("new-crops", this.given.crops),
    );
  }

  private travel(go: -1 | 1): void {
    this.history.travel(go);
    if (this.selected !== null && this.selected >= this.sketch.shapes.length) this.selected = null;
    this.tell(go < 0 ? "Undone" : "Redone");
    this.unopened.replaceChildren();
    this.show();
    const seen = this.map.getBounds();
    if (!this.corners.some((corner) => seen.contains(corner))) this.fit();
    this.planSoon();
  }

  private key(event: KeyboardEvent): void {
    const typing = event.target instanceof HTMLInputElement && event.target.type !== "checkbox";
    if (typing) return;
    const letter = event.ctrlKey || event.metaKey ? event.key.toLowerCase() : "";
    if (letter === "z") this.travel(event.shiftKey ? 1 : -1);
    else if (letter === "y") this.travel(1);
    else return this.editor.key(event);
    event.preventDefault();
  }

  private show(): void {
    this.editor.show();
    this.outline.show();
    this.undoButton.disabled = !this.history.can(-1);
    this.redoButton.disabled = !this.history.can(1);
    const { known } = this.sketch;
    this.farms.value = known !== null && this.given.farms.includes(known) ? known : "";
    setText(this.title, `Studio: ${this.sketch.name}`);
    document.title = `${this.sketch.name} · studio`;
  }

  // --- The plan ---

  private get draft(): Draft {
    return { farm: this.sketch.known ?? documentOf(this.sketch), options: this.choices.effective };
  }

  private planSoon(): void {
    clearTimeout(this.timer);
    this.root.classList.add("stale");
    this.timer = window.setTimeout(() => {
      this.keep();
      void this.plan();
    }, WAIT_MS);
  }

  private async plan(): Promise<void> {
    this.asking?.abort();
    this.takeaway.show(null);
    this.again.hidden = true;
    delete this.state.dataset["state"];
    if (!this.sketch.shapes.some(({ kind }) => kind === "field")) {
      this.answer.clear();
      setText(this.problem, "");
      return setText(this.state, "draw a field");
    }
    const asking = (this.asking = new AbortController());
    setText(this.state, "planning …");
    const begun_ms = performance.now();
    const clock = window.setInterval(() => {
      const seconds = Math.round((performance.now() - begun_ms) / 1000);
      this.giveUp.hidden = seconds < LONG_S;
      if (seconds >= LONG_S) setText(this.state, `planning for ${seconds} s …`);
    }, 1000);
    try {
      this.showPlan(await desk.plan(this.draft, asking.signal));
    } catch (error) {
      if (!asking.signal.aborted) this.refused(error); // Otherwise a newer draft replaces it
    } finally {
      clearInterval(clock);
      this.giveUp.hidden = true;
    }
  }

  private showPlan(planned: Planned): void {
    this.root.classList.remove("stale");
    setText(this.problem, "");
    this.answer.show(planned);
    this.takeaway.show(planned);
    setText(this.state, `planned in ${(planned.plan_s + planned.check_s).toFixed(1)} s`);
    const findings = planned.missions.flatMap((mission) => mission.findings);
    this.state.dataset["state"] = findings.some(({ severity }) => severity === "error") ? "bad" : "good";
  }

  private refused(error: unknown): void {
    if (!(error instanceof Refused)) throw error;
    const { superseded } = error;
    this.again.hidden = !superseded;
    if (superseded) return setText(this.state, superseded === "given up" ? superseded : "another page of the studio plans now");
    this.answer.clear();
    setText(this.state, "no plan");
    this.state.dataset["state"] = "bad";
    setText(this.problem, capital(error.message));
    this.mend.hidden = error.remedy !== "repair";
  }
}

const root = document.getElementById("studio")!;
void desk.options().then(
  (options) => new Studio(root, options),
  (error: unknown) => root.replaceChildren(element("p", { class: "lost", role: "alert" }, String(error))),
);
