// Where a page's data come from: the program that runs, or recordings within the page, in
//   <script type="application/json" id="recording">...</script>
// Its text is base64 of JSON packed by zlib: an array of one `Recording` of schema.ts, or of two, which are shown side
// by side with one slider. Without it the page asks the program by a WebSocket at /live, with the page's own query.
//
// A page has, in its body: <section id="summary"> (optional, above: any HTML, it is printed), and
// <div id="app">, in which the view is built. It loads page.css and, deferred, live.js.
import type { Answer, Beat, Given, Order, Recording, Update } from "./schema.js";
import { inflate } from "./tiles.js";

const LONGEST_WAIT_MS = 5000;
/** Interval at which the age of the data is shown, as no data may arrive. */
const LOOK_MS = 250;
/** Age from which the page shows it, and from which data is old and no orders are given (s). */
export const TOLD_S = 2;
const OLD_S = 3;
/** Minimum duration of a reported connection loss. */
const LOST_MS = 600;
/** Maximum relative drift between the clocks of two machines. */
const DRIFT = 1e-3;

interface Receiver {
  /** Start over: forget all data. */
  begin?(): void;
  take?(update: Update): void;
  /** Called when the connection has changed, and again and again, as the age of the data changes (`Heart`). */
  linked(): void;
}

/** An order to vehicles, or an answer to a question, without its time. */
export type Wish = Omit<Order, "given"> | Omit<Answer, "given">;

/** Sends a wish at once and returns its number, or null if impossible; nothing is queued. */
export type Send = (wish: Wish) => number | null;

export async function read(recordings: HTMLElement): Promise<Recording[]> {
  return JSON.parse(new TextDecoder().decode(await inflate(recordings.textContent!.trim()))) as Recording[];
}

/** Receive the data of a run, or only the program's heartbeat; returns the function that sends wishes. */
export function connect(path: "live" | "beats", heart: Heart, receiver: Receiver): Send {
  let socket: WebSocket;
  let wait_ms = 250;
  const begin = (): void => {
    const address = new URL(`${path}${location.search}`, location.href);
    address.protocol = address.protocol.replace("http", "ws");
    let first = true;
    socket = new WebSocket(address);
    socket.onmessage = (message: MessageEvent<string>) => {
      if (first) {
        heart.begin();
        receiver.begin?.();
      }
      wait_ms = 250;
      const update = JSON.parse(message.data) as Update;
      if (update.beat) heart.beat(update.beat);
      receiver.take?.(update);
      if (first || update.beat) receiver.linked();
      first = false;
    };
    socket.onclose = () => {
      heart.lose();
      receiver.linked();
      setTimeout(begin, wait_ms);
      wait_ms = Math.min(2 * wait_ms, LONGEST_WAIT_MS);
    };
  };
  setInterval(() => receiver.linked(), LOOK_MS);
  begin();
  return (wish) => {
    if (socket.readyState !== WebSocket.OPEN || !heart.isFresh) return null;
    const request: Order | Answer = { ...wish, given: heart.give() };
    socket.send(JSON.stringify(request));
    return request.given.number;
  };
}

/** Age of the displayed data, from the program's beats and the page's own clocks. */
export class Heart {
  /** When the connection was lost; null with a connection, or before the first one. */
  lost_ms: number | null = null;
  private sent_s: number | null = null;
  private arrived_ms = 0;
  private arrivedByDate_ms = 0;
  /** Delay of the newest beat relative to the fastest one, and clock difference by the fastest one. */
  private late_ms = 0;
  private apart_ms = Infinity;
  private number = 0;

  /** Begin a connection, and forget the beats of the previous one. */
  begin(): void {
    [this.lost_ms, this.sent_s, this.apart_ms] = [null, null, Infinity];
  }

  lose(): void {
    this.lost_ms ??= performance.now(); // Repeated attempts may fail, too
  }

  /** Whether the connection has been lost long enough to report it. */
  get isLost(): boolean {
    return this.lost_ms !== null && performance.now() - this.lost_ms >= LOST_MS;
  }

  /** Whether the displayed data is old because nothing arrives. */
  get isOld(): boolean {
    return this.isLost || (this.age_s !== null && this.age_s >= OLD_S);
  }

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
    return this.lost_ms === null && this.age_s !== null && this.age_s < OLD_S;
  }

  /** Return the time of a request made now. */
  give(): Given {
    const after_s = (performance.now() - this.arrived_ms) / 1000;
    return { number: ++this.number, beat_s: this.sent_s ?? 0, after_s };
  }
}
