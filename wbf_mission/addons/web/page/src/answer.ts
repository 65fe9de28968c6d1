// A plan on the map, with its figures and the findings of the preflight check.
import * as L from "leaflet";
import { Frame } from "./canvas.js";
import { vehicleColour } from "./colours.js";
import type { Finding, Planned } from "./desk.js";
import { button, element, find } from "./dom.js";
import type { Ring } from "./schema.js";
import { capital, duration, metres } from "./text.js";

const MOST_FINDINGS = 50;

export class Answer {
  private readonly cards = find(".figures");
  private readonly findings = find(".findings");
  private readonly lines = L.layerGroup().addTo(this.map);
  private readonly spot = L.layerGroup().addTo(this.map);
  private frame: Frame | null = null;
  private spacing_m: number | null = null;

  constructor(private readonly map: L.Map) {
    map.createPane("plans").style.zIndex = "450";
    map.on("zoomend", () => this.weigh());
  }

  show(planned: Planned): void {
    this.clear();
    this.frame = new Frame(planned.farm.georeference);
    this.draw(planned);
    const cards = figures(planned).map(([name, value, more]) => {
      const figure = element("dd", {}, value, more ? element("small", {}, more) : null);
      return element("div", {}, element("dt", {}, name), figure);
    });
    this.cards.replaceChildren(...cards);
    const found = planned.missions.flatMap(({ name, findings, warnings }) => [
      ...warnings.map((told) => this.row(name, { severity: "warning", told })),
      ...findings.map((finding) => this.row(name, finding)),
    ]);
    const notes = planned.notes.map((told) => this.row("farm", { severity: "note", told }));
    const rank = ["error", "warning", "note"];
    const rows = [...found, ...notes].sort((a, b) => rank.indexOf(a.className) - rank.indexOf(b.className));
    this.findings.replaceChildren(...rows.slice(0, MOST_FINDINGS));
    if (rows.length > MOST_FINDINGS) this.findings.append(element("li", {}, `and ${rows.length - MOST_FINDINGS} more`));
  }

  clear(): void {
    this.lines.clearLayers();
    this.spot.clearLayers();
    this.cards.replaceChildren();
    this.findings.replaceChildren();
  }

  /** Finding of a mission, or of the farm. */
  private row(name: string, { severity, told, code, place_m }: Finding): HTMLElement {
    const text = [name, told].filter(Boolean).join(": ");
    const what = place_m
      ? button(text, () => this.point(place_m), { title: "Show it on the map" })
      : element("span", {}, text);
    const grade = element("b", {}, capital(severity));
    return element("li", { class: severity }, grade, what, code ? element("code", {}, code) : null);
  }

  private point([x, y]: [number, number]): void {
    const place = this.frame!.latLng(x, y);
    this.spot.clearLayers();
    const ring = { radius: 16, className: "spot", fill: false, pane: "plans", interactive: false };
    L.circleMarker(place, ring).addTo(this.spot);
    this.map.panTo(place);
  }

  private latLngs(ring: Ring): L.LatLng[] {
    return Array.from({ length: ring.length / 2 }, (_, k) => this.frame!.latLng(ring[2 * k]!, ring[2 * k + 1]!));
  }

  /** Thin lines where rows are close together, so that the field stays visible between them. */
  private weigh(): void {
    const place = (y_m: number): L.Point => this.map.latLngToLayerPoint(this.frame!.latLng(0, y_m));
    const apart_px = this.frame && this.spacing_m ? place(0).distanceTo(place(this.spacing_m)) : Infinity;
    const pane = this.map.getPane("plans")!;
    pane.style.setProperty("--weight", `${Math.min(2.5, Math.max(0.8, apart_px / 4))}px`);
    pane.classList.toggle("dense", apart_px < 8);
  }

  private draw(planned: Planned): void {
    this.spacing_m = planned.vehicles[0]?.spacing_m ?? null;
    for (const [k, { plan }] of planned.missions.entries()) {
      const path = this.latLngs(plan.path);
      const home = this.frame!.latLng(...planned.farm.home_m);
      const style = (className: string): L.PolylineOptions => {
        return { className, color: vehicleColour(k), fill: false, pane: "plans", interactive: false };
      };
      for (const name of ["halo", "path"]) L.polyline(path, style(name)).addTo(this.lines);
      for (const end of [path[0], path.at(-1)]) if (end) L.polyline([home, end], style("way")).addTo(this.lines);
      for (const ring of plan.fence.flatMap(({ rings }) => rings))
        L.polygon(this.latLngs(ring), style("fence")).addTo(this.lines);
    }
    this.weigh();
  }
}

/** Figures of a plan: name, value, and details. */
function figures({ vehicles, missions, coverage }: Planned): [string, string, string][] {
  const sum = (part: (one: Planned["vehicles"][number]) => number): number =>
    vehicles.reduce((all, one) => all + part(one), 0);
  const longest_s = Math.max(...vehicles.map((one) => one.time_with_changes_s ?? one.predicted_time_s));
  const changes = vehicles.some((one) => one.time_with_changes_s !== undefined);
  const air = duration(sum((one) => one.predicted_time_s));
  const used = Math.max(...vehicles.map((one) => one.battery_used ?? 0));
  const needed = `${(100 * used).toFixed(0)} % of one ${used > 1 ? "needed" : "at most"}`;
  const isEnough = vehicles.every((one) => one.batteries !== null);
  const batteries = isEnough ? String(sum((one) => one.batteries ?? 0)) : "never enough";
  const spacing_m = vehicles[0]?.spacing_m;
  const durations = missions.map((one) => duration(one.plan.duration_s ?? 0)).slice(0, 8);
  const flights: [string, string, string] = ["Flights", String(missions.length), durations.join(" + ")];
  return [
    ["Time", duration(longest_s), changes ? `${air} in the air, the rest for batteries` : "from take-off to landing"],
    ["Distance", metres(sum((one) => one.length_m)), `${sum((one) => one.waypoints)} waypoints`],
    ...(missions.length > 1 ? [flights] : []),
    ["Batteries", batteries, `${needed}, ${sum((one) => one.predicted_energy_wh).toFixed(1)} Wh`],
    ["Coverage", `${(100 * coverage).toFixed(2)} %`, spacing_m ? `rows ${metres(spacing_m)} apart` : "of the land to be seen"],
  ];
}
