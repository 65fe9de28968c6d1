// Studio: drawing a farm, choosing options, and planning.
import * as L from "leaflet";
import { Answer } from "./answer.js";
import { Choices } from "./choices.js";
import { desk, keep, Refused, type Draft, type Options, type Planned } from "./desk.js";
import { button, element, find, findButton, setText } from "./dom.js";
import { keepDraft, keptDraft } from "./kept.js";
import { placeOf } from "./place.js";
import { Editor, type Tool } from "./editor.js";
import { CLOSEST, mapIn, showTiles } from "./map.js";
import { Outline } from "./outline.js";
import {
  changed, emptySketch, fileOf, History, sketchOf, withoutCorner, withRing, type Position, type Sketch,
} from "./sketch.js";
import { connect, Heart } from "./source.js";
import { Takeaway } from "./takeaway.js";
import { capital } from "./text.js";

/** Delay of planning after a change, so that fast changes are planned together. */
const WAIT_MS = 150;
/** Duration of planning from which the user may cancel it (s). */
const LONG_S = 3;

export class Studio {
  selected: number | null = null;
  /** Crop of new fields. */
  crop = "strawberry";
  private history = new History(emptySketch("new farm"));
  private readonly map = mapIn(find(".map")).setView([28.05, -82.15], 16, { animate: false });
  private readonly editor = new Editor(this.map, this);
  private readonly answer = new Answer(this.map);
  private readonly outline = new Outline(this, this.given.crops);
  private readonly choices = new Choices(this.given, () => this.planSoon());
  private readonly takeaway = new Takeaway(() => this.draft, this.given.formats);
  private readonly title = find("h1");
  private readonly hint = find(".hint");
  private readonly state = find(".top .pill");
  private readonly problem = find(".problem");
  /** Message that the program does not respond. */
  private readonly lost = find(".urgent .lost");
  private readonly heart = new Heart();
  private wasLost = false;
  private readonly mend = findButton(".mend", () => void this.mendDrawn());
  private readonly again = findButton("#plan-here", () => void this.plan());
  /** Error and remedies of a file or farm that could not be opened; the open farm stays. */
  private readonly unopened = find(".unopened");
  /** Latest sketch that is saved in a file or was not drawn. */
  private saved = this.sketch;
  /** Initial options of the program. */
  private readonly start = JSON.stringify(this.given.start);
  private keeps = true;
  private begun = false;
  private readonly tools = document.querySelectorAll<HTMLButtonElement>("[data-tool]");
  private readonly undo = findButton("#undo", () => this.travel(-1));
  private readonly redo = findButton("#redo", () => this.travel(1));
  private readonly farms = find<HTMLSelectElement>("#farms");
  private timer = 0;
  private asking: AbortController | null = null;
  private readonly giveUp = findButton("#give-up", () => void desk.cancel());

  constructor(private readonly root: HTMLElement, private readonly given: Options) {
    findButton("#new-farm", () => this.goOn(emptySketch("new farm"), true, ""));
    findButton("#open-file", () => file.click());
    findButton("#save-farm", () => this.saveFarm());
    const file = find<HTMLInputElement>("input[type=file]");
    file.onchange = () => {
      this.openFirst(file.files);
      file.value = "";
    };
    this.farms.append(...given.farms.map((name) => new Option(name)));
    this.farms.onchange = () => void this.open(this.farms.value);
    const place = find<HTMLInputElement>("#place");
    place.onchange = () => this.goTo(place.value);
    const crop = find<HTMLInputElement>("#crop");
    crop.onchange = () => (this.crop = crop.value.trim().toLowerCase() || this.crop);
    find("#new-crops").append(...given.crops.map((name) => new Option("", name)));
    for (const tool of this.tools) tool.onclick = () => this.take(tool.dataset["tool"] as Tool);
    if (given.background) showTiles(this.map, given.background);
    document.addEventListener("keydown", (event) => this.key(event));
    root.addEventListener("dragover", (event) => event.preventDefault());
    root.addEventListener("drop", (event) => {
      event.preventDefault();
      this.openFirst(event.dataTransfer?.files);
    });
    new ResizeObserver(() => this.map.invalidateSize({ animate: false })).observe(this.map.getContainer());
    this.take("select");
    window.addEventListener("beforeunload", (event) => this.unsaved && event.preventDefault());
    window.addEventListener("pagehide", () => this.keep());
    connect("beats", this.heart, { linked: () => this.look() });
    void this.begin();
  }

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
    this.history = new History(this.sketch);
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

  edit(sketch: Sketch, told: string): void {
    this.unopened.replaceChildren();
    this.history.push(sketch);
    this.tell(told);
    this.show();
    this.planSoon();
  }

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
    for (const one of this.tools) one.setAttribute("aria-pressed", String(one.dataset["tool"] === tool));
    if (tool !== "select") this.selected = null;
    this.editor.take(tool);
    this.show();
  }

  // --- The farm ---

  private saveFarm(): void {
    const text = JSON.stringify(fileOf(this.sketch), null, 1);
    const name = this.sketch.name.replace(/[^\p{L}\p{N}-]+/gu, "-") || "farm";
    keep(`${name}.geojson`, new Blob([text], { type: "application/geo+json" }));
    this.saved = this.sketch;
    this.keep();
  }

  private goTo(text: string): void {
    if (!text.trim()) return;
    const place = placeOf(text);
    if (typeof place === "string") return this.tell(place);
    this.map.setView(place, 17, { animate: false });
    this.tell(place.map((degrees) => Number(degrees.toFixed(7))).join(", "));
  }

  private openFirst(files: FileList | null | undefined): void {
    if (files?.[0]) void this.open(files[0]);
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
      const { document, notes } = await desk.mend(fileOf(this.sketch));
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
    this.undo.disabled = !this.history.can(-1);
    this.redo.disabled = !this.history.can(1);
    const { known } = this.sketch;
    this.farms.value = known !== null && this.given.farms.includes(known) ? known : "";
    setText(this.title, `Studio: ${this.sketch.name}`);
    document.title = `${this.sketch.name} · studio`;
  }

  // --- The plan ---

  private get draft(): Draft {
    return { farm: this.sketch.known ?? fileOf(this.sketch), options: this.choices.effective };
  }

  private planSoon(): void {
    clearTimeout(this.timer);
    this.asking?.abort(); // Its answer would be shown as the plan of what is drawn now
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
    if (superseded === "another page") return setText(this.state, "another page of the studio plans now");
    if (superseded) return setText(this.state, superseded);
    this.answer.clear();
    setText(this.state, "no plan");
    this.state.dataset["state"] = "bad";
    setText(this.problem, capital(error.message));
    this.mend.hidden = error.remedy !== "repair";
  }
}

const root = find("#studio");
const options = desk.options().finally(() => (root.hidden = false));
void options.then(
  (given) => new Studio(root, given),
  (error: unknown) => root.replaceChildren(element("p", { class: "lost", role: "alert" }, String(error))),
);
