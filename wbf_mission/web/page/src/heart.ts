// How old what is shown is, by the beats of the program: on this page's own clocks, for others differ from them.
import type { Beat, Given } from "./schema.js";

/** From this age on it is told, and from the second on what is shown is old: orders are not given by it. */
export const TOLD_S = 2;
export const OLD_S = 3;
/** Clocks of two machines drift apart by less than this part. */
const DRIFT = 1e-3;

export class Heart {
  private sent_s: number | null = null;
  private arrived_ms = 0;
  private arrivedByDate_ms = 0;
  /** How much later than the quickest beat the newest one came, and what the clocks differ by that one. */
  private late_ms = 0;
  private apart_ms = Infinity;
  private number = 0;

  /** Forget the beats: another connection has its own. */
  stop(): void {
    this.sent_s = null;
    this.apart_ms = Infinity;
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

  get isFresh(): boolean {
    return this.age_s !== null && this.age_s < OLD_S;
  }

  /** When a request is given: now. */
  give(): Given {
    const after_s = (performance.now() - this.arrived_ms) / 1000;
    return { number: ++this.number, beat_s: this.sent_s ?? 0, after_s };
  }
}
