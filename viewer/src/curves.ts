// Curves under the time line: rewards, actions, state and sensors of the chosen drone.

import uPlot from "uplot";
import type { Column, Curves, Flight } from "./flight";

const colors = ["#4cc2ff", "#ff9d5c", "#5fe3a1", "#d79bff", "#ffd75e", "#ff7d9c", "#6ee7e7", "#b8c4ff", "#c5e86c", "#ffb3d1"];
const mostPoints = 3000;
const mostColumns = 10;

/** Row of a curve: of the drone, or of its row of rewards. */
function rowOf(flight: Flight, column: Column, drone: number): number {
  return column.shape[1] === flight.drones ? drone : flight.rowOf(drone);
}

/** Times and columns of a curve, thinned to the least and greatest value of each part if it is long. */
export function sampled(flight: Flight, curve: Curves, drone: number): (number | null)[][] {
  const column = flight.column(curve.array)!;
  const width = column.shape.slice(2).reduce((product, side) => product * side, 1);
  const row = rowOf(flight, column, drone);
  const names = curve.columns.slice(0, mostColumns);
  const at = (step: number, i: number): number | null => {
    const value = flight.value(column, step, row * width + i);
    return Number.isFinite(value) ? value : null;
  };
  const part = Math.ceil(flight.steps / (mostPoints / 2));
  if (flight.steps <= mostPoints) {
    const steps = Array.from({ length: flight.steps }, (_, step) => step);
    return [steps.map((step) => flight.timeAt(step)), ...names.map((_, i) => steps.map((step) => at(step, i)))];
  }
  const times: number[] = [];
  const series: (number | null)[][] = names.map(() => []);
  for (let first = 0; first < flight.steps; first += part) {
    times.push(flight.timeAt(first), flight.timeAt(first + part / 2));
    for (const [i, values] of series.entries()) {
      let [low, high]: (number | null)[] = [null, null];
      for (let step = first; step < Math.min(first + part, flight.steps); step++) {
        const value = at(step, i);
        if (value === null) continue;
        if (low === null || value < low) low = value;
        if (high === null || value > high) high = value;
      }
      values.push(low, high);
    }
  }
  return [times, ...series];
}

/** Limits of an axis. One spike, such as a reward for the goal, does not flatten all other values: it leaves the chart. */
function limits(series: (number | null)[][]): [number, number] {
  const values = series.flat().filter((value): value is number => value !== null).sort((a, b) => a - b);
  if (!values.length) return [0, 1];
  const at = (share: number): number => values[Math.round(share * (values.length - 1))];
  let [low, high] = [at(0), at(1)];
  const [common, most] = [at(0.985) - at(0.015), high - low];
  if (common > 0 && most > 8 * common) [low, high] = [Math.max(low, at(0.015) - common), Math.min(high, at(0.985) + common)];
  const margin = 0.06 * (high - low) || 0.5;
  return [low - margin, high + margin];
}

export class CurvePanel {
  private plots: { plot: uPlot; readings: HTMLElement[]; curve: Curves; setRange: (range: [number, number]) => void }[] = [];
  private shown: Set<string>;
  private drone = 0;
  private seconds = 0;

  constructor(
    private readonly flight: Flight,
    chips: HTMLElement,
    private readonly panel: HTMLElement,
    private readonly seek: (seconds: number) => void,
    shown: number,
  ) {
    this.shown = new Set(flight.curves.slice(0, shown).map((curve) => curve.title));
    for (const curve of flight.curves) {
      const chip = document.createElement("button");
      chip.textContent = curve.title;
      chip.className = "chip";
      chip.setAttribute("aria-pressed", String(this.shown.has(curve.title)));
      chip.addEventListener("click", () => {
        if (!this.shown.delete(curve.title)) this.shown.add(curve.title);
        chip.setAttribute("aria-pressed", String(this.shown.has(curve.title)));
        this.show(this.drone);
      });
      chips.append(chip);
    }
    new ResizeObserver(() => {
      for (const { plot } of this.plots) plot.setSize(this.size(plot.root.parentElement!));
    }).observe(panel);
    chips.hidden = flight.curves.length === 0;
  }

  private size(box: HTMLElement): { width: number; height: number } {
    return { width: Math.max(box.clientWidth, 120), height: 118 };
  }

  show(drone: number): void {
    this.drone = drone;
    for (const { plot } of this.plots) plot.destroy();
    this.plots = [];
    this.panel.replaceChildren();
    const curves = this.flight.curves.filter((curve) => this.shown.has(curve.title));
    this.panel.hidden = curves.length === 0;
    for (const curve of curves) this.plots.push(this.make(curve));
    this.update(this.seconds);
  }

  private make(curve: Curves): (typeof this.plots)[number] {
    const box = document.createElement("section");
    const head = document.createElement("div");
    head.className = "legend";
    const title = document.createElement("b");
    title.textContent = curve.unit ? `${curve.title}, ${curve.unit}` : curve.title;
    head.append(title);
    const readings = curve.columns.slice(0, mostColumns).map((name, i) => {
      const entry = document.createElement("span");
      const value = document.createElement("output");
      entry.style.color = colors[i % colors.length];
      entry.textContent = `${name} `;
      entry.append(value);
      head.append(entry);
      return value;
    });
    const chart = document.createElement("div");
    box.append(head, chart);
    this.panel.append(box);
    const axis = { stroke: "#8b97a8", grid: { stroke: "#222b38", width: 1 }, ticks: { show: false }, font: "11px system-ui", gap: 2 };
    const data = sampled(this.flight, curve, this.drone);
    let range = limits(data.slice(1));
    const plot = new uPlot(
      {
        ...this.size(chart),
        padding: [8, 8, 0, 0],
        legend: { show: false },
        cursor: { y: false, drag: { x: false, y: false }, points: { show: false } },
        scales: { x: { time: false }, y: { range: () => range } },
        axes: [{ ...axis, size: 20 }, { ...axis, size: 44 }],
        series: [{}, ...readings.map((_, i) => ({ stroke: colors[i % colors.length], width: 1.5, points: { show: false } }))],
        hooks: {
          draw: [
            (drawn: uPlot) => {
              const x = Math.round(drawn.valToPos(this.seconds, "x", true));
              drawn.ctx.fillStyle = "rgba(255,255,255,0.75)";
              drawn.ctx.fillRect(x, drawn.bbox.top, Math.max(devicePixelRatio, 1), drawn.bbox.height);
            },
          ],
        },
      },
      data as uPlot.AlignedData,
      chart,
    );
    plot.over.addEventListener("pointerdown", (event) => {
      plot.over.setPointerCapture(event.pointerId);
      this.seek(plot.posToVal(event.offsetX, "x"));
    });
    plot.over.addEventListener("pointermove", (event) => {
      if (event.buttons & 1) this.seek(plot.posToVal(event.offsetX, "x"));
    });
    return { plot, readings, curve, setRange: (next) => (range = next) };
  }

  /** Draws the curves of a flight that has grown. */
  grow(): void {
    for (const { plot, curve, setRange } of this.plots) {
      const data = sampled(this.flight, curve, this.drone);
      setRange(limits(data.slice(1)));
      plot.setData(data as uPlot.AlignedData);
    }
  }

  update(seconds: number): void {
    this.seconds = seconds;
    const step = this.flight.stepAt(seconds);
    for (const { plot, readings, curve } of this.plots) {
      const column = this.flight.column(curve.array)!;
      const width = column.shape.slice(2).reduce((product, side) => product * side, 1);
      const row = rowOf(this.flight, column, this.drone);
      for (const [i, reading] of readings.entries()) {
        const value = this.flight.value(column, step, row * width + i);
        reading.textContent = Number.isFinite(value) ? String(Number(value.toPrecision(3))) : "–";
      }
      plot.redraw(false, false);
    }
  }
}
