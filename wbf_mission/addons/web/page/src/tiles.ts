// Layer values: received tiles with earlier versions, and pictures of them at a time.
import { colourAt, ramp } from "./colours.js";
import type { FieldInfo, LayerName, Raster, Tile } from "./schema.js";

/** Total characters of tiles from which earlier versions are thinned out. */
const MOST_KEPT = 48e6;
const NOTHING = 255;
const TOP = 254;

interface Version {
  time_s: number;
  data: string;
  scale: number;
}

export async function inflate(base64: string): Promise<Uint8Array<ArrayBuffer>> {
  const packed = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

export class Tiles {
  private readonly layers = new Map<LayerName, Map<string, Version[]>>();
  private kept = 0;

  add(tiles: Tile[], time_s: number, scales: Record<LayerName, number>): void {
    for (const { layer, x, y, data } of tiles) {
      const places = this.layers.get(layer) ?? new Map<string, Version[]>();
      this.layers.set(layer, places);
      const versions = places.get(`${x},${y}`) ?? [];
      places.set(`${x},${y}`, versions);
      versions.push({ time_s, data, scale: scales[layer] ?? 1 });
      this.kept += data.length;
    }
    if (this.kept > MOST_KEPT) this.thin();
  }

  has(layer: LayerName): boolean {
    return this.layers.has(layer);
  }

  /** Each tile of a layer at a time, or its first version if that is later. */
  at(layer: LayerName, time_s: number): Map<string, Version> {
    const shown = new Map<string, Version>();
    for (const [place, versions] of this.layers.get(layer) ?? []) {
      let [low, high] = [0, versions.length - 1];
      while (low < high) {
        const middle = (low + high + 1) >> 1;
        if (versions[middle]!.time_s <= time_s) low = middle;
        else high = middle - 1;
      }
      shown.set(place, versions[low]!);
    }
    return shown;
  }

  private thin(): void {
    this.kept = 0;
    for (const places of this.layers.values())
      for (const [place, versions] of places) {
        const left = versions.filter((_, k) => k % 2 === 0 || k === versions.length - 1);
        places.set(place, left);
        for (const { data } of left) this.kept += data.length;
      }
  }
}

/** A layer as a picture with the raster's pixels, row 0 at the frame's origin. */
export class Picture {
  readonly canvas = document.createElement("canvas");
  scale = 0;
  private readonly values: Float32Array;
  private readonly shown = new Map<string, Version>();
  private readonly colours: string[];
  private table = new Uint8ClampedArray(0);
  private wanted: number | null = null;
  private busy = false;

  constructor(
    readonly layer: LayerName,
    readonly raster: Raster,
    field: FieldInfo | undefined,
    readonly tiles: Tiles,
    private readonly changed: () => void,
  ) {
    this.canvas.width = raster.width;
    this.canvas.height = raster.height;
    this.values = new Float32Array(raster.width * raster.height).fill(NaN);
    this.colours = ramp(layer, field);
  }

  /** Value at a pixel of the raster; NaN without one. */
  valueAt(x: number, y: number): number {
    const inside = x >= 0 && y >= 0 && x < this.raster.width && y < this.raster.height;
    return inside ? (this.values[y * this.raster.width + x] ?? NaN) : NaN;
  }

  /** Show the layer at a time; only changed tiles are decoded. */
  async show(time_s: number): Promise<void> {
    this.wanted = time_s;
    if (this.busy) return;
    this.busy = true;
    while (this.wanted !== null) {
      const at = this.tiles.at(this.layer, this.wanted);
      this.wanted = null;
      const fresh = [...at].filter(([place, version]) => this.shown.get(place) !== version);
      const decoded = await Promise.all(fresh.map(([, version]) => inflate(version.data)));
      const scale = Math.max(...[...at.values()].map((version) => version.scale), 1e-9);
      const all = scale !== this.scale;
      if (all) this.setScale(scale);
      fresh.forEach(([place, version], k) => {
        this.shown.set(place, version);
        this.keep(place, decoded[k]!, version.scale);
        if (!all) this.paint(place);
      });
      if (all) for (const place of this.shown.keys()) this.paint(place);
      if (all || fresh.length) this.changed();
    }
    this.busy = false;
  }

  private setScale(scale: number): void {
    this.scale = scale;
    this.table = new Uint8ClampedArray(4 * (TOP + 1));
    for (let level = 0; level <= TOP; level++) this.table.set([...colourAt(this.colours, level / TOP), 255], 4 * level);
  }

  /** First column and row of a tile, and its numbers of columns and rows. */
  private box(place: string): [number, number, number, number] {
    const { tile, width, height } = this.raster;
    const [x, y] = place.split(",").map((part) => Number(part) * tile) as [number, number];
    return [x, y, Math.min(tile, width - x), Math.min(tile, height - y)];
  }

  private keep(place: string, bytes: Uint8Array, scale: number): void {
    const [left, bottom, columns, rows] = this.box(place);
    for (let row = 0; row < rows; row++)
      for (let column = 0; column < columns; column++) {
        const byte = bytes[row * columns + column] ?? NOTHING;
        const value = byte === NOTHING ? NaN : (byte / TOP) * scale;
        this.values[(bottom + row) * this.raster.width + left + column] = value;
      }
  }

  private paint(place: string): void {
    const [left, bottom, columns, rows] = this.box(place);
    const image = new ImageData(columns, rows);
    for (let row = 0; row < rows; row++)
      for (let column = 0; column < columns; column++) {
        const value = this.values[(bottom + row) * this.raster.width + left + column]!;
        if (Number.isNaN(value)) continue;
        const level = 4 * Math.round((value / this.scale) * TOP);
        image.data.set(this.table.subarray(level, level + 4), 4 * (row * columns + column));
      }
    this.canvas.getContext("2d")!.putImageData(image, left, bottom);
  }
}
