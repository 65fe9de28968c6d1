// Self-intersections of a border.
import type { Position } from "./sketch.js";

/** Maximum number of corners checked here; the program checks longer borders. */
const MOST_CORNERS = 1000;

/** Points where sides that are no neighbours cross or touch, and spikes; the last side closes a ring. */
export function crossings(line: Position[], isClosed: boolean): Position[] {
  const count = isClosed ? line.length : line.length - 1;
  if (line.length > MOST_CORNERS) return [];
  const found: Position[] = [];
  const end = (k: number): Position => line[(k + 1) % line.length]!;
  for (let i = 0; i < count; i++)
    for (let j = i + 1; j < count; j++) {
      const before = j === i + 1;
      const around = isClosed && i === 0 && j === count - 1;
      if (before || around) {
        const [corner, one, other] = before ? [end(i), line[i]!, end(j)] : [line[0]!, end(0), line[j]!];
        if (turn(corner, one, other) === 0 && along(corner, one, other) > 0) found.push(corner);
        continue;
      }
      const place = meeting(line[i]!, end(i), line[j]!, end(j));
      if (place) found.push(place);
    }
  return found;
}

const turn = (a: Position, b: Position, c: Position): number => Math.sign((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]));
const along = (a: Position, b: Position, c: Position): number => (b[0] - a[0]) * (c[0] - a[0]) + (b[1] - a[1]) * (c[1] - a[1]);
const within = (a: Position, b: Position, c: Position): boolean =>
  Math.min(a[0], b[0]) <= c[0] && c[0] <= Math.max(a[0], b[0]) && Math.min(a[1], b[1]) <= c[1] && c[1] <= Math.max(a[1], b[1]);

/** Point where two sides meet, or null. */
function meeting(a: Position, b: Position, c: Position, d: Position): Position | null {
  const [c1, d1, a1, b1] = [turn(a, b, c), turn(a, b, d), turn(c, d, a), turn(c, d, b)];
  if (c1 * d1 < 0 && a1 * b1 < 0) {
    const [ux, uy, vx, vy] = [b[0] - a[0], b[1] - a[1], d[0] - c[0], d[1] - c[1]];
    const part = ((c[0] - a[0]) * vy - (c[1] - a[1]) * vx) / (ux * vy - uy * vx);
    return [a[0] + part * ux, a[1] + part * uy];
  }
  if (c1 === 0 && within(a, b, c)) return c;
  if (d1 === 0 && within(a, b, d)) return d;
  if (a1 === 0 && within(c, d, a)) return a;
  return b1 === 0 && within(c, d, b) ? b : null;
}
