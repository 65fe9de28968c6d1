// Layer values: received tiles with earlier versions, and pictures of them at a time.
import { levels, pixel, ramp } from "./colours.js";
import { element } from "./dom.js";
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
      versions.push({ ...tile, time_s, scale: scales[tile.layer]! });
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
  readonly canvas = element("canvas", { width: this.raster.width, height: this.raster.height });
  scale = 0;
  /** Shown tiles, with their decoded bytes. */
  private shown = new Map<Version, Uint8Array>();
  /** Colours of the levels 0 to `TOP`. */
  private readonly table = levels(ramp(this.layer, this.field), TOP + 1).map((colour) => pixel(colour, 255));
  private wanted: number | null = null;
  private busy = false;

  constructor(
    readonly layer: LayerName,
    readonly raster: Raster,
    readonly field: FieldInfo | undefined,
    readonly tiles: Tiles,
    private readonly changed: () => void,
  ) {}

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
    const { tile, width, pixel_m } = this.raster;
    for (const [{ x, y, scale }, bytes] of this.shown) {
      const [column, row] = [Math.floor(x_m / pixel_m) - x * tile, Math.floor(y_m / pixel_m) - y * tile];
      const columns = Math.min(tile, width - x * tile);
      const byte = bytes[row * columns + column] ?? NOTHING;
      if (column < 0 || column >= columns || byte === NOTHING) continue;
      return `${this.title} ${this.figure((byte / TOP) * scale)} ${this.field?.unit ?? ""}`.trimEnd();
    }
    return "";
  }

  /** Show the layer at a time; only changed tiles are decoded. */
  async show(time_s: number): Promise<void> {
    this.wanted = time_s;
    if (this.busy) return;
    this.busy = true;
    while (this.wanted !== null) {
      const at = this.tiles.at(this.layer, this.wanted);
      this.wanted = null;
      const before = this.shown;
      const decoded = await Promise.all(at.map((version) => before.get(version) ?? inflate(version.data)));
      this.shown = new Map(at.map((version, k) => [version, decoded[k]!]));
      const scale = Math.max(...at.map((version) => version.scale), 1e-9);
      const changed = at.filter((version) => scale !== this.scale || !before.has(version));
      this.scale = scale;
      for (const version of changed) this.paint(version, this.shown.get(version)!);
      if (changed.length) this.changed();
    }
    this.busy = false;
  }

  private paint({ x, y, scale }: Version, bytes: Uint8Array): void {
    const { tile, width, height } = this.raster;
    const image = new ImageData(Math.min(tile, width - x * tile), Math.min(tile, height - y * tile));
    const colourOf = (byte: number): number => this.table[Math.round((byte * scale) / this.scale)]!;
    new Uint32Array(image.data.buffer).set(Array.from(bytes, (byte) => (byte === NOTHING ? 0 : colourOf(byte))));
    this.canvas.getContext("2d")!.putImageData(image, x * tile, y * tile);
  }
}
