// Layers of a Leaflet map drawn on a canvas, in metres of the farm frame.
import * as L from "leaflet";
import type { FarmShape } from "./schema.js";

/** Position of a farm frame: over a few kilometres, WGS84 is a rotation, scaling and shift of it. */
export class Frame {
  private readonly turn = this.at.lat_x * this.at.lon_y - this.at.lat_y * this.at.lon_x;

  constructor(private readonly at: FarmShape["georeference"]) {}

  latLng(x: number, y: number): L.LatLng {
    const { lat, lon, lat_x, lat_y, lon_x, lon_y } = this.at;
    return L.latLng(lat + lat_x * x + lat_y * y, lon + lon_x * x + lon_y * y);
  }

  metres(place: L.LatLng): [number, number] {
    const { lat, lon, lat_x, lat_y, lon_x, lon_y } = this.at;
    const [north, east] = [place.lat - lat, place.lng - lon];
    return [(north * lon_y - east * lat_y) / this.turn, (east * lat_x - north * lon_x) / this.turn];
  }
}

/** Transformation from metres to canvas pixels, as of `setTransform`. */
export interface View {
  matrix: [number, number, number, number, number, number];
  /** Pixels per metre. */
  scale: number;
  width: number;
  height: number;
}

export function toPixels({ matrix: [a, b, c, d, e, f] }: View, x: number, y: number): [number, number] {
  return [a * x + c * y + e, b * x + d * y + f];
}

function viewOf(map: L.Map, frame: Frame): View {
  const shift = L.DomUtil.getPosition(map.getPane("mapPane")!).subtract(map.getPixelOrigin());
  const place = (x: number, y: number): L.Point => map.project(frame.latLng(x, y)).add(shift);
  const far = 1000;
  const [o, x, y] = [place(0, 0), place(far, 0), place(0, far)];
  const [a, b] = [(x.x - o.x) / far, (x.y - o.y) / far];
  const size = map.getSize();
  const matrix: View["matrix"] = [a, b, (y.x - o.x) / far, (y.y - o.y) / far, o.x, o.y];
  return { matrix, scale: Math.hypot(a, b), width: size.x, height: size.y };
}

const HEAVY_MS = 200;

export type Draw = (context: CanvasRenderingContext2D, view: View) => void;

/** A canvas as large as the map, redrawn whenever the map moves. */
export class CanvasLayer extends L.Layer {
  readonly canvas = document.createElement("canvas");
  private zooming = false;
  private asked = false;
  private zoom = NaN;
  private painted_ms = 0;

  /** A slow drawing (`heavy`) moves with a dragged map and is redrawn at the end of the drag. */
  constructor(
    pane: string,
    private readonly frame: () => Frame,
    private readonly draw: Draw,
    private readonly heavy = false,
  ) {
    super({ pane });
    this.canvas.className = "leaflet-zoom-animated map-canvas";
  }

  override onAdd(): this {
    this.getPane()!.append(this.canvas);
    this.paint();
    return this;
  }

  override getEvents(): Record<string, L.LeafletEventHandlerFn> {
    return {
      move: () => {
        if (!this.heavy || this._map.getZoom() !== this.zoom) this.paint();
      },
      moveend: () => this.heavy && this.paint(),
      resize: () => this.paint(),
      zoomend: () => {
        this.zooming = false;
        this.paint();
      },
      zoomanim: (event) => this.animate(event as L.ZoomAnimEvent),
    };
  }

  /** Draw before the next frame; slow drawings at most a few times per second. */
  redraw(): void {
    if (this.asked) return;
    this.asked = true;
    const paint = (): void => {
      this.asked = false;
      this.paint();
    };
    const wait_ms = this.heavy ? this.painted_ms + HEAVY_MS - performance.now() : 0;
    setTimeout(() => requestAnimationFrame(paint), wait_ms);
  }

  private paint(): void {
    const map = this._map as L.Map | null;
    if (!map || this.zooming) return;
    this.zoom = map.getZoom();
    this.painted_ms = performance.now();
    const view = viewOf(map, this.frame());
    const density = window.devicePixelRatio;
    const [width, height] = [Math.round(view.width * density), Math.round(view.height * density)];
    if (this.canvas.width !== width || this.canvas.height !== height) {
      [this.canvas.width, this.canvas.height] = [width, height];
      this.canvas.style.width = `${view.width}px`;
      this.canvas.style.height = `${view.height}px`;
    }
    L.DomUtil.setPosition(this.canvas, map.containerPointToLayerPoint([0, 0]));
    const context = this.canvas.getContext("2d")!;
    context.setTransform(density, 0, 0, density, 0, 0);
    context.clearRect(0, 0, view.width, view.height);
    this.draw(context, view);
  }

  /** Scale the picture during Leaflet's zoom animation, as its own renderers do. */
  private animate({ center, zoom }: L.ZoomAnimEvent): void {
    const map = this._map;
    this.zooming = true;
    const corner = map.containerPointToLatLng([0, 0]);
    const pane = L.DomUtil.getPosition(map.getPane("mapPane")!);
    const half = map.getSize().divideBy(2);
    const origin = map.project(center, zoom).subtract(half).add(pane).round();
    L.DomUtil.setTransform(this.canvas, map.project(corner, zoom).subtract(origin), map.getZoomScale(zoom));
  }
}
