import type { Update } from "./schema.js";

export function take(update: Update): number {
  return update.time_s;
}
