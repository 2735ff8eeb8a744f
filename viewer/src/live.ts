// The page while a program flies: it adds what arrives to its flight, says which env to watch, and sends sticks.
// Python answers in flockstep/viewer/live.py.

import { element, toggle, type Key } from "./controls";
import { Flight } from "./flight";
import { stickKeys, Sticks, stickWords } from "./sticks";

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
  setNames(names: string[]): void;
}

const sendMs = 33;

export class Live {
  private readonly socket: WebSocket;
  private page: Shown | undefined;
  private work: Promise<void> = Promise.resolve();
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
    if (!source.flies) return;
    const sticks = new Sticks(() => this.send({ reset: true }));
    setInterval(() => this.send({ sticks: sticks.values() }), sendMs);
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
    const next = Flight.read(data);
    if (this.page) this.page.add(next);
    else {
      this.page = await this.show(next, this.source.flies ? stickKeys : []);
      this.page.setNames(this.status?.names ?? []);
    }
    this.received++;
    this.said.textContent = this.source.flies ? stickWords : "";
    this.send({ got: true }); // only then the next moment comes: a slow page misses moments
  }

  private end(reason: string): void {
    this.said.textContent = reason || "The program has ended";
    for (const control of element("watch").querySelectorAll<HTMLInputElement | HTMLButtonElement>("input, button")) control.disabled = true;
    if (!this.page) document.body.dataset.state = "ended";
  }
}
