// A recorded race as an opponent: the page itself flies another drone from the same start, without a server. It tells the flight
// in moments, as Python does from a live view.

import { Ray, Sphere, Triangle, Vector3 } from "three";
import { Octree } from "three/examples/jsm/math/Octree.js";
import { element } from "./controls";
import { Flight, type Column, type Numbers, type Place, type WorldInfo } from "./flight";
import { passes } from "./gates";
import { parts } from "./glb";
import { Model, tickS } from "./model";
import { Sticks, stickWords } from "./sticks";

const mostS = 0.1; // of flight in an image: a slow machine flies in slow motion
const down = new Vector3(0, 0, -1);
const curves = [
  { title: "Velocity", unit: "m/s", array: "velocity", columns: ["x", "y", "z"] },
  { title: "Height", unit: "m", array: "above_m", columns: ["above"] },
  { title: "Rotors", unit: "rad/s", array: "rotor_speed", columns: ["0", "1", "2", "3"] },
];

interface Shown {
  add(next: Flight): void;
  isLatest(): boolean;
}

/** Returns whether this page can fly against a recorded flight: a race of quadrotors. */
export function canFly(flight: Flight): boolean {
  const { rotors } = flight.drone.model;
  return rotors?.spin.length === 4 && !!flight.column("gate.next") && flight.worlds[flight.worldOf(0, 0)].race_gates.length > 0;
}

export class Solo {
  model!: Model;
  passed = 0;
  private gate = 0;
  private ticks = 0;
  /** Time to fly, s, less than a tick. */
  private due = 0;
  /** The clock waits for the first stick. */
  private isWaiting = true;
  private touched: Vector3 | undefined;
  private readonly world: WorldInfo;
  private readonly walls = new Octree();
  private readonly ball = new Sphere();

  private constructor(private readonly rival: Flight) {
    this.world = rival.worlds[rival.worldOf(0, 0)];
    const { hull_m: hull } = rival.drone.model;
    this.ball.radius = Math.min(...[0, 1].map((axis) => Math.max(...hull.map((corner) => corner[axis]))));
  }

  static async make(rival: Flight): Promise<Solo> {
    const solo = new Solo(rival);
    for (const { geometry } of await parts(solo.world.glb)) {
      const corners = geometry.getAttribute("position");
      const corner = (i: number): Vector3 => new Vector3().fromBufferAttribute(corners, i);
      for (let i = 0; i < corners.count; i += 3) solo.walls.addTriangle(new Triangle(corner(i), corner(i + 1), corner(i + 2)));
    }
    solo.walls.bounds.expandByScalar(0.1); // a triangle in the outermost plane may else be in no part of the tree
    solo.walls.build();
    return solo;
  }

  /** Hovers where the recorded drone began, and faces the gate. Returns the first moment of a flight; `isFirst`: the page has no other yet. */
  begin(isFirst = false): Flight {
    const { rival } = this;
    const pose = new Float64Array(7);
    rival.pose(0, 0, pose);
    this.model = new Model(rival.drone.model, rival.drone.most_dps);
    this.model.position.fromArray(pose);
    this.gate = Math.max(rival.value(rival.column("gate.next")!, 0, 0), 0) % this.world.race_gates.length;
    const [x, y] = this.world.race_gates[this.gate].center;
    this.model.turn.setFromAxisAngle(new Vector3(0, 0, 1), Math.atan2(y - pose[1], x - pose[0]));
    [this.passed, this.ticks, this.due, this.isWaiting, this.touched] = [0, 0, 0, true, undefined];
    return this.moment(false, isFirst);
  }

  /** Flies for a time by throttle, roll, pitch and yaw, and returns the moment after it. */
  fly(seconds: number, sticks: number[]): Flight {
    const { ball, model, walls, world: { race_gates: gates } } = this;
    this.touched = undefined;
    const count = Math.round((this.due + seconds) / tickS);
    this.due += seconds - count * tickS;
    for (const end = this.ticks + count; this.ticks < end; this.ticks++) {
      const before = model.position.clone();
      model.fly(sticks);
      ball.center.copy(model.position);
      const near: Triangle[] = [];
      walls.getSphereTriangles(ball, near);
      for (const triangle of near) {
        const point = triangle.closestPointToPoint(model.position, new Vector3());
        const away = model.position.clone().sub(point);
        const depth = ball.radius - away.length();
        if (depth <= 0) continue;
        model.bounce(away.normalize(), depth); // from either side of the triangle
        this.touched = point;
      }
      if (!passes(gates[this.gate], before, model.position)) continue;
      this.passed++;
      this.gate = (this.gate + 1) % gates.length;
    }
    return this.moment(true, false);
  }

  /** Flies in a page by the pilot's sticks, while it shows the latest moment. */
  run(page: Shown): void {
    element("watch").append(Object.assign(document.createElement("p"), { textContent: `${stickWords}. This page flies a simplified model: flockstep fly flies the engine.` }));
    const sticks = new Sticks(() => page.add(this.begin()));
    let then = performance.now();
    const frame = (now: number): void => {
      const values = sticks.values();
      this.isWaiting &&= values.every((value) => value === 0);
      if (!this.isWaiting && page.isLatest()) page.add(this.fly(Math.min((now - then) / 1000, mostS), values));
      then = now;
      requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  }

  private moment(goesOn: boolean, isFirst: boolean): Flight {
    const { model: { position, velocity, turn, rotors }, rival: { drone }, touched, walls, world } = this;
    const [ray, below]: [Ray, Triangle[]] = [new Ray(position, down), []];
    walls.getRayTriangles(ray, below);
    const hits = below.map(({ a, b, c }) => ray.intersectTriangle(a, b, c, false, new Vector3())?.z ?? -Infinity);
    const column = (name: string, values: Numbers): Column => ({ name, shape: [1, 1, values.length], values, scale: 1, offset: 0, none: null });
    const floats = (name: string, values: Iterable<number>): Column => column(name, Float32Array.from(values));
    const count = (name: string, value: number): Column => column(name, Int32Array.of(value));
    const columns = [
      column("time_s", Float64Array.of(this.ticks * tickS)),
      floats("position", position),
      floats("quat_wxyz", [turn.w, turn.x, turn.y, turn.z]),
      floats("velocity", velocity),
      floats("rotor_speed", rotors),
      floats("above_m", [position.z - Math.max(...hits)]),
      floats("contact.point", touched ?? [NaN, NaN, NaN]),
      count("contact.hit", touched ? 1 : 0),
      count("gate.next", this.gate),
      count("gate.passed", this.passed),
    ];
    const files = [world.glb, drone.glb, drone.hull ?? drone.glb];
    const file = (index: number): Place => [index, 0];
    const header = {
      ...{ goes_on: goesOn, title: this.rival.title, steps: 1, envs: 1, per_env: 1, rows: 1, curves },
      ...{ bodies: [], scanners: [], cameras: [], ends: [], first_body: 0, first_world: isFirst ? 0 : 1 },
      worlds: isFirst ? [{ ...world, glb: file(0) }] : [],
      drone: isFirst ? { ...drone, glb: file(1), hull: file(drone.hull ? 2 : 1) } : null,
    };
    return new Flight(header, columns, ([index]) => files[index]);
  }
}
