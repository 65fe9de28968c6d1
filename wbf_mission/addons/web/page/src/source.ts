// Where a page's data come from: the program that runs, or a recording within the page.
//
// A recording is in the page as
//   <script type="application/json" id="recording">{...}</script>
// with a `Recording` of schema.ts as its text ("<" as \u003c), or an array of two, which are shown side by side
// with one slider. The page may pack it: with data-packed="deflate" the text is base64 of the JSON packed by zlib.
// Without such an element the page asks the program by a WebSocket at /live, with the page's own query.
//
// A page has, in its body: <section id="summary"> (optional, above: any HTML, it is printed), and
// <div id="app">, in which the view is built. It loads page.css and, deferred, live.js.
import type { Heart } from "./heart.js";
import type { Answer, Order, Recording, Update } from "./schema.js";
import { inflate } from "./tiles.js";

const LONGEST_WAIT_MS = 5000;
/** Interval at which the age of the data is shown, as no data may arrive. */
const LOOK_MS = 250;

export interface Receiver {
  /** Start over: forget all data. */
  begin?(runs: number): void;
  take?(update: Update, run: number): void;
  /** Called when the connection has changed, and again and again, as the age of the data changes (`Heart`). */
  linked(): void;
}

/** An order to vehicles, or an answer to a question, without its time. */
export type Wish = Omit<Order, "given"> | Omit<Answer, "given">;

/** Sends a wish at once and returns its number, or null if impossible; nothing is queued. */
export type Send = (wish: Wish) => number | null;

/** Start receiving; returns the function that sends wishes, or null for a recording. */
export function open(receiver: Required<Receiver>, heart: Heart): Send | null {
  const kept = document.getElementById("recording");
  if (kept) {
    void read(kept).then((runs) => {
      receiver.begin(runs.length);
      runs.forEach((run, k) => receiver.take(run, k));
      heart.link = "recording";
      receiver.linked();
    });
    return null;
  }
  return connect("live", receiver, heart);
}

/** Receive only the program's heartbeat. */
export function listen(heart: Heart, linked: () => void): void {
  connect("beats", { linked }, heart);
}

async function read(kept: HTMLElement): Promise<Recording[]> {
  const text = kept.textContent ?? "";
  const packed = kept.dataset["packed"] === "deflate";
  const read: unknown = JSON.parse(packed ? new TextDecoder().decode(await inflate(text.trim())) : text);
  return (Array.isArray(read) ? read : [read]) as Recording[];
}

function connect(path: "live" | "beats", receiver: Receiver, heart: Heart): Send {
  let socket: WebSocket;
  let wait_ms = 250;
  const begin = (): void => {
    const address = new URL(`${path}${location.search}`, location.href);
    address.protocol = address.protocol.replace("http", "ws");
    let first = true;
    socket = new WebSocket(address);
    socket.onmessage = (message: MessageEvent<string>) => {
      if (first) {
        heart.stop();
        receiver.begin?.(1);
      }
      wait_ms = 250;
      const update = JSON.parse(message.data) as Update;
      if (update.beat) heart.beat(update.beat);
      receiver.take?.(update, 0);
      if (first) heart.link = "live";
      if (first || update.beat) receiver.linked();
      first = false;
    };
    socket.onclose = () => {
      heart.link = "lost";
      receiver.linked();
      setTimeout(begin, wait_ms);
      wait_ms = Math.min(2 * wait_ms, LONGEST_WAIT_MS);
    };
  };
  receiver.linked();
  setInterval(() => receiver.linked(), LOOK_MS);
  begin();
  return (wish) => {
    if (socket.readyState !== WebSocket.OPEN || !heart.isFresh) return null;
    const request: Order | Answer = { ...wish, given: heart.give() };
    socket.send(JSON.stringify(request));
    return request.given.number;
  };
}
