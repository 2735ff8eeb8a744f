// The gates of a race: bright frames, the next one brighter, and the laps of a drone.

import * as THREE from "three";
import type { Flight, Gate } from "./flight";

const [colors, grown] = [{ other: 0xff8a3d, next: 0x5fe3a1 }, 0.01]; // m beyond the frame of the world
const [toY, toZ, toX] = [new THREE.Vector3(0, 1, 0), new THREE.Vector3(0, 0, 1), new THREE.Vector3(1, 0, 0)];
const upright = new THREE.Matrix4().makeBasis(toY, toZ, toX); // of a shape drawn flat

const turnOf = ({ quat_wxyz: [w, x, y, z] }: Gate): THREE.Quaternion => new THREE.Quaternion(x, y, z, w).normalize();

/** The square or the circle of a gate, this far from its centre. */
function outline({ shape }: Gate, half: number): THREE.Vector2[] {
  if (shape === "ring") return new THREE.EllipseCurve(0, 0, half, half).getPoints(48);
  return [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([x, y]) => new THREE.Vector2(half * x, half * y));
}

export class Gates {
  readonly group = new THREE.Group();

  constructor(gates: Gate[]) {
    this.group.name = "marker";
    for (const gate of gates) {
      const [inside, bar] = [gate.size_m / 2 - grown, gate.bar_m + 2 * grown];
      const flat = new THREE.Shape(outline(gate, inside + bar));
      flat.holes.push(new THREE.Path(outline(gate, inside)));
      const frame = new THREE.Mesh(new THREE.ExtrudeGeometry(flat, { depth: bar, bevelEnabled: false }).translate(0, 0, -bar / 2).applyMatrix4(upright), new THREE.MeshBasicMaterial({ toneMapped: false }));
      const opening = new THREE.Mesh(new THREE.ShapeGeometry(new THREE.Shape(outline(gate, inside))).applyMatrix4(upright), new THREE.MeshBasicMaterial({ color: colors.next, transparent: true, opacity: 0.22, side: THREE.DoubleSide, depthWrite: false }));
      const both = new THREE.Group().add(frame, opening);
      both.position.fromArray(gate.center);
      both.quaternion.copy(turnOf(gate));
      this.group.add(both);
    }
    this.show(-1);
  }

  /** Marks the gate to fly next, by its index; -1: none. */
  show(next: number): void {
    for (const [i, { children }] of this.group.children.entries()) {
      const [frame, opening] = children as THREE.Mesh<THREE.BufferGeometry, THREE.MeshBasicMaterial>[];
      frame.material.color.set(i === next ? colors.next : colors.other);
      opening.visible = i === next;
    }
  }
}

/** Index of the gate that a drone flies to at a step; -1 if nobody counts gates. */
export function nextGate(flight: Flight, drone: number, step: number): number {
  const column = flight.column("gate.next");
  return column ? flight.value(column, step, drone) : -1;
}

/** Says which gate comes next in which lap, and the times of the laps so far; "" without gates. */
export function describeLaps(flight: Flight, drone: number, seconds: number): string {
  const step = flight.stepAt(seconds);
  const counts = flight.column("gate.passed");
  const { race_gates: gates } = flight.worlds[flight.worldOf(flight.envOf(drone), step)];
  if (!counts || !gates.length) return "";
  const first = flight.episodeStart(drone, step);
  const lapAt = (i: number): number => Math.floor(flight.value(counts, i, drone) / gates.length);
  let [lap, began, isWhole] = [lapAt(first), flight.timeAt(first), flight.value(counts, first, drone) === 0]; // not if its begin is forgotten
  const times: number[] = [];
  for (let i = first + 1; i <= step; i++) {
    if (lapAt(i) === lap) continue;
    if (isWhole) times.push(flight.timeAt(i) - began);
    [lap, began, isWhole] = [lapAt(i), flight.timeAt(i), true];
  }
  const words = [`Lap ${lap + 1}`, `gate ${nextGate(flight, drone, step) + 1} of ${gates.length}`, `${(seconds - began).toFixed(1)} s`];
  if (times.length) words.push(`last ${times.at(-1)!.toFixed(1)} s`, `best ${Math.min(...times).toFixed(1)} s`);
  return words.join(" · ");
}

/** Returns whether a straight path passes a gate forwards, within its opening. */
export function passes(gate: Gate, from: THREE.Vector3, to: THREE.Vector3): boolean {
  const [before, after] = [from, to].map((place) => place.clone().sub(new THREE.Vector3(...gate.center)).applyQuaternion(turnOf(gate).conjugate()));
  if (before.x >= 0 || after.x < 0) return false;
  const { y, z } = before.lerp(after, before.x / (before.x - after.x));
  return (gate.shape === "ring" ? Math.hypot(y, z) : Math.max(Math.abs(y), Math.abs(z))) < gate.size_m / 2;
}
