// Age of the displayed data, from the program's beats and the page's own clocks.
import type { Beat, Given } from "./schema.js";

/** Age from which the page shows it, and from which data is old and no orders are given (s). */
export const TOLD_S = 2;
const OLD_S = 3;
/** Minimum duration of a reported connection loss. */
const LOST_MS = 600;
/** Maximum relative drift between the clocks of two machines. */
const DRIFT = 1e-3;

export type Link = "connecting" | "live" | "lost" | "recording";

export class Heart {
  private state: Link = "connecting";
  private since_ms = 0;
  private sent_s: number | null = null;
  private arrived_ms = 0;
  private arrivedByDate_ms = 0;
  /** Delay of the newest beat relative to the fastest one, and clock difference by the fastest one. */
  private late_ms = 0;
  private apart_ms = Infinity;
  private number = 0;

  /** Forget the beats of the previous connection. */
  stop(): void {
    this.sent_s = null;
    this.apart_ms = Infinity;
  }

  get link(): Link {
    return this.state;
  }

  set link(state: Link) {
    if (state === this.state) return; // A repeated attempt has failed
    [this.state, this.since_ms] = [state, performance.now()];
  }

  /** Whether the connection has been lost long enough to report it. */
  get isLost(): boolean {
    return this.state === "lost" && performance.now() - this.since_ms >= LOST_MS;
  }

  /** Whether the displayed data is old because nothing arrives. */
  get isOld(): boolean {
    return this.isLost || (this.age_s !== null && this.age_s >= OLD_S);
  }

  /** Reason for old data. */
  get trouble(): string {
    return this.isLost ? "The connection to the program is lost" : "The program sends no data";
  }

  beat({ time_s }: Beat): void {
    const now_ms = performance.now();
    const apart_ms = now_ms - 1000 * time_s;
    const since_ms = this.sent_s === null ? 0 : 1000 * (time_s - this.sent_s);
    this.apart_ms = Math.min(this.apart_ms + DRIFT * since_ms, apart_ms);
    this.late_ms = apart_ms - this.apart_ms;
    [this.sent_s, this.arrived_ms, this.arrivedByDate_ms] = [time_s, now_ms, Date.now()];
  }

  /** Time since the program was last known to be alive (s); null before the first beat. */
  get age_s(): number | null {
    if (this.sent_s === null) return null;
    // The first clock may stop while a page sleeps.
    const since_ms = Math.max(performance.now() - this.arrived_ms, Date.now() - this.arrivedByDate_ms);
    return (this.late_ms + since_ms) / 1000;
  }

  /** Whether the displayed data is current, so that orders may be based on it. */
  get isFresh(): boolean {
    return this.state === "live" && this.age_s !== null && this.age_s < OLD_S;
  }

  /** Return the time of a request made now. */
  give(): Given {
    const after_s = (performance.now() - this.arrived_ms) / 1000;
    return { number: ++this.number, beat_s: this.sent_s ?? 0, after_s };
  }
}
