// Map of one run: farm, layer, readings, plans, trails and vehicles.
import * as L from "leaflet";
import { CanvasLayer, Frame, type Draw, type View } from "./canvas.js";
import { lifted, onTheme, themed, vehicleColour } from "./colours.js";
import { element, setText, svg } from "./dom.js";
import {
  drawBorders, drawDecision, drawFarm, drawPicture, drawPlan, drawReadings, drawSplit, drawTrail, oldUntil,
} from "./draw.js";
import { upTo, type Model, type Moment } from "./model.js";
import type { Decision, Run, States, Update, VehicleInfo } from "./schema.js";
import { kindName, Picture } from "./tiles.js";

export const KINDS = ["value", "uncertainty", "truth", "acquisition", "none"] as const;

/** Displayed parts of a run at the start; the reader chooses others in `layers.ts`. */
export const AT_START = {
  field: "",
  kind: "value" as (typeof KINDS)[number],
  /** Whether to show the truth right of the handle and the layer left of it. */
  compare: false,
  split: 0.5,
  opacity: 0.85,
  crops: true,
  plans: true,
  trails: true,
  readings: true,
  decisions: true,
};
export type Choice = typeof AT_START;

export function layerName(choice: Choice): string | null {
  if (choice.kind === "none") return null;
  return choice.kind === "acquisition" ? "acquisition" : `${choice.kind}/${choice.field}`;
}

const NOWHERE = new Frame({ lat: 0, lon: 0, lat_x: 0, lat_y: 9e-6, lon_x: 9e-6, lon_y: 0 });
export const CLOSEST = 27;
/** Maximum number of vehicles whose fences are all drawn; above it, only the selected one's. */
const FEW = 3;
const SHAPES: Record<string, string> = {
  plane: "M0-13 L2.4-4 L13 2 V5 L2.4 3 L1.8 9 L5 11.5 V13 H-5 V11.5 L-1.8 9 L-2.4 3 L-13 5 V2 L-2.4-4 Z",
  rover: "M-7 11 V-6 L0-13 L7-6 V11 Z",
  copter: "M0-13 L9 10 L0 5 L-9 10 Z",
};

class VehicleMark {
  readonly marker: L.Marker;
  private readonly note = element("span", { class: "note" });

  constructor(map: L.Map, info: VehicleInfo, name: string, colour: string, chosen: () => void) {
    const body = svg("path", { d: SHAPES[info.kind] ?? SHAPES["copter"]!, class: "body" });
    const picture = svg("svg", { viewBox: "-18 -18 36 36", "aria-hidden": "true" }, body);
    const html = element("div", { "--vehicle": colour }, picture, element("span", { class: "name" }, name), this.note);
    const icon = L.divIcon({ html, className: "vehicle", iconSize: [36, 36] });
    this.marker = L.marker([0, 0], { icon, zIndexOffset: 1000 }).addTo(map).on("click", chosen);
    this.marker.getElement()?.setAttribute("aria-label", `Vehicle ${name}`);
  }

  show(place: L.LatLng, moment: Moment, selected: boolean): void {
    this.marker.setLatLng(place);
    const { classList, style } = this.marker.getElement()!;
    style.setProperty("--heading", `${moment.heading_deg ?? 0}deg`);
    classList.toggle("silent", moment.silent);
    classList.toggle("selected", selected);
    setText(this.note, moment.silent ? `no news for ${Math.round(moment.silent_s)} s` : "");
  }
}

/** Map with zoom buttons and a scale. */
export function mapIn(room: HTMLElement, options: L.MapOptions = {}): L.Map {
  const shared = { attributionControl: false, zoomControl: false, zoomSnap: 0.25, wheelPxPerZoomLevel: 90 };
  const map = L.map(room, { ...shared, maxZoom: CLOSEST, ...options });
  L.control.zoom({ position: "topright" }).addTo(map);
  L.control.scale({ position: "bottomright", imperial: false }).addTo(map);
  return map;
}

/** Show the user's map tiles as the background. */
export function showTiles(map: L.Map, tiles: NonNullable<Update["background"]>): L.TileLayer {
  const note = L.control.attribution({ position: "bottomright", prefix: false }).addTo(map);
  note.getContainer()!.textContent = tiles.attribution;
  const zooms = { minNativeZoom: tiles.min_zoom, maxNativeZoom: tiles.max_zoom, maxZoom: CLOSEST };
  return L.tileLayer("tiles/{z}/{x}/{y}", zooms).addTo(map);
}

export class MapView {
  private readonly moves = this.animated && !matchMedia("(prefers-reduced-motion: reduce)").matches;
  private readonly animations = { zoomAnimation: this.moves, fadeAnimation: this.moves, inertia: this.moves };
  readonly map = mapIn(this.container, this.animations).setView([0, 0], 18, { animate: false });
  private frame = NOWHERE;
  private run: Run | null = null;
  picture: Picture | null = null;
  private truth: Picture | null = null;
  private readonly marks = new Map<number, VehicleMark>();
  private readonly layers: Record<"ground" | "values" | "readings" | "trails" | "lines", CanvasLayer>;
  /** Whether the reader has moved the map, which then stays there. */
  private touched = false;
  private pointer: L.LatLng | null = null;
  private time_s = 0;
  private seen = 0;
  private old_s = 0;
  private background: L.TileLayer | null = null;
  decision: Decision | null = null;
  selected: number | null = null;

  constructor(
    readonly container: HTMLElement,
    private readonly model: Model,
    private readonly choice: Choice,
    private readonly told: (text: string) => void,
    private readonly select: (system_id: number) => void,
    /** Width of the map's left part under other elements. */
    private readonly covered_px: () => number,
    private readonly animated: boolean,
  ) {
    const canvas = (name: string, order: number, heavy: boolean, draw: Draw): CanvasLayer => {
      this.map.createPane(name).style.zIndex = String(order);
      return new CanvasLayer(name, () => this.frame, draw, heavy).addTo(this.map);
    };
    this.layers = {
      ground: canvas("ground", 250, false, (context, view) => {
        if (this.run?.farm && this.choice.crops) drawFarm(context, view, this.run.farm);
      }),
      values: canvas("values", 300, false, (context, view) => {
        const split = this.truth ? this.choice.split : 1;
        if (this.picture) drawPicture(context, view, this.picture, 0, split);
        if (this.truth) drawPicture(context, view, this.truth, split, 1);
      }),
      readings: canvas("readings", 350, true, (context, view) => {
        const [field, raster] = [this.model.field(this.choice.field), this.run?.raster];
        if (!this.choice.readings || !field || !raster) return;
        drawReadings(context, view, this.model, field, this.time_s, raster.pixel_m / raster.cells);
      }),
      trails: canvas("trails", 375, true, (context, view) => {
        if (this.choice.trails)
          for (const [id, states] of this.states()) drawTrail(context, view, states, this.time_s, this.colour(id), null);
      }),
      lines: canvas("lines", 400, false, (context, view) => this.drawLines(context, view)),
    };
    onTheme(() => this.redraw());
    for (const kind of ["pointerdown", "wheel", "keydown"])
      container.addEventListener(kind, () => (this.touched = true), { passive: true });
    new ResizeObserver(() => {
      this.map.invalidateSize({ animate: false });
      this.refit();
    }).observe(container);
    this.map.on("mousemove click", (event) => this.read((event as L.LeafletMouseEvent).latlng));
    this.map.on("mouseout", () => this.read(null));
  }

  /** Fit the map again, unless the reader has moved it. */
  refit(): void {
    if (!this.touched) this.fit();
  }

  /** Show the whole farm, or without a farm all vehicle positions. */
  fit(): void {
    this.touched = false;
    const farm = this.run?.farm;
    const [width, height] = [farm?.width_m ?? 0, farm?.height_m ?? 0];
    const corners = [[0, 0], [width, 0], [0, height], [width, height]] as const;
    const flown = this.states().flatMap(([, { x, y }]) => x.map((left, k) => [left, y[k]!] as const));
    const places = (farm ? corners : flown).map(([x, y]) => this.frame.latLng(x, y));
    if (!places.length) return;
    const [paddingTopLeft, paddingBottomRight] = [L.point(28 + this.covered_px(), 28), L.point(28, 28)];
    const shown = { paddingTopLeft, paddingBottomRight, maxZoom: CLOSEST - 1, animate: false };
    this.map.fitBounds(L.latLngBounds(places), shown);
  }

  goTo(system_id: number): void {
    const mark = this.marks.get(system_id);
    if (mark) this.map.panTo(mark.marker.getLatLng());
  }

  /** Merge all canvases into one for printing, as browsers do not print transparent canvases. */
  print(begins: boolean): void {
    this.map.invalidateSize({ animate: false });
    this.fit();
    this.container.querySelector(".on-paper")?.remove();
    if (!begins) return;
    const { width, height } = this.layers.lines.canvas;
    const paper = element("canvas", { class: "on-paper", width, height });
    const context = paper.getContext("2d")!;
    context.fillStyle = themed("field");
    context.fillRect(0, 0, width, height);
    for (const [name, { canvas }] of Object.entries(this.layers)) {
      context.globalAlpha = name === "values" ? this.choice.opacity : 1;
      context.drawImage(canvas, 0, 0);
    }
    this.container.prepend(paper);
  }

  /** Redraw everything after a change of the choices. */
  redraw(): void {
    this.container.querySelector<HTMLElement>(".leaflet-values-pane")!.style.opacity = String(this.choice.opacity);
    for (const layer of Object.values(this.layers)) layer.redraw();
  }

  show(time_s: number): void {
    this.time_s = time_s;
    if (this.model.run !== this.run) this.takeRun(this.model.run);
    if (this.model.background) this.background ??= showTiles(this.map, this.model.background);
    this.picture = this.pictureOf(layerName(this.choice), this.picture);
    this.truth = this.choice.compare ? this.pictureOf(`truth/${this.choice.field}`, this.truth) : null;
    void this.picture?.show(time_s);
    void this.truth?.show(time_s);
    let away = false;
    for (const [k, info] of this.model.vehicles.entries()) {
      const { system_id: id } = info;
      const moment = this.model.vehicleAt(id, time_s);
      if (!moment) continue;
      const name = this.model.nameOf(id);
      const mark =
        this.marks.get(id) ?? new VehicleMark(this.map, info, name, vehicleColour(k), () => this.select(id));
      this.marks.set(id, mark);
      mark.show(this.frame.latLng(moment.x, moment.y), moment, id === this.selected);
      away ||= !this.map.getBounds().pad(-0.04).contains(mark.marker.getLatLng());
    }
    if (away && !this.run?.farm) this.refit();
    const [seen, old_s] = [upTo(this.model.readings.time_s, time_s), oldUntil(time_s)];
    if (seen !== this.seen) this.layers.readings.redraw();
    if (old_s !== this.old_s) this.layers.trails.redraw();
    [this.seen, this.old_s] = [seen, old_s];
    this.layers.lines.redraw();
  }

  private takeRun(run: Run | null): void {
    const before = this.run?.farm;
    this.run = run;
    for (const { marker } of this.marks.values()) marker.remove();
    this.marks.clear();
    if (run?.farm && JSON.stringify(run.farm) !== JSON.stringify(before)) {
      this.frame = new Frame(run.farm.georeference);
      this.fit();
      performance.mark("map drawn");
    }
    this.redraw();
  }

  private pictureOf(name: string | null, old: Picture | null): Picture | null {
    const raster = this.run?.raster;
    if (!name || !raster || !this.model.tiles.has(name)) {
      if (old) this.layers.values.redraw();
      return null;
    }
    if (old?.layer === name && old.raster === raster && old.tiles === this.model.tiles) return old;
    const redraw = (): void => {
      this.layers.values.redraw();
      if (this.pointer) this.read(this.pointer);
    };
    redraw();
    const field = this.model.field(name.slice(name.indexOf("/") + 1));
    return new Picture(name, raster, field, this.model.tiles, redraw);
  }

  private colour(system_id: number): string {
    return lifted(Math.max(0, this.model.vehicles.findIndex((info) => info.system_id === system_id)));
  }

  /** States of all vehicles with any. */
  private states(): [number, States][] {
    const { states, vehicles } = this.model;
    return vehicles.flatMap(({ system_id: id }) => (states[id] ? [[id, states[id]]] : []));
  }

  private drawLines(context: CanvasRenderingContext2D, view: View): void {
    const { vehicles } = this.model;
    if (this.run?.farm) drawBorders(context, view, this.run.farm);
    for (const { system_id: id } of vehicles) {
      const plan = this.model.planAt(id, this.time_s);
      const fenced = vehicles.length <= FEW || id === this.selected;
      if (plan && this.choice.plans) drawPlan(context, view, plan, this.colour(id), fenced);
    }
    if (this.choice.trails)
      for (const [id, states] of this.states()) {
        const now = this.model.vehicleAt(id, this.time_s);
        if (now) drawTrail(context, view, states, this.time_s, this.colour(id), now);
      }
    if (this.choice.decisions && this.decision) drawDecision(context, view, this.decision, (id) => this.colour(id));
    if (this.picture && this.truth) drawSplit(context, view, this.choice.split, [kindName(this.choice.kind), "truth"]);
  }

  private read(place: L.LatLng | null): void {
    this.pointer = place;
    if (!place) return this.told("");
    const [x, y] = this.frame.metres(place);
    const values = [this.picture, this.truth].map((picture) => picture?.textAt(x, y));
    const degrees = this.run?.farm && `${place.lat.toFixed(7)}, ${place.lng.toFixed(7)}`;
    const parts = [...values, `x ${x.toFixed(1)} m, y ${y.toFixed(1)} m`, degrees];
    this.told(parts.filter(Boolean).join("  ·  "));
  }
}
