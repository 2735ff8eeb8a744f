// The page while a program flies: it adds what arrives to its flight, says which env to watch, and sends sticks.
// Python answers in flockstep/viewer/live.py.

import { element, toggle, type Key } from "./controls";
import { Flight } from "./flight";

/** What the page knows before the first moment. */
interface Source {
  envs: number;
  flies: boolean;
}

/** What Python says beside moments. */
interface Status {
  env: number;
  paused: boolean;
  real_time: boolean;
  names: string[];
}

interface Shown {
  add(next: Flight): void;
  setMode(mode: "follow"): void;
  setNames(names: string[]): void;
}

const sendMs = 33;
/** Share of a stick's way that a key is. */
const keyShare = 0.4;
const deadZone = 0.06;
/** Sticks throttle, roll, pitch and yaw: index and direction. */
const keys: Record<string, [number, number]> = {
  w: [0, 1], s: [0, -1], arrowright: [1, 1], arrowleft: [1, -1], arrowup: [2, 1], arrowdown: [2, -1], d: [3, 1], a: [3, -1],
};

const act = (): void => undefined; // `Live.fly` does it
/** What the help says of the sticks. */
const stickKeys: Key[] = [
  { keys: ["w", "s"], shown: "W S", about: "throttle; gamepad: left stick, up and down", act },
  { keys: ["a", "d"], shown: "A D", about: "yaw; gamepad: left stick, sideways", act },
  { keys: ["arrowup", "arrowdown"], shown: "↑ ↓", about: "pitch; gamepad: right stick, up and down", act },
  { keys: ["arrowleft", "arrowright"], shown: "← →", about: "roll; gamepad: right stick, sideways", act },
  { keys: ["r"], shown: "R", about: "begin again", act },
];

/** Sticks of the first gamepad with two sticks: the left one is throttle and yaw. */
function gamepad(): number[] {
  const pad = navigator.getGamepads().find((each) => each && each.connected && each.axes.length >= 4);
  if (!pad) return [0, 0, 0, 0];
  const [yaw, down, roll, back] = pad.axes;
  return [-down, roll, -back, yaw].map((value) => (Math.abs(value) < deadZone ? 0 : value));
}

export class Live {
  private readonly socket: WebSocket;
  private page: Shown | undefined;
  private work: Promise<void> = Promise.resolve();
  private readonly held = new Set<string>();
  private readonly said = document.createElement("p");
  private readonly env = document.createElement("input");
  private readonly pause = document.createElement("button");
  private status: Status | undefined;
  private realTime: HTMLButtonElement | undefined;
  /** Number of moments that have arrived. */
  received = 0;

  constructor(
    private readonly source: Source,
    private readonly show: (flight: Flight, keys: Key[]) => Promise<Shown>,
    private readonly fail: (error: unknown) => void,
  ) {
    this.fill();
    this.socket = new WebSocket(`ws://${location.host}/live${location.search}`);
    this.socket.binaryType = "arraybuffer";
    this.socket.addEventListener("message", ({ data }) => {
      if (typeof data === "string") this.tell(JSON.parse(data) as Status);
      else this.work = this.work.then(() => this.receive(data as ArrayBuffer)).catch(this.fail);
    });
    this.socket.addEventListener("close", ({ reason }) => this.end(reason));
    if (source.flies) this.fly();
  }

  private send(message: object): void {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }

  private fill(): void {
    const box = element("watch");
    box.hidden = false;
    this.said.textContent = "Waiting for the next step";
    element("title").textContent = "flockstep";
    const label = document.createElement("label");
    label.hidden = this.source.envs === 1;
    Object.assign(this.env, { type: "number", min: "0", max: String(this.source.envs - 1), value: "0", id: "watched" });
    label.append(`Env of ${this.source.envs.toLocaleString("en")} `, this.env);
    this.env.addEventListener("change", () => this.send({ env: Math.round(Number(this.env.value)) }));
    box.append(label);
    this.pause.textContent = "Pause";
    this.pause.addEventListener("click", () => this.send({ paused: !this.status?.paused }));
    const step = document.createElement("button");
    step.textContent = "Step";
    step.addEventListener("click", () => this.send({ step: true }));
    box.append(this.pause, step);
    if (!this.source.flies) this.realTime = toggle(box, "Real time", false, (real_time) => this.send({ real_time }));
    box.append(this.said);
  }

  /** Shows what Python says. */
  private tell(status: Status): void {
    if (document.activeElement !== this.env) this.env.value = String(status.env);
    this.status = status;
    this.pause.textContent = status.paused ? "Resume" : "Pause";
    this.realTime?.setAttribute("aria-pressed", String(status.real_time));
    this.page?.setNames(status.names);
  }

  private async receive(data: ArrayBuffer): Promise<void> {
    const next = new Flight(data);
    if (this.page) this.page.add(next);
    else {
      this.page = await this.show(next, this.source.flies ? stickKeys : []);
      this.page.setNames(this.status?.names ?? []);
      if (this.source.flies) this.page.setMode("follow");
    }
    this.received++;
    this.said.textContent = this.source.flies ? "W S A D and arrows, or a gamepad. R begins again" : "";
    this.send({ got: true }); // only then the next moment comes: a slow page misses moments
  }

  private end(reason: string): void {
    this.said.textContent = reason || "The program has ended";
    for (const control of element("watch").querySelectorAll<HTMLInputElement | HTMLButtonElement>("input, button")) control.disabled = true;
    if (!this.page) document.body.dataset.state = "ended";
  }

  private fly(): void {
    const hold = (event: KeyboardEvent): void => {
      const key = event.key.toLowerCase();
      if (event.ctrlKey || event.metaKey || event.altKey || !(key in keys || key === "r")) return;
      event.stopImmediatePropagation(); // the page's own keys
      event.preventDefault();
      if (event.type === "keyup") this.held.delete(key);
      else if (key !== "r") this.held.add(key);
      else if (!event.repeat) this.send({ reset: true });
    };
    for (const type of ["keydown", "keyup"] as const) addEventListener(type, hold, true);
    addEventListener("blur", () => this.held.clear());
    setInterval(() => {
      const sticks = gamepad();
      for (const key of this.held) sticks[keys[key][0]] += keyShare * keys[key][1];
      this.send({ sticks: sticks.map((value) => Math.min(Math.max(value, -1), 1)) });
    }, sendMs);
  }
}
