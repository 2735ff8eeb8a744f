// The flight model of this page: a quadrotor that is commanded thrust and body rates, in still air, by the equations of
// docs/concepts/flight-model.md. It leaves out wind, ground effect and downwash, and a ball stands for the hull.

import { Matrix4, Quaternion, Vector3 } from "three";
import type { Airframe } from "./flight";

/** Duration of a tick, s: the engine's default for a policy at 50 Hz. */
export const tickS = 0.002;
const gravity = 9.81;
const mostThrustToWeight = 4; // at full throttle, as in the task Race
const [restitution, friction] = [0.3, 0.5]; // the engine's defaults

const clamp = (value: number, low: number, high: number): number => Math.min(Math.max(value, low), high);
const vector = ([x, y, z]: number[]): Vector3 => new Vector3(x, y, z);
/** Turns by an angular velocity for a time. */
const turned = (turn: Quaternion, rates: Vector3, seconds: number): Quaternion =>
  turn.clone().multiply(new Quaternion().setFromAxisAngle(rates.clone().normalize(), rates.length() * seconds));

type Four = [number, number, number, number];

interface Motion {
  position: Vector3;
  velocity: Vector3;
  turn: Quaternion;
  rates: Vector3;
  /** Speeds, rad/s. */
  rotors: number[];
}

export class Model implements Motion {
  position = new Vector3();
  velocity = new Vector3();
  turn = new Quaternion();
  rates = new Vector3();
  rotors: number[];
  private readonly own: NonNullable<Airframe["rotors"]>;
  private readonly hubs: Vector3[];
  /** Signs of the torques about z. */
  private readonly yaws: number[];
  private readonly inertia: Vector3;
  /** From thrust (N) and torques (N m) to the thrusts of rotors. */
  private readonly mixer: number[][];
  private readonly gains: Vector3;
  private readonly lead: number;
  private readonly thrusts: [least: number, most: number];
  private readonly mostRates: Vector3;

  constructor(private readonly frame: Airframe, mostDps: number[]) {
    this.own = frame.rotors!;
    this.hubs = this.own.position_m.map(vector);
    this.yaws = this.own.spin.map((spin) => (spin === "ccw" ? -1 : 1));
    this.inertia = vector(frame.inertia_kgm2);
    const { hubs, own, yaws } = this;
    const inverse = new Matrix4().set(1, 1, 1, 1, ...(hubs.map(({ y }) => y) as Four), ...(hubs.map(({ x }) => -x) as Four), ...(yaws.map((sign) => sign * own.torque_ratio_m) as Four)).invert().elements;
    this.mixer = hubs.map((_, rotor) => [0, 1, 2, 3].map((k) => inverse[4 * k + rotor]));
    const lag = (own.lag_up_s + own.lag_down_s) / 2;
    this.lead = clamp(lag / 0.035, 1, 4);
    const rate = Math.min(lag > 0 ? (0.5 * this.lead) / lag : Infinity, 0.25 / tickS);
    this.gains = new Vector3(rate, rate, rate / 3);
    this.thrusts = [this.thrustAt(own.min_speed_radps), this.thrustAt(own.max_speed_radps)];
    this.mostRates = vector(mostDps).multiplyScalar(Math.PI / 180);
    this.rotors = hubs.map(() => this.speedFor((frame.mass_kg * gravity) / 4));
  }

  /** Flies a tick by throttle, roll, pitch and yaw, from -1 to 1; 0 hovers, and a yaw of 1 turns right. */
  fly([throttle, roll, pitch, yaw]: number[]): void {
    const [least, most] = this.thrusts.map((thrust) => (4 * thrust) / this.frame.mass_kg);
    const range = throttle > 0 ? Math.min(most, mostThrustToWeight * gravity) - gravity : gravity - least;
    const commands = this.mix(gravity + throttle * range, new Vector3(roll, pitch, -yaw).multiply(this.mostRates));
    const first = this.forces(this, commands);
    const half = tickS / 2;
    const middle: Motion = {
      position: this.position,
      velocity: this.velocity.clone().addScaledVector(first.acceleration, half),
      turn: turned(this.turn, this.rates, half),
      rates: this.rates.clone().addScaledVector(first.turning, half),
      rotors: this.lagged(commands, half),
    };
    const mean = this.forces(middle, commands);
    this.position.addScaledVector(middle.velocity, tickS);
    this.velocity.addScaledVector(mean.acceleration, tickS);
    this.turn = turned(this.turn, middle.rates, tickS).normalize();
    this.rates.addScaledVector(mean.turning, tickS);
    this.rotors = this.lagged(commands, tickS);
  }

  /** Bounces back from a surface, by its normal and how deep the drone is inside. */
  bounce(normal: Vector3, depth: number): void {
    this.position.addScaledVector(normal, depth);
    const towards = -this.velocity.dot(normal);
    if (towards <= 0) return;
    const along = this.velocity.clone().addScaledVector(normal, towards);
    const push = (1 + restitution) * towards;
    this.velocity.addScaledVector(normal, push).addScaledVector(along, -Math.min((friction * push) / Math.max(along.length(), 1e-9), 1));
  }

  private thrustAt(speed: number): number {
    const [c0, c1, c2] = this.own.thrust_n;
    return Math.max(c0 + (c1 + c2 * speed) * speed, 0);
  }

  private speedFor(thrust: number): number {
    const [c0, c1, c2] = this.own.thrust_n;
    return c2 > 0 ? (Math.sqrt(Math.max(c1 * c1 + 4 * c2 * (thrust - c0), 0)) - c1) / (2 * c2) : (thrust - c0) / c1;
  }

  /** Rotor speeds after a time under commands. */
  private lagged(commands: number[], seconds: number): number[] {
    return this.rotors.map((speed, i) => {
      const lag = speed < commands[i] ? this.own.lag_up_s : this.own.lag_down_s;
      return commands[i] + (lag > 0 ? (speed - commands[i]) * Math.exp(-seconds / lag) : 0);
    });
  }

  /** Rotor speeds for a thrust over mass and body rates. Where rotors saturate, yaw yields first, then thrust, then roll and pitch. */
  private mix(thrust: number, wanted: Vector3): number[] {
    const { mixer, own, rates, rotors, thrusts: [least, most] } = this;
    const { x, y, z } = wanted.sub(rates).multiply(this.gains).multiply(this.inertia).add(rates.clone().cross(this.inertia.clone().multiply(rates)));
    const tilts = mixer.map(([, roll, pitch]) => roll * x + pitch * y);
    const scale = Math.min(1, (most - least) / Math.max(Math.max(...tilts) - Math.min(...tilts), 1e-6 * most));
    const levels = mixer.map(([up], i) => up * this.frame.mass_kg * thrust + scale * tilts[i]);
    const shift = Math.max(0, least - Math.min(...levels)) - Math.max(0, Math.max(...levels) - most);
    const turns = mixer.map((row) => row[3] * z);
    const shares = turns.map((turn, i) => Math.max(turn > 0 ? most - levels[i] - shift : levels[i] + shift - least, 0) / Math.max(Math.abs(turn), 1e-6 * most));
    const share = Math.min(1, ...shares);
    return levels.map((level, i) => {
      const speed = this.speedFor(clamp(level + shift + share * turns[i], least, most));
      return clamp(rotors[i] + this.lead * (speed - rotors[i]), own.min_speed_radps, own.max_speed_radps);
    });
  }

  private forces({ velocity, turn, rates, rotors }: Motion, commands: number[]): { acceleration: Vector3; turning: Vector3 } {
    const { frame, hubs, inertia, own, yaws } = this;
    const air = velocity.clone().applyQuaternion(turn.clone().conjugate());
    const [force, torque] = [new Vector3(), new Vector3()];
    let [momentum, change] = [0, 0];
    for (const [i, speed] of rotors.entries()) {
      const past = rates.clone().cross(hubs[i]).add(air);
      const push = this.thrustAt(speed) + own.lift_n_per_mps2 * (past.x * past.x + past.y * past.y);
      const pull = past.multiply(vector(own.drag_n_per_radps_mps)).multiplyScalar(-speed);
      pull.z += push;
      force.add(pull);
      torque.add(hubs[i].clone().cross(pull));
      torque.z += yaws[i] * own.torque_ratio_m * push;
      const lag = commands[i] > speed ? own.lag_up_s : own.lag_down_s;
      momentum -= yaws[i] * own.inertia_kgm2 * speed;
      change -= lag > 0 ? (yaws[i] * own.inertia_kgm2 * (commands[i] - speed)) / lag : 0;
    }
    const { linear_n_per_mps: linear, quadratic_n_per_mps2: quadratic } = frame.drag;
    force.sub(vector(quadratic).multiplyScalar(air.length()).add(vector(linear)).multiply(air));
    torque.sub(rates.clone().cross(inertia.clone().multiply(rates).setZ(inertia.z * rates.z + momentum)));
    torque.z -= change;
    const acceleration = force.divideScalar(frame.mass_kg).applyQuaternion(turn);
    acceleration.z -= gravity;
    return { acceleration, turning: torque.divide(inertia) };
  }
}
