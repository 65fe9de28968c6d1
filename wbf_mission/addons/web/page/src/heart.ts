// The age of the data that the page shows, from the program's beats and this page's own clocks: others differ.
import type { Beat, Given } from "./schema.js";

/** The page shows an age from TOLD_S on; from OLD_S on its data are old, and it gives no orders. */
export const TOLD_S = 2;
export const OLD_S = 3;
/** How often a page looks at its heart. */
export const LOOK_MS = 250;
/** A connection that comes back at once was not lost. */
const LOST_MS = 600;
/** Clocks of two machines drift apart by less than this part. */
const DRIFT = 1e-3;

export type Link = "connecting" | "live" | "lost" | "recording";

export class Heart {
  private state: Link = "connecting";
  private since_ms = 0;
  private sent_s: number | null = null;
  private arrived_ms = 0;
  private arrivedByDate_ms = 0;
  /** Delay of the newest beat against the quickest one, and the difference of the clocks by the quickest. */
  private late_ms = 0;
  private apart_ms = Infinity;
  private number = 0;

  /** Forget the beats: another connection has its own. */
  stop(): void {
    this.sent_s = null;
    this.apart_ms = Infinity;
  }

  get link(): Link {
    return this.state;
  }

  set link(state: Link) {
    if (state === this.state) return; // Another try that failed
    [this.state, this.since_ms] = [state, performance.now()];
  }

  /** Whether the connection is lost, and for long enough to say so. */
  get isLost(): boolean {
    return this.state === "lost" && performance.now() - this.since_ms >= LOST_MS;
  }

  /** Whether nothing comes any more: the page shows what was. */
  get isOld(): boolean {
    return this.isLost || (this.age_s !== null && this.age_s >= OLD_S);
  }

  /** Why what is shown is old. */
  get trouble(): string {
    return this.isLost ? "The connection to the program is lost" : "Nothing comes from the program";
  }

  beat({ time_s }: Beat): void {
    const now_ms = performance.now();
    const apart_ms = now_ms - 1000 * time_s;
    const since_ms = this.sent_s === null ? 0 : 1000 * (time_s - this.sent_s);
    this.apart_ms = Math.min(this.apart_ms + DRIFT * since_ms, apart_ms);
    this.late_ms = apart_ms - this.apart_ms;
    [this.sent_s, this.arrived_ms, this.arrivedByDate_ms] = [time_s, now_ms, Date.now()];
  }

  /** Seconds since the program is known to have lived; null before its first beat. */
  get age_s(): number | null {
    if (this.sent_s === null) return null;
    // A page that sleeps keeps what arrived, and its first clock may stand meanwhile.
    const since_ms = Math.max(performance.now() - this.arrived_ms, Date.now() - this.arrivedByDate_ms);
    return (this.late_ms + since_ms) / 1000;
  }

  /** Whether what is shown is what is, so that orders may be given by it. */
  get isFresh(): boolean {
    return this.state === "live" && this.age_s !== null && this.age_s < OLD_S;
  }

  /** When a request is given: now. */
  give(): Given {
    const after_s = (performance.now() - this.arrived_ms) / 1000;
    return { number: ++this.number, beat_s: this.sent_s ?? 0, after_s };
  }
}
