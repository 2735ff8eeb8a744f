// The pilot's sticks: keys, and the first gamepad with two sticks.

import type { Key } from "./controls";

/** Share of a stick's way that a key is. */
const keyShare = 0.4;
const deadZone = 0.06;
/** Sticks throttle, roll, pitch and yaw: index and direction. */
const keys: Record<string, [number, number]> = {
  w: [0, 1], s: [0, -1], arrowright: [1, 1], arrowleft: [1, -1], arrowup: [2, 1], arrowdown: [2, -1], d: [3, 1], a: [3, -1],
};

const act = (): void => undefined; // `Sticks` does it
/** What the help says of the sticks. */
export const stickKeys: Key[] = [
  { keys: ["w", "s"], shown: "W S", about: "throttle; gamepad: left stick, up and down", act },
  { keys: ["a", "d"], shown: "A D", about: "yaw; gamepad: left stick, sideways", act },
  { keys: ["arrowup", "arrowdown"], shown: "↑ ↓", about: "pitch; gamepad: right stick, up and down", act },
  { keys: ["arrowleft", "arrowright"], shown: "← →", about: "roll; gamepad: right stick, sideways", act },
  { keys: ["r"], shown: "R", about: "begin again", act },
];
export const stickWords = "W S A D and arrows, or a gamepad. R begins again";

/** The left stick is throttle and yaw. */
function gamepad(): number[] {
  const pad = navigator.getGamepads().find((each) => each && each.connected && each.axes.length >= 4);
  if (!pad) return [0, 0, 0, 0];
  const [yaw, down, roll, back] = pad.axes;
  return [-down, roll, -back, yaw].map((value) => (Math.abs(value) >= deadZone ? value : 0));
}

export class Sticks {
  private readonly held = new Set<string>();

  /** `reset` is called when the pilot begins again. */
  constructor(reset: () => void) {
    const hold = (event: KeyboardEvent): void => {
      const key = event.key.toLowerCase();
      if (event.ctrlKey || event.metaKey || event.altKey || !(key in keys || key === "r")) return;
      event.stopImmediatePropagation(); // the page's own keys
      event.preventDefault();
      if (event.type === "keyup") this.held.delete(key);
      else if (key !== "r") this.held.add(key);
      else if (!event.repeat) reset();
    };
    for (const type of ["keydown", "keyup"] as const) addEventListener(type, hold, true);
    addEventListener("blur", () => this.held.clear());
  }

  /** Throttle, roll, pitch and yaw, from -1 to 1. */
  values(): number[] {
    const sticks = gamepad();
    for (const key of this.held) sticks[keys[key][0]] += keyShare * keys[key][1];
    return sticks.map((value) => Math.min(Math.max(value, -1), 1));
  }
}
