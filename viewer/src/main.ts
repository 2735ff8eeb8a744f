// The page: reads its flights, and plays them.

import * as THREE from "three";
import { modes, Viewer, type Mode } from "./cameras";
import { bindKeys, describe, drawTicks, element, endColor, fillSelect, ImagePanel, listEnds, toggle, type Key } from "./controls";
import { CurvePanel } from "./curves";
import { ghostColor } from "./drones";
import { Flight, unpack } from "./flight";
import { describeLaps } from "./gates";
import { Live } from "./live";
import { canFly, Solo } from "./solo";
import { Stage, type Choice } from "./stage";
import { stickKeys } from "./sticks";

THREE.Object3D.DEFAULT_UP.set(0, 0, 1);

function fail(error: unknown): void {
  const problem = element("problem");
  problem.hidden = false;
  problem.textContent = `This flight cannot be shown: ${error instanceof Error ? error.message : String(error)}`;
  document.body.dataset.state = "failed";
}

class Page {
  readonly choice: Choice = {
    env: 0,
    drone: 0,
    which: "env",
    seconds: 0,
    sideBySide: false,
    ghost: true,
    layers: { beams: true, frustum: true, contacts: true, path: true, trails: true, hull: false, roof: false, markers: true, peephole: true },
  };
  speed = 1;
  isPlaying = false;
  /** Number of drawn images, and when the first was there, ms since the page began to load. */
  drawn = 0;
  readyMs = 0;
  private isDirty = true;
  private hasGrown = false;
  private grownAt = 0;
  private before = 0;
  private jumped = true;
  private readonly flight: Flight;
  readonly viewer: Viewer;
  readonly stage: Stage;
  private readonly curves: CurvePanel;
  private readonly images: ImagePanel[];
  private readonly buttons = new Map<string, HTMLButtonElement>();

  /** Names of an env's drones; numbers stand for those without one. */
  private names: string[] = [];

  /** `taken` are the keys of a pilot who flies the first drone. */
  constructor(
    readonly flights: Flight[],
    private readonly taken: Key[] = [],
  ) {
    this.flight = flights[0];
    this.viewer = new Viewer(element("view"), () => this.invalidate());
    this.stage = new Stage(element("view"), this.viewer, () => this.invalidate());
    this.curves = new CurvePanel(this.flight, element("chips"), element("curves"), (seconds) => this.seek(seconds), taken.length ? 0 : 2);
    if (taken.length) this.choice.layers.beams = this.choice.layers.frustum = false;
    this.images = this.flight.cameras.map((camera) => new ImagePanel(this.flight, camera));
    const camera = this.flight.cameras[0];
    if (camera) {
      const [w, x, y, z] = camera.quat_wxyz;
      this.viewer.eye = { offset: new THREE.Vector3(...camera.offset_m), turn: new THREE.Quaternion(x, y, z, w), tangents: camera.tangents };
    }
  }

  async start(): Promise<void> {
    for (const flight of this.flights) await this.stage.add(flight);
    await this.stage.makeReady(this.choice);
    performance.mark("made");
    this.fillControls();
    this.bind();
    this.stage.resize();
    this.stage.update(this.choice);
    if (this.taken.length) this.setMode("follow");
    else this.frameWorld();
    this.curves.show(0);
    new ResizeObserver(() => {
      this.stage.resize();
      this.invalidate();
    }).observe(element("view"));
    requestAnimationFrame((now) => this.frame(now));
  }

  private frameWorld(): void {
    const pose = this.stage.pose();
    const bounds = this.stage.bounds();
    this.viewer.frame(bounds, pose ? new THREE.Vector3(pose[0], pose[1], pose[2]) : bounds.getCenter(new THREE.Vector3()));
  }

  private get total(): number {
    return Math.max(...this.flights.map((flight) => flight.seconds));
  }

  /** Adds moments to the flight, and shows the last one if the one before was shown. */
  add(next: Flight): void {
    const { choice, flight } = this;
    const follows = !next.goesOn || this.isLatest();
    const gone = flight.add(next);
    choice.seconds = follows ? flight.seconds : Math.max(choice.seconds - gone, 0);
    if (!next.goesOn) {
      this.stage.renderer.shadowMap.needsUpdate = this.jumped = true;
      for (const panel of this.images) panel.forget();
      this.describeFlight();
    }
    this.stage.grow().catch(fail);
    this.isDirty = this.hasGrown = true;
  }

  /** Returns whether the page shows the last moment of a flight that grows. */
  isLatest(): boolean {
    return this.choice.seconds >= this.flight.seconds && !this.isPlaying;
  }

  private grow(now: number): void {
    if (!this.hasGrown || now - this.grownAt < 250) return; // charts and lists cost more than a moment in 3D
    [this.hasGrown, this.grownAt] = [false, now];
    this.curves.grow();
    this.listEnds();
  }

  private listEnds(): void {
    listEnds(this.flights, (end, flight) => {
      if (flight === this.flight) this.choose(flight.rows === flight.drones ? end.row : end.row * flight.perEnv);
      this.seek(flight.timeAt(end.step));
    });
  }

  private describeFlight(): void {
    const { flight } = this;
    const count = (number: number, noun: string): string => `${number.toLocaleString("en")} ${noun}${number === 1 ? "" : "s"}`;
    element("about").textContent = [flight.worlds[flight.worldOf(0, 0)].name, flight.envs > 1 ? count(flight.envs, "env") : "", count(flight.drones, "drone"), flight.drone.name, this.total ? `${this.total.toFixed(1)} s` : ""].filter(Boolean).map((words) => words.replaceAll(" ", "\u00a0")).join(" · ");
  }

  invalidate(): void {
    this.isDirty = true;
  }

  seek(seconds: number): void {
    this.choice.seconds = Math.min(Math.max(Number.isFinite(seconds) ? seconds : 0, 0), this.total);
    this.jumped = true;
    this.invalidate();
  }

  play(isPlaying: boolean): void {
    if (isPlaying && this.choice.seconds >= this.total) this.seek(0);
    this.isPlaying = isPlaying;
    element("play").textContent = isPlaying ? "❚❚" : "▶";
    element("play").setAttribute("aria-label", isPlaying ? "Pause" : "Play");
    this.invalidate();
  }

  choose(drone: number): void {
    const count = this.flight.drones;
    this.choice.drone = ((drone % count) + count) % count;
    this.choice.env = this.flight.envOf(this.choice.drone);
    element<HTMLSelectElement>("env").selectedIndex = this.choice.env;
    this.fillDrones();
    this.curves.show(this.choice.drone);
    this.jumped = true;
    this.invalidate();
  }

  setNames(names: string[]): void {
    this.names = names;
    this.fillDrones();
    this.invalidate();
  }

  private nameOf(drone: number): string {
    return this.names[drone % this.flight.perEnv] ?? `drone ${drone}`;
  }

  setMode(mode: Mode): void {
    if (mode === "orbit" && this.viewer.mode !== "orbit") this.frameWorld();
    this.viewer.mode = mode;
    for (const other of modes) this.buttons.get(other)!.setAttribute("aria-pressed", String(other === mode));
    if (mode !== "eye") this.viewer.controls.update();
    this.jumped = true;
    this.invalidate();
  }

  private fillDrones(): void {
    const { perEnv } = this.flight;
    const first = this.choice.env * perEnv;
    const select = element<HTMLSelectElement>("drone");
    fillSelect(select, Array.from({ length: perEnv }, (_, i) => this.names[i] ?? String(first + i)), (i) => this.choose(first + i));
    select.selectedIndex = this.choice.drone - first;
  }

  private fillControls(): void {
    const { flight, choice } = this;
    element("title").textContent = document.title = flight.title;
    this.describeFlight();
    for (const mode of modes) {
      const button = toggle(element("modes"), mode[0].toUpperCase() + mode.slice(1), mode === "orbit", () => this.setMode(mode));
      this.buttons.set(mode, button);
    }
    fillSelect(element("env"), Array.from({ length: flight.envs }, (_, i) => `${i}: ${flight.worlds[flight.worldOf(i, 0)].name}`), (i) => this.choose(i * flight.perEnv));
    element("env-label").hidden = flight.envs === 1;
    element("which-label").hidden = flight.drones === 1;
    element<HTMLSelectElement>("which").onchange = (event) => {
      choice.which = (event.target as HTMLSelectElement).value as Choice["which"];
      this.invalidate();
    };
    this.fillDrones();
    const layers: [keyof Choice["layers"], string, boolean][] = [
      ["trails", "Trail", true],
      ["path", "Planned path", flight.paths.length > 0],
      ["beams", "Beams", flight.lidars.length > 0],
      ["frustum", "Frustum", flight.cameras.length > 0],
      ["contacts", "Contacts", true],
      ["markers", "Markers", true],
      ["hull", "Hull", flight.drone.hull !== null],
      ["roof", "Roof", flight.worlds.some((world) => world.cut_m !== null)],
      ["peephole", "See through", true],
    ];
    for (const [layer, text, exists] of layers) {
      if (!exists) continue;
      const button = toggle(element("layers"), text, choice.layers[layer], (isOn) => {
        choice.layers[layer] = isOn;
        if (layer === "roof") this.stage.renderer.shadowMap.needsUpdate = true;
        this.invalidate();
      });
      this.buttons.set(layer, button);
    }
    if (this.flights.length > 1) {
      element("compare").hidden = false;
      this.buttons.set("ghost", toggle(element("compare"), "Ghost", true, (isOn) => this.compare(false, isOn)));
      this.buttons.set("side", toggle(element("compare"), "Side by side", false, (isOn) => this.compare(isOn, true)));
    }
    this.listEnds();
  }

  private compare(sideBySide: boolean, ghost: boolean): void {
    Object.assign(this.choice, { sideBySide, ghost });
    this.buttons.get("side")!.setAttribute("aria-pressed", String(sideBySide));
    this.buttons.get("ghost")!.setAttribute("aria-pressed", String(ghost && !sideBySide));
    element("split").hidden = !sideBySide;
    element("label-b").hidden = !sideBySide;
    element("label-b").textContent = this.flights[1].label;
    this.invalidate();
  }

  private bind(): void {
    const time = element<HTMLInputElement>("time");
    time.addEventListener("input", () => this.seek(Number(time.value)));
    element("play").addEventListener("click", () => this.play(!this.isPlaying));
    element<HTMLSelectElement>("speed").addEventListener("change", (event) => (this.speed = Number((event.target as HTMLSelectElement).value)));
    const help = element<HTMLDialogElement>("help");
    element("help-button").addEventListener("click", () => help.showModal());
    const press = (key: string, name: string, about: string): Key[] => {
      const button = this.buttons.get(name);
      return button ? [{ keys: [key], shown: key.toUpperCase(), about, act: () => button.click() }] : [];
    };
    const by = (steps: number, seconds: number) => (event: KeyboardEvent) =>
      this.seek(event.shiftKey ? this.choice.seconds + seconds : this.flight.timeAt(this.flight.stepAt(this.choice.seconds) + steps));
    const speed = (by: number): void => {
      const select = element<HTMLSelectElement>("speed");
      select.selectedIndex = Math.min(Math.max(select.selectedIndex + by, 0), select.options.length - 1);
      this.speed = Number(select.value);
    };
    const keys: Key[] = [
      { keys: [" ", "k"], shown: "Space", about: "play or pause", act: () => this.play(!this.isPlaying) },
      { keys: ["ArrowLeft"], shown: "← →", about: "one step; with Shift one second", act: by(-1, -1) },
      { keys: ["Home"], shown: "Home End", about: "begin and end", act: () => this.seek(0) },
      { keys: ["[", ","], shown: "[ ]", about: "slower, faster", act: () => speed(-1) },
      { keys: ["1"], shown: "1 2 3 4", about: "orbit, follow, drone's eye, free camera", act: () => this.setMode("orbit") },
      ...(this.flight.drones > 1 ? [{ keys: ["n"], shown: "N P", about: "next and previous drone", act: () => this.choose(this.choice.drone + 1) }] : []),
      ...press("b", "beams", "LiDAR beams"),
      ...press("t", "trails", "trail"),
      ...press("l", "path", "planned path"),
      ...press("m", "hull", "hull: what collides, instead of the drone's mesh"),
      ...press("r", "roof", "roof"),
      ...press("g", "ghost", "ghost: the second flight in the same view"),
      ...press("c", "side", "side by side"),
      { keys: ["?", "h"], shown: "?", about: "this help", act: () => help.showModal() },
    ];
    const rest: Key[] = [
      { keys: ["ArrowRight"], shown: "", about: "", act: by(1, 1) },
      { keys: ["End"], shown: "", about: "", act: () => this.seek(this.total) },
      { keys: ["]", "."], shown: "", about: "", act: () => speed(1) },
      { keys: ["p"], shown: "", about: "", act: () => this.choose(this.choice.drone - 1) },
      ...modes.slice(1).map((mode, i) => ({ keys: [String(i + 2)], shown: "", about: "", act: () => this.setMode(mode) })),
    ];
    const flying: Key[] = [{ keys: ["w", "a", "s", "d", "q", "e"], shown: "W A S D Q E", about: "move the free camera; with Shift faster", act: () => undefined }];
    const taken = new Set(this.taken.flatMap((key) => key.keys));
    const free = [...keys, ...flying, ...rest].filter((key) => !key.keys.some((name) => taken.has(name.toLowerCase())));
    bindKeys([...this.taken, ...free]);
    const hold = (event: KeyboardEvent): void => {
      if (this.viewer.mode !== "free" || event.ctrlKey || event.metaKey) return;
      const key = event.key.toLowerCase();
      if (!"wasdqe".includes(key) && key !== "shift") return;
      this.viewer.hold(key, event.type === "keydown");
      this.invalidate();
    };
    addEventListener("keydown", hold);
    addEventListener("keyup", hold);
  }

  private frame(now: number): void {
    const passed = Math.min((now - this.before) / 1000, 0.25);
    this.before = now;
    if (this.isPlaying) {
      this.choice.seconds = Math.min(this.choice.seconds + passed * this.speed, this.total);
      if (this.choice.seconds >= this.total) this.play(false);
      this.isDirty = true;
    }
    if (this.viewer.isMoving) this.isDirty = true;
    this.grow(now);
    if (this.isDirty) {
      this.isDirty = false;
      try {
        this.draw(passed);
      } catch (error) {
        fail(error);
        return;
      }
    }
    requestAnimationFrame((then) => this.frame(then));
  }

  private draw(passed: number): void {
    const { choice, flight } = this;
    this.stage.makeReady(choice).catch(fail);
    this.stage.update(choice);
    this.viewer.update(this.stage.pose(), passed, this.jumped);
    this.stage.draw(choice);
    this.jumped = false;
    const step = flight.stepAt(choice.seconds);
    const time = element<HTMLInputElement>("time");
    time.max = String(Math.max(this.total, 1e-9));
    time.value = String(choice.seconds);
    element("clock").textContent = `${choice.seconds.toFixed(2)} / ${this.total.toFixed(1)} s`;
    drawTicks(element("ticks"), flight, choice.seconds, this.total, flight.rowOf(choice.drone));
    this.curves.update(choice.seconds);
    for (const panel of this.images) panel.update(choice.drone, step);
    element("race").textContent = describeLaps(flight, choice.drone, choice.seconds);
    this.describe(step);
    this.describeGhost();
    this.drawn++;
    if (!this.stage.isReady(choice) || document.body.dataset.state) return;
    document.body.dataset.state = "ready";
    this.readyMs = performance.now();
  }

  /** Says how the second flight ended, once it has. */
  private describeGhost(): void {
    const flight = this.flights[1];
    if (!flight) return;
    const drone = Math.min(this.choice.drone, flight.drones - 1);
    const step = flight.stepAt(this.choice.seconds);
    const end = flight.endOf(flight.rowOf(drone), flight.episodeStart(drone, step));
    const ended = end && end.step <= step ? describe(end, flight) : "flies";
    const [ours, theirs] = this.flights.map((each) => each.worlds[each.worldOf(each.envOf(Math.min(this.choice.drone, each.drones - 1)), each.stepAt(this.choice.seconds))].name);
    element("state-b").textContent = `${flight.label}: ${ended}${ours === theirs ? "" : ` · in another world, ${theirs}`}`;
    element("state-b").style.color = ghostColor;
  }

  private describe(step: number): void {
    const { flight, choice } = this;
    const state = element("state");
    const words = [...(flight.label ? [flight.label] : []), this.nameOf(choice.drone)];
    const pose = this.stage.pose();
    if (!pose) words.push("no finite pose");
    const velocity = flight.column("velocity");
    if (velocity) {
      const [x, y, z] = [0, 1, 2].map((axis) => flight.value(velocity, step, 3 * choice.drone + axis));
      words.push(`${Math.hypot(x, y, z).toFixed(1)} m/s`);
    }
    const height = flight.column("above_m");
    const above = height ? flight.value(height, step, choice.drone) : NaN;
    if (Number.isFinite(above)) words.push(`${above.toFixed(1)} m above ground`);
    state.textContent = words.join(" · ");
    const end = flight.endOf(flight.rowOf(choice.drone), flight.episodeStart(choice.drone, step));
    if (!end || end.step > step) return;
    const ended = document.createElement("span");
    ended.textContent = ` · ${describe(end, flight)}`;
    ended.style.color = endColor(end.reason);
    state.append(ended);
  }
}

async function show(flights: Flight[], taken: Key[] = []): Promise<Page> {
  const page = new Page(flights, taken);
  Object.assign(globalThis, { flockstep: { ...(globalThis as { flockstep?: object }).flockstep, page, flights } }); // for tests and the curious
  await page.start();
  return page;
}

async function main(): Promise<void> {
  performance.mark("start");
  const source = document.getElementById("live");
  if (source) {
    const live = new Live(JSON.parse(source.textContent ?? ""), async (flight, keys) => show([flight], keys), fail);
    Object.assign(globalThis, { flockstep: { live } });
    return;
  }
  const blocks = document.querySelectorAll<HTMLScriptElement>("script[type='application/gzip']");
  const flights: Flight[] = [];
  for (const [i, block] of blocks.entries()) {
    const flight = await unpack(block.textContent ?? "");
    if (blocks.length > 1) flight.label = `${"AB"[i]}: ${block.dataset.name ?? flight.title}`;
    flights.push(flight);
    block.remove(); // the text is not needed twice
  }
  if (!flights.length) throw new Error("the page holds no flight");
  performance.mark("unpacked");
  if (flights.length > 1 || !canFly(flights[0]) || location.protocol === "about:") await show(flights); // in a notebook there is no address
  else await offerRace(flights[0]);
}

/** Shows a recorded race, or at the address with #fly lets the visitor fly against it. */
async function offerRace(rival: Flight): Promise<void> {
  const flies = location.hash === "#fly";
  addEventListener("hashchange", () => location.reload());
  element("watch").append(Object.assign(document.createElement("a"), { href: flies ? "#" : "#fly", textContent: flies ? "Watch the recorded flight" : "Fly against this drone" }));
  element("watch").hidden = false;
  if (!flies) {
    await show([rival]);
    return;
  }
  const solo = await Solo.make(rival);
  const own = solo.begin(true);
  [own.label, rival.label] = ["you", "ghost"];
  Object.assign(globalThis, { flockstep: { solo } });
  solo.run(await show([own, rival], stickKeys));
}

main().catch(fail);
