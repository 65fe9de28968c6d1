// Displayed time: the present or an earlier time, with a slider and playback.
import { button, element, setText, slider } from "./dom.js";
import { clock } from "./text.js";

const SPEEDS = [1, 2, 5, 10, 30, 100, 300];
/** Approximate duration of a recording at the default speed (s). */
const PLAY_S = 60;
const STEP_S = 5;
/** Keys that move the slider back and forth. */
const [BACK, FORTH] = [["ArrowLeft", "ArrowDown", "PageDown"], ["ArrowRight", "ArrowUp", "PageUp"]];

export class Time {
  /** Displayed time while not following the present. */
  private at_s = 0;
  private end_s = 0;
  private follows = this.live;
  private playing = false;
  private last_ms = 0;
  private readonly attributes = { min: 0, step: 0.1, "aria-label": "Time of the run" };
  private readonly slider = slider(this.attributes, (time_s) => this.seek(time_s));
  private readonly play = button("", () => this.toggle(), { class: "play", "aria-label": "Play" });
  private readonly now = button("Latest", () => this.seek(Infinity), { class: "now" });
  private readonly text = element("output", { class: "clock" });
  private readonly speeds = element(
    "select",
    { "aria-label": "Speed of playing" },
    ...SPEEDS.map((speed) => new Option(`${speed}×`, String(speed))),
  );
  private readonly parts = [this.play, this.slider, this.text, this.speeds, this.live ? this.now : null];
  readonly element = element("div", { class: "time", role: "group", "aria-label": "Time" }, ...this.parts);

  constructor(private readonly live: boolean, private readonly changed: () => void) {
    this.slider.addEventListener("keydown", (event) => this.step(event));
    document.addEventListener("keydown", (event) => {
      const taken = (event.target as Element).closest("input, select, button, summary, dialog, [role=button]");
      if (event.key !== " " || (taken && taken !== this.slider)) return;
      event.preventDefault();
      this.toggle();
    });
  }

  get time_s(): number {
    return this.follows ? this.end_s : this.at_s;
  }

  /** Extend the time range to `end_s`, for a recording once. */
  reach(end_s: number): void {
    if (end_s === this.end_s) return;
    this.end_s = end_s;
    this.slider.max = String(end_s);
    if (this.live) return;
    this.at_s = end_s;
    this.speeds.value = String(SPEEDS.findLast((speed) => speed * PLAY_S <= Math.max(end_s, PLAY_S)));
  }

  seek(time_s: number): void {
    this.at_s = Math.min(Math.max(time_s, 0), this.end_s);
    this.follows = this.live && this.at_s >= this.end_s;
    this.changed();
  }

  /** Advance the playback by one frame. */
  tick(now_ms: number): void {
    if (this.playing) {
      this.seek(this.at_s + (Math.min(now_ms - this.last_ms, 250) / 1000) * Number(this.speeds.value));
      this.playing = this.at_s < this.end_s;
    }
    this.last_ms = now_ms;
  }

  show(): void {
    this.slider.value = String(this.time_s);
    this.slider.style.setProperty("--part", `${(100 * this.time_s) / (this.end_s || 1)}%`);
    setText(this.text, `${clock(this.time_s)} / ${clock(this.end_s)}`);
    this.slider.setAttribute("aria-valuetext", `${clock(this.time_s)} of ${clock(this.end_s)}`);
    this.play.setAttribute("aria-label", this.playing ? "Pause" : "Play");
    this.play.classList.toggle("playing", this.playing);
    this.now.setAttribute("aria-pressed", String(this.follows));
  }

  private toggle(): void {
    this.playing = !this.playing;
    if (this.playing) this.seek(this.time_s >= this.end_s ? 0 : this.time_s);
    else this.changed();
  }

  /** Arrow keys move by seconds instead of the slider's small steps. */
  private step(event: KeyboardEvent): void {
    const direction = BACK.includes(event.key) ? -1 : FORTH.includes(event.key) ? 1 : 0;
    if (!direction) return;
    event.preventDefault();
    const step_s = event.key.startsWith("Page") ? Math.max(STEP_S, this.end_s / 20) : STEP_S;
    this.seek(this.time_s + direction * step_s);
  }
}
