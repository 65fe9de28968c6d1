// Editor of a farm's shapes on a map, by pointer or keyboard.
import * as L from "leaflet";
import { cropColours } from "./colours.js";
import { element } from "./dom.js";
import {
  cropsOf, crossings, fieldAt, freeName, middleOf, type Kind, type Position, type Shape, type Sketch,
} from "./sketch.js";
import type { Studio } from "./studio.page.js";

/** Distance from the first corner within which a click closes a ring (pixels). */
const CLOSE_PX = 14;
/** Distance from the last corner within which a click belongs to a double click (pixels). */
const SAME_PX = 4;
/** Maximum number of corners with handles for new corners, and with any handle; the table has all. */
const [MOST_MIDDLES, MOST_CORNERS] = [150, 600];
/** Step of an arrow key when moving a corner (pixels). */
const STEP_PX = 4;
const MOST_MARKS = 50;
const CROSSES = "The border crosses itself at the mark";

const RING = "click its corners, then the first corner again or Enter; Backspace removes the last corner, Escape cancels";
/** Hints of the tools. */
const HINTS = {
  select: "",
  field: `Field: ${RING}`,
  hole: `Hole in a field: ${RING}`,
  pond: `Pond: ${RING}`,
  obstacle: `Obstacle: ${RING}`,
  "no-fly": `No-fly zone: ${RING}`,
  home: "Home: click where the vehicle takes off and lands",
  rally: "Rally point: click where a vehicle may land when it cannot come home",
};
export type Tool = keyof typeof HINTS;

const latLng = ([lon, lat]: Position): L.LatLng => L.latLng(lat, lon);
const position = ({ lat, lng }: L.LatLng): Position => [Number(lng.toFixed(9)), Number(lat.toFixed(9))];

export class Editor {
  private tool: Tool = "select";
  private drawn: Position[] = [];
  private readonly shapes = L.layerGroup();
  private readonly handles = L.layerGroup();
  private readonly crossed = L.layerGroup();
  private standing: Position[] = [];
  private readonly rubber = L.polyline([], { className: "rubber", interactive: false });
  private polygons: L.Polygon[] = [];

  constructor(private readonly map: L.Map, private readonly studio: Studio) {
    for (const layer of [this.shapes, this.rubber, this.handles, this.crossed]) layer.addTo(map);
    map.doubleClickZoom.disable();
    map.on("click", (event) => this.click(event.latlng));
    map.on("dblclick", () => this.drawing && this.close());
    map.on("mousemove", (event) => this.follow(event.latlng));
    map.getContainer().addEventListener("keydown", (event) => this.key(event));
  }

  get drawing(): boolean {
    return this.drawn.length > 0;
  }

  take(tool: Tool): void {
    this.tool = tool;
    this.drawn = [];
    this.map.getContainer().classList.toggle("draws", tool !== "select");
    this.studio.tell(HINTS[tool]);
    this.show();
  }

  /** Draw the current sketch. */
  show(): void {
    const { sketch, selected } = this.studio;
    this.shapes.clearLayers();
    const colours = cropColours(cropsOf(sketch));
    this.polygons = sketch.shapes.map(({ kind, crop, owner, rings }, number) => {
      const looks = [owner === sketch.owner ? "own" : "", number === selected ? "selected" : ""];
      const style = { className: ["shape", kind, ...looks].join(" "), fillColor: colours.get(crop) ?? "" };
      const polygon = L.polygon(rings.map((ring) => ring.map(latLng)), style);
      polygon.on("click", (event) => {
        if (this.tool !== "select") return;
        L.DomEvent.stopPropagation(event);
        this.studio.select(number);
      });
      return polygon.addTo(this.shapes);
    });
    if (sketch.home) this.point(sketch.home, "Home", "Home", (home) => ({ home }));
    for (const [k, place] of sketch.rally.entries())
      this.point(place, "Rally point", `Rally point ${k + 1}`, (to) => ({ rally: sketch.rally.with(k, to) }));
    this.showHandles();
    this.rubber.setLatLngs(this.drawn.map(latLng));
    for (const [k, place] of this.drawn.entries()) {
      const style = { className: k ? "drawn" : "drawn first", radius: k ? 4 : 7, interactive: false };
      L.circleMarker(latLng(place), style).addTo(this.handles);
    }
    this.markAll();
  }

  /** Mark the self-intersections of borders and of the line being drawn. */
  private markAll(rings = this.studio.sketch.shapes.flatMap((shape) => shape.rings)): void {
    this.standing = rings.flatMap((ring) => crossings(ring, true));
    this.mark(this.drawn);
  }

  private mark(line: Position[]): void {
    this.crossed.clearLayers();
    const mark = { radius: 9, fill: false, interactive: false, className: "crossing" };
    for (const place of [...this.standing, ...crossings(line, false)].slice(0, MOST_MARKS))
      L.circleMarker(latLng(place), mark).addTo(this.crossed);
  }

  /** Space sets a corner at the map's centre, Enter closes, Backspace removes a corner, Escape cancels. */
  key(event: KeyboardEvent): void {
    if (event.key === "Escape" && (this.drawing || this.tool !== "select")) {
      if (this.drawing) this.take(this.tool);
      else this.studio.take("select");
    } else if (event.key === "Enter" && this.drawing) this.close();
    else if (event.key === "Backspace" && this.drawing) this.setDrawn(this.drawn.slice(0, -1));
    else if (event.key === " " && this.tool !== "select" && event.target === this.map.getContainer())
      this.click(this.map.getCenter());
    else return;
    L.DomEvent.stop(event);
  }

  private point(place: Position, kind: string, label: string, change: (to: Position) => Partial<Sketch>): void {
    const icon = L.divIcon({ html: element("span", {}, kind[0]!), className: "place", iconSize: [22, 22] });
    const marker = L.marker(latLng(place), { icon, draggable: true, title: label, alt: label }).addTo(this.shapes);
    marker.on("dragend", () => this.studio.change(change(position(marker.getLatLng())), `${kind} moved`));
  }

  private click(place: L.LatLng): void {
    const { sketch } = this.studio;
    if (this.tool === "select") return this.studio.select(null);
    if (this.tool === "home" || this.tool === "rally") {
      const isHome = this.tool === "home";
      this.studio.take("select");
      const change = isHome ? { home: position(place) } : { rally: [...sketch.rally, position(place)] };
      return this.studio.change(change, isHome ? "Home placed" : "Rally point placed");
    }
    const [first, last] = [this.drawn[0], this.drawn.at(-1)];
    const near = first && this.distance_px(first, place) <= CLOSE_PX;
    if (near && this.drawn.length >= 3) return this.close();
    if (near || (last && this.distance_px(last, place) <= SAME_PX)) return;
    this.setDrawn([...this.drawn, position(place)]);
  }

  private distance_px(corner: Position, place: L.LatLng): number {
    return this.map.latLngToContainerPoint(latLng(corner)).distanceTo(this.map.latLngToContainerPoint(place));
  }

  private setDrawn(ring: Position[]): void {
    this.drawn = ring;
    const closes = "corners; Enter, a double click or the first corner closes the shape";
    const count = `${ring.length} ${ring.length < 3 ? "of at least 3 corners" : closes}`;
    this.studio.tell(crossings(ring, false).length ? `${CROSSES}: Backspace removes the corner` : count);
    this.show();
  }

  private follow(place: L.LatLng): void {
    if (!this.drawing) return;
    this.rubber.setLatLngs([...this.drawn.map(latLng), place]);
    this.mark([...this.drawn, position(place)]);
  }

  private close(): void {
    const [ring, { sketch }] = [this.drawn, this.studio];
    if (ring.length < 3) return this.studio.tell("A shape has at least 3 corners");
    this.drawn = [];
    const isHole = this.tool === "hole";
    const number = isHole ? fieldAt(sketch, ring[0]!) : sketch.shapes.length;
    if (number < 0) {
      this.show();
      return this.studio.tell("A hole must begin on a field: there is no field at its first corner");
    }
    const shape = isHole ? sketch.shapes[number]! : this.shapeOf(ring);
    const whole = isHole ? { ...shape, rings: [...shape.rings, ring] } : shape;
    const crosses = !isHole && crossings(ring, true).length > 0;
    const told = crosses ? `${CROSSES}: move a corner, or Undo` : `${isHole ? "Hole" : shape.name} drawn`;
    this.studio.take("select");
    this.studio.change({ shapes: sketch.shapes.toSpliced(number, 1, whole) }, told);
    this.studio.select(number);
  }

  private shapeOf(ring: Position[]): Shape {
    const { sketch, crop } = this.studio;
    const kind: Kind = this.tool === "obstacle" || this.tool === "no-fly" ? this.tool : "field";
    const grown = this.tool === "pond" ? "pond" : crop;
    const name = freeName(sketch, this.tool === "no-fly" ? "no-fly zone" : this.tool);
    const land = kind === "field" ? { crop: grown, owner: sketch.owner } : { crop: "", owner: "" };
    return { name, kind, ...land, height_m: kind === "obstacle" ? 5 : null, margin_m: null, rings: [ring] };
  }

  private showHandles(): void {
    this.handles.clearLayers();
    const { sketch, selected } = this.studio;
    const shape = selected === null ? undefined : sketch.shapes[selected];
    if (selected === null || !shape || this.tool !== "select") return;
    const count = shape.rings.flat().length;
    if (count > MOST_CORNERS) return this.studio.tell(`${count} corners are too many to move on the map: change them in the table`);
    for (const [r, ring] of shape.rings.entries())
      for (const k of ring.keys()) {
        this.corner(selected, r, k);
        if (count <= MOST_MIDDLES) this.handle(selected, r, k, true);
      }
  }

  /** Handle of a corner, or of a new corner after it. */
  private handle(number: number, r: number, k: number, isNew: boolean): L.Marker {
    const ring = this.studio.sketch.shapes[number]!.rings[r]!;
    const [kind, size] = isNew ? ["middle", 10] : ["corner", 14];
    const icon = L.divIcon({ html: "", className: `handle ${kind}`, iconSize: [size, size] });
    const label = isNew ? `New corner after corner ${k + 1}` : `Corner ${k + 1}`;
    const looks = { icon, draggable: true, title: label, alt: label, zIndexOffset: 500 };
    const marker = L.marker(latLng(isNew ? middleOf(ring, k) : ring[k]!), looks).addTo(this.handles);
    const moved = (): Position[] => ring.toSpliced(isNew ? k + 1 : k, isNew ? 0 : 1, position(marker.getLatLng()));
    marker.on("drag", () => this.preview(number, r, moved()));
    const told = isNew ? "Corner added" : "Corner moved";
    marker.on(isNew ? "dragend click" : "dragend", () => this.studio.setRing(number, r, moved(), told));
    return marker;
  }

  private corner(number: number, r: number, k: number): void {
    const marker = this.handle(number, r, k, false);
    const before = this.studio.sketch.shapes[number]!.rings.slice(0, r).flat().length;
    const remove = (): void => this.studio.deleteCorner(number, r, k);
    marker.on("contextmenu", remove); // Of a right click, or of a long press
    marker.getElement()!.addEventListener("keydown", (event) => {
      const step = ARROWS[event.key];
      if (step) {
        const to = this.map.latLngToContainerPoint(marker.getLatLng()).add(L.point(step).multiplyBy(STEP_PX));
        marker.setLatLng(this.map.containerPointToLatLng(to)).fire("dragend");
      } else if (event.key === "Delete" || event.key === "Backspace") remove();
      else return;
      L.DomEvent.stop(event);
      const corners = this.map.getContainer().querySelectorAll<HTMLElement>(".corner");
      corners[Math.min(before + k, corners.length - 1)]?.focus();
    });
  }

  /** Show a ring while it is being dragged. */
  private preview(number: number, r: number, ring: Position[]): void {
    const rings = this.studio.sketch.shapes[number]!.rings.with(r, ring);
    this.polygons[number]?.setLatLngs(rings.map((one) => one.map(latLng)));
    this.markAll(rings);
  }
}

const ARROWS: Record<string, L.PointTuple> = {
  ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1],
};
