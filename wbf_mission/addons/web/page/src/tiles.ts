// Layer values: received tiles with earlier versions, and pictures of them at a time.
import { colourAt, pixel, ramp } from "./colours.js";
import { figure } from "./text.js";
import type { FieldInfo, LayerName, Raster, Tile } from "./schema.js";

/** Total characters of tiles from which earlier versions are thinned out. */
const MOST_KEPT = 48e6;
const NOTHING = 255;
const TOP = 254;

interface Version extends Tile {
  time_s: number;
  scale: number;
}

export async function inflate(base64: string): Promise<Uint8Array<ArrayBuffer>> {
  const packed = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

export class Tiles {
  /** Versions by layer and place, in order of time. */
  private readonly layers: Record<LayerName, Record<string, Version[]>> = {};
  private kept = 0;

  add(tiles: Tile[], time_s: number, scales: Record<LayerName, number>): void {
    for (const tile of tiles) {
      const places = (this.layers[tile.layer] ??= {});
      const versions = (places[`${tile.x},${tile.y}`] ??= []);
      versions.push({ ...tile, time_s, scale: scales[tile.layer] ?? 1 });
      this.kept += tile.data.length;
    }
    if (this.kept > MOST_KEPT) this.thin();
  }

  has(layer: LayerName): boolean {
    return layer in this.layers;
  }

  /** Each tile of a layer at a time, or its first version if that is later. */
  at(layer: LayerName, time_s: number): Version[] {
    const places = Object.values(this.layers[layer] ?? {});
    return places.map((versions) => versions.findLast((one) => one.time_s <= time_s) ?? versions[0]!);
  }

  private thin(): void {
    this.kept = 0;
    for (const places of Object.values(this.layers))
      for (const [place, versions] of Object.entries(places)) {
        const left = versions.filter((_, k) => k % 2 === 0 || k === versions.length - 1);
        places[place] = left;
        for (const { data } of left) this.kept += data.length;
      }
  }
}

/** Name of a kind of layer, in words. */
export function kindName(kind: string): string {
  return kind === "value" ? "estimate" : kind;
}

/** A layer as a picture with the raster's pixels, row 0 at the frame's origin. */
export class Picture {
  readonly canvas = document.createElement("canvas");
  scale = 0;
  private readonly values: Float32Array;
  private shown = new Set<Version>();
  /** Colours of the levels 0 to `TOP`. */
  private readonly table: number[];
  private wanted: number | null = null;
  private busy = false;

  constructor(
    readonly layer: LayerName,
    readonly raster: Raster,
    readonly field: FieldInfo | undefined,
    readonly tiles: Tiles,
    private readonly changed: () => void,
  ) {
    this.canvas.width = raster.width;
    this.canvas.height = raster.height;
    this.values = new Float32Array(raster.width * raster.height).fill(NaN);
    const colours = ramp(layer, field);
    this.table = Array.from({ length: TOP + 1 }, (_, level) => pixel(colourAt(colours, level / TOP), 255));
  }

  get title(): string {
    return this.field ? `${this.field.title}, ${kindName(this.layer.split("/")[0]!)}` : "Acquisition";
  }

  /** Value in the field's unit, with the digits of a hundredth of its range. */
  figure(value: number): string {
    if (!this.field) return figure(value);
    const [low, high] = this.field.range;
    const span = high - low;
    const digits = Math.min(6, Math.max(0, Math.ceil(2 - Math.log10(span))));
    return this.layer.startsWith("uncertainty/") ? figure(value * span) : (low + value * span).toFixed(digits);
  }

  /** Title, value and unit at a place (m); empty without a value. */
  textAt(x_m: number, y_m: number): string {
    const { width, pixel_m } = this.raster;
    const [x, y] = [Math.floor(x_m / pixel_m), Math.floor(y_m / pixel_m)];
    const value = x >= 0 && x < width ? (this.values[y * width + x] ?? NaN) : NaN;
    return Number.isNaN(value) ? "" : `${this.title} ${this.figure(value)} ${this.field?.unit ?? ""}`.trimEnd();
  }

  /** Show the layer at a time; only changed tiles are decoded. */
  async show(time_s: number): Promise<void> {
    this.wanted = time_s;
    if (this.busy) return;
    this.busy = true;
    while (this.wanted !== null) {
      const at = this.tiles.at(this.layer, this.wanted);
      this.wanted = null;
      const fresh = at.filter((version) => !this.shown.has(version));
      const decoded = await Promise.all(fresh.map(({ data }) => inflate(data)));
      fresh.forEach((version, k) => this.keep(version, decoded[k]!));
      this.shown = new Set(at);
      const scale = Math.max(...at.map((version) => version.scale), 1e-9);
      const all = scale !== this.scale;
      this.scale = scale;
      for (const version of all ? at : fresh) this.paint(version);
      if (all || fresh.length) this.changed();
    }
    this.busy = false;
  }

  /** First column and row of a tile, and its numbers of columns and rows. */
  private box({ x, y }: Tile): [number, number, number, number] {
    const { tile, width, height } = this.raster;
    return [x * tile, y * tile, Math.min(tile, width - x * tile), Math.min(tile, height - y * tile)];
  }

  private keep(version: Version, bytes: Uint8Array): void {
    const [left, bottom, columns, rows] = this.box(version);
    for (let row = 0; row < rows; row++)
      for (let column = 0; column < columns; column++) {
        const byte = bytes[row * columns + column] ?? NOTHING;
        const value = byte === NOTHING ? NaN : (byte / TOP) * version.scale;
        this.values[(bottom + row) * this.raster.width + left + column] = value;
      }
  }

  private paint(tile: Tile): void {
    const [left, bottom, columns, rows] = this.box(tile);
    const image = new ImageData(columns, rows);
    const pixels = new Uint32Array(image.data.buffer);
    for (let row = 0; row < rows; row++)
      for (let column = 0; column < columns; column++) {
        const value = this.values[(bottom + row) * this.raster.width + left + column]!;
        if (!Number.isNaN(value)) pixels[row * columns + column] = this.table[Math.round((value / this.scale) * TOP)]!;
      }
    this.canvas.getContext("2d")!.putImageData(image, left, bottom);
  }
}
