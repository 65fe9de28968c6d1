// Uses of a plan: files, upload to a vehicle, flight in the simulator.
import { desk, keep, Refused, type Draft, type Options, type Planned } from "./desk.js";
import { ask, element, find, findButton, setText } from "./dom.js";
import { capital } from "./text.js";

const FOLLOW_MS = 500;
const CHECKED = "The vehicle is checked first, and the mission is read back afterwards. No motor starts.";

export class Takeaway {
  private readonly mission = find<HTMLSelectElement>(".mission");
  private readonly format = find<HTMLSelectElement>("#format");
  private readonly pace = find<HTMLSelectElement>("#pace");
  private readonly told = find(".told");
  private readonly save = findButton("#save-file", () => void this.act("", () => this.saved()));
  private readonly upload = findButton("#upload", () => this.askUpload());
  private readonly watch = find(".watch");
  private readonly stop = findButton("#stop", () => void this.act("", () => this.stopped()));
  private readonly start = findButton("#fly", () => void this.act("Preparing the flight …", () => this.fly()));
  private readonly how = find(".how");
  private planned: Planned | null = null;
  private following = 0;
  private followed = "";

  constructor(private readonly draft: () => Draft, formats: Options["formats"]) {
    this.format.append(...formats.map(({ name, suffix }) => new Option(`${name} (${suffix})`, suffix)));
    this.show(null);
  }

  show(planned: Planned | null): void {
    this.planned = planned;
    const chosen = this.mission.value;
    const missions = planned?.missions ?? [];
    this.mission.replaceChildren(...missions.map(({ name }, k) => new Option(capital(name) || "Mission", String(k))));
    if (chosen in missions) this.mission.value = chosen;
    this.save.disabled = this.upload.disabled = planned === null;
    this.start.disabled = planned?.not_flown !== "";
    setText(this.how, capital(planned?.not_flown || planned?.flown_note || ""));
  }

  private get number(): number {
    return Number(this.mission.value);
  }

  private async act(begin: string, work: () => Promise<string>): Promise<void> {
    this.say(begin);
    try {
      this.say(await work());
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      this.say(capital(error.message), true);
    }
  }

  private say(text: string, isBad = false): void {
    this.told.classList.toggle("bad", isBad);
    setText(this.told, text);
  }

  private async saved(): Promise<string> {
    const { name, content } = await desk.file(this.draft(), this.number, this.format.value);
    keep(name, content);
    return `Saved as ${name}`;
  }

  private async fly(): Promise<string> {
    await desk.fly(this.draft(), this.pace.value);
    this.watch.hidden = this.stop.hidden = false;
    this.watch.focus();
    this.followed = "";
    clearInterval(this.following);
    this.following = window.setInterval(() => void this.follow(), FOLLOW_MS);
    return "Preparing the flight …";
  }

  private async stopped(): Promise<string> {
    return (await desk.stop()).stopped ? "The flight is being stopped …" : "There is no flight to stop";
  }

  private async follow(): Promise<void> {
    let [told, bad, over] = ["The flight has begun: watch it on the live page.", false, false];
    try {
      const { outcome, words } = await desk.flight();
      if (outcome === "preparing") return;
      this.stop.hidden = over = outcome !== "flying";
      if (over) [told, bad] = [`The flight: ${words}`, outcome !== "completed" && outcome !== "interrupted"];
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      [told, bad, over] = [error.message, true, true];
    }
    if (over) clearInterval(this.following);
    if (told === this.followed) return;
    this.followed = told;
    this.say(told, bad);
  }

  private askUpload(): void {
    const mission = this.planned?.missions[this.number];
    if (!mission) return;
    // Clear the message of the previous action.
    this.say("");
    const link = element("input", { type: "text", required: true, autocomplete: "off", value: "udpin:127.0.0.1:14550" });
    const system = element("input", { type: "number", min: "1", max: "255", placeholder: "the first vehicle heard" });
    const sure = element("input", { type: "checkbox", required: true });
    const held = `${mission.plan.items.length} mission items${mission.plan.fence.length ? " and the fence" : ""}`;
    const parts = [
      element("p", {}, `${held} replace the vehicle's present plans. ${CHECKED}`),
      element("label", {}, "Link (udpin:, udpout:, tcp:, tcpin: or serial:)", link),
      element("label", {}, "System id", system),
      element("label", { class: "check" }, sure, "Replace the vehicle's mission"),
    ];
    const upload = (): Promise<string> => this.uploaded(link.value.trim(), system.value);
    const send = (): void => void this.act("Waiting for the vehicle …", upload);
    ask("Upload to a vehicle", parts, "Upload", send, () => this.say("Nothing was uploaded"));
  }

  private async uploaded(link: string, system_id: string): Promise<string> {
    const report = await desk.upload(this.draft(), this.number, link, system_id);
    const counts = Object.entries(report.items).map(([name, count]) => `${name} ${count}`).join(", ");
    const reason = report.texts.at(-1) ?? "it gives no reason";
    const rejected = report.accepted === false ? ` The vehicle stored the mission, but would not fly it: ${reason}.` : "";
    const equal = report.verified ? "equal" : "not equal";
    return `Uploaded to ${report.vehicle} (${counts} items) and read back: ${equal}.${rejected}`;
  }
}
