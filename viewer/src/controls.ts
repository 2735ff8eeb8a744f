// Buttons, lists and keys around the view. Every text of a recording becomes textContent: it is never markup.

import type { CameraInfo, EpisodeEnd, Flight } from "./flight";

export const element = <Kind extends HTMLElement>(id: string): Kind => document.getElementById(id) as Kind;

const endColors: Record<string, string> = { success: "#5fe3a1", contact: "#ff6b5c", bad_state: "#ff6b5c", left_area: "#ffb454", time: "#8fa6c9", task: "#d79bff", teammate: "#8fa6c9" };
export const endColor = (reason: string): string => endColors[reason] ?? "#8fa6c9";
const mostListed = 400;

/** Adds a button that is pressed or not. */
export function toggle(parent: HTMLElement, text: string, isPressed: boolean, act: (isPressed: boolean) => void): HTMLButtonElement {
  const button = document.createElement("button");
  button.textContent = text;
  button.setAttribute("aria-pressed", String(isPressed));
  button.addEventListener("click", () => {
    const now = button.getAttribute("aria-pressed") !== "true";
    button.setAttribute("aria-pressed", String(now));
    act(now);
  });
  parent.append(button);
  return button;
}

export function fillSelect(select: HTMLSelectElement, names: string[], act: (index: number) => void): void {
  select.replaceChildren(
    ...names.map((name, i) => {
      const option = document.createElement("option");
      option.value = String(i);
      option.textContent = name;
      return option;
    }),
  );
  select.onchange = () => act(select.selectedIndex);
}

export function describe(end: EpisodeEnd, flight: Flight): string {
  return `${end.reason.replace("_", " ")} at ${flight.timeAt(end.step).toFixed(1)} s`;
}

/** Lists how episodes ended; a click goes there. */
export function listEnds(flights: Flight[], visit: (end: EpisodeEnd, flight: Flight) => void): void {
  const box = element("episodes");
  box.hidden = flights.every((flight) => flight.ends.length === 0);
  const list = box.querySelector("ol")!;
  list.replaceChildren();
  for (const [flight, end] of flights.flatMap((each) => each.ends.slice(-mostListed).map((end) => [each, end] as const))) {
    const item = document.createElement("li");
    const button = document.createElement("button");
    const dot = document.createElement("span");
    dot.textContent = "● ";
    dot.style.color = endColor(end.reason);
    const who = flight.rows === 1 ? "" : `${flight.rows === flight.drones ? "drone" : "env"} ${end.row}: `;
    const whose = flight.label && `${flight.label}: `;
    button.append(dot, `${whose}${who}${describe(end, flight)}, return ${Number(end.reward.toPrecision(4))}`);
    button.addEventListener("click", () => visit(end, flight));
    item.append(button);
    list.append(item);
  }
}

/** Draws the time line with a mark at each end of an episode. */
export function drawTicks(canvas: HTMLCanvasElement, flight: Flight, seconds: number, total: number, row: number): void {
  const ratio = Math.min(devicePixelRatio, 2);
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (canvas.width !== Math.round(width * ratio)) [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
  const context = canvas.getContext("2d")!;
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  const [left, right] = [7, width - 7]; // the middle of the slider's thumb at its ends
  const x = (time: number): number => left + ((right - left) * time) / Math.max(total, 1e-9);
  context.fillStyle = "#2a3442";
  context.fillRect(left, height / 2 - 2, right - left, 4);
  context.fillStyle = "#4cc2ff";
  context.fillRect(left, height / 2 - 2, x(seconds) - left, 4);
  let drawn = -1;
  for (const end of flight.ends) {
    const at = Math.round(x(flight.timeAt(end.step)));
    if (at === drawn && end.row !== row) continue; // of thousands of ends, a few pixels are enough
    drawn = at;
    context.fillStyle = endColor(end.reason);
    context.globalAlpha = end.row === row ? 1 : 0.35;
    const size = end.row === row ? 10 : 6;
    context.fillRect(at - 1.5, height / 2 - size, 3, 2 * size);
  }
  context.globalAlpha = 1;
}

export interface Key {
  keys: string[];
  shown: string;
  about: string;
  act: (event: KeyboardEvent) => void;
}

export function bindKeys(keys: Key[]): void {
  const list = element("help").querySelector("dl")!;
  for (const { shown, about } of keys) {
    const [term, text] = [document.createElement("dt"), document.createElement("dd")];
    term.textContent = shown;
    text.textContent = about;
    list.append(term, text);
  }
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || element<HTMLDialogElement>("help").open) return;
    const target = event.target as HTMLElement;
    if (target instanceof HTMLSelectElement || (target instanceof HTMLInputElement && target.type === "number")) return;
    if (target instanceof HTMLButtonElement && (event.key === " " || event.key === "Enter")) return;
    const found = keys.find((key) => key.keys.includes(event.key) || key.keys.includes(event.key.toLowerCase()));
    if (!found) return;
    found.act(event);
    event.preventDefault();
  });
}

/** Shows the latest image of one camera of a drone. */
export class ImagePanel {
  private shown = -2;
  private readonly canvas = document.createElement("canvas");
  private readonly caption = document.createElement("figcaption");

  constructor(
    private readonly flight: Flight,
    private readonly camera: CameraInfo,
  ) {
    const figure = document.createElement("figure");
    figure.append(this.canvas, this.caption);
    element("images").append(figure);
  }

  /** Reads the next image even if its number is that of the shown one: the flight has begun anew. */
  forget(): void {
    this.shown = -2;
  }

  update(drone: number, step: number): void {
    const { camera } = this;
    const frames = this.flight.column(camera.frames)!;
    const index = frames.values[step * this.flight.drones + drone];
    if (index === this.shown) return;
    this.shown = index;
    this.caption.textContent = index < 0 ? `${camera.name}: no image yet` : camera.name;
    if (index < 0) return;
    const jpeg = (this.flight.jpeg(camera, index) ?? new Uint8Array()) as Uint8Array<ArrayBuffer>;
    createImageBitmap(new Blob([jpeg], { type: "image/jpeg" })).then(
      (image) => {
        if (this.shown !== index) return;
        [this.canvas.width, this.canvas.height] = [image.width, image.height];
        this.canvas.getContext("2d")!.drawImage(image, 0, 0);
      },
      () => (this.caption.textContent = `${camera.name}: an image that cannot be read`),
    );
  }
}
